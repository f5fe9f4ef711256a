"""Small files that are there whole or not at all."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any


def write_json(path: Path, content: Mapping[str, Any], *, sort_keys: bool = True) -> None:
    """Write JSON under a temporary name first, so that a killed run leaves nothing that looks finished.

    Args:
        path: The file; its folder is made when it does not exist.
        content: JSON types.
        sort_keys: Order the keys by name rather than as given.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    scratch = path.with_name(path.name + ".tmp")
    scratch.write_text(json.dumps(content, indent=1, sort_keys=sort_keys))
    os.replace(scratch, path)
