"""One-off studies: kept as they were run, not maintained; see README.md."""

import plop as plop  # before torch: it says how threads of torch wait
