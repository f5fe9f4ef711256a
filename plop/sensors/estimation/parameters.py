"""The numbers that are estimated, in one vector: all parameters of all faults of one camera, then those of the tool."""

from __future__ import annotations

import numpy as np

from plop.parameters import Parameter
from plop.sensors.faults.library import FAULTS
from plop.sensors.faults.tool import TOOL_FAULTS

_ALL: dict[str, tuple[Parameter, ...]] = {name: fault.parameters for name, fault in FAULTS.items()}
COUNT = sum(map(len, _ALL.values()))
"""Length of a camera's part: 15."""
_ALL |= {name: fault.parameters for name, fault in TOOL_FAULTS.items() if name != "robot_clock"}
_FLAT = [p for parameters in _ALL.values() for p in parameters]
TOTAL = len(_FLAT)
"""Length of the vector: 19."""
_STARTS = np.cumsum([0, *map(len, _ALL.values())])
SLICES = {name: slice(int(start), int(start) + len(_ALL[name])) for name, start in zip(_ALL, _STARTS, strict=False)}
"""Place of each fault's parameters in the vector."""
SLICES["robot_clock"] = SLICES["clock"]  # the robot's clock is what the clocks of all cameras have in common
ABSENT = np.array([p.default for p in _FLAT])
"""The values without any fault, shape [19]. Estimates are deviations from them."""
_WIDTHS = {"s": 0.2, "-": 0.1, "m": 0.05, "rad": 0.1}
PRIOR_WIDTH = np.array([_WIDTHS[p.unit] for p in _FLAT])
"""Standard deviation of a weak prior around 'absent', shape [19]: what the data do not tell stays there, with this
as its standard error."""
LINEAR = 5 * np.array([p.step for p in _FLAT])
"""Change within which residuals are nearly linear, shape [19]: 5 ms, mm, mrad or parts in a thousand."""
