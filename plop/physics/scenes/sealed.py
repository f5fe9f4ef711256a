"""The sealed answer of a simulation: the hidden effects, encoded so that nobody reads them by accident.

    answer/sealed.json   {"schema": 1, "sealed": base64 of JSON}

Nothing that compares, diagnoses or augments may import this module; scoring may.
"""

from __future__ import annotations

import base64
import binascii
import json
from pathlib import Path
from typing import Any

from plop.errors import PlopError

ANSWER = Path("answer") / "sealed.json"
"""Path of the answer in an artifact of `simulate`."""


def seal_answer(folder: Path, answer: dict[str, Any]) -> Path:
    """Write the sealed answer below a folder; return the file."""
    path = folder / ANSWER
    path.parent.mkdir(parents=True, exist_ok=True)
    sealed = base64.b64encode(json.dumps(answer, sort_keys=True).encode()).decode()
    path.write_text(json.dumps({"schema": 1, "sealed": sealed}, indent=1))
    return path


def open_answer(path: str | Path) -> dict[str, Any]:
    """Read the hidden effects and faults.

    Args:
        path: The sealed file, or the artifact's folder.

    Returns:
        "effects": {name: {parameter: value}}, "faults": {camera: {name: {parameter: value}}}, "random": whether
        they were drawn, "rms_m": displacement caused by the effects, root mean square over all surface points,
        frames and episodes [m], "noise_floor_m", and "snr", the ratio of the two.

    Raises:
        PlopError: There is no answer, or it is damaged.
    """
    path = Path(path)
    file = path / ANSWER if path.is_dir() else path
    try:
        answer = json.loads(base64.b64decode(json.loads(file.read_text())["sealed"], validate=True))
        if not isinstance(answer, dict):
            raise TypeError("not a table")
    except (OSError, ValueError, KeyError, TypeError, binascii.Error) as error:
        raise PlopError(
            "There is no sealed answer.",
            where=file,
            expected="answer/sealed.json of `plop simulate`",
            found=str(error),
            fix="Give the folder of a simulate artifact.",
        ) from error
    return answer
