"""Run `python -m plop_cli` as `plop`."""

from plop_cli.app import main

raise SystemExit(main())
