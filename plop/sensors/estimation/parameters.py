"""The numbers that are estimated for one camera, in one vector: all parameters of all faults, in library order."""

from __future__ import annotations

import numpy as np

from plop.sensors.faults.library import FAULTS

SLICES: dict[str, slice] = {}
"""Place of each fault's parameters in the vector."""
_start = 0
for _name, _fault in FAULTS.items():
    SLICES[_name] = slice(_start, _start + len(_fault.parameters))
    _start += len(_fault.parameters)
COUNT = _start
"""Length of the vector: 15."""
ABSENT = np.array([p.default for fault in FAULTS.values() for p in fault.parameters])
"""The values without any fault, shape [15]. Estimates are deviations from them."""
_WIDTHS = {"s": 0.2, "-": 0.1, "m": 0.05, "rad": 0.1}
PRIOR_WIDTH = np.array([_WIDTHS[p.unit] for fault in FAULTS.values() for p in fault.parameters])
"""Standard deviation of a weak prior around 'absent', shape [15]: what the data do not tell stays there, with this
as its standard error."""
