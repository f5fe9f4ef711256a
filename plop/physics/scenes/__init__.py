"""The scenes that come with plop, as TOML files; found by their bare names."""

from __future__ import annotations

import importlib.resources
from pathlib import Path

from plop.errors import PlopError
from plop.physics.scenes.names import one_of


def shipped_scenes() -> list[str]:
    """Return the names of the scenes that come with plop, e.g. "block.toml"."""
    folder = importlib.resources.files("plop.physics.scenes")
    return sorted(entry.name for entry in folder.iterdir() if entry.name.endswith(".toml"))


def find_scene(path: Path) -> Path:
    """Find a scene's file: at its path, else among the shipped ones by its bare name.

    Raises:
        PlopError: Neither there nor shipped; suggests a name.
    """
    if path.is_file():
        return path
    if path.parent != Path():
        raise PlopError(
            "There is no such scene.",
            where=path,
            expected="a TOML file",
            found="nothing",
            fix=f"Shipped scenes: {', '.join(shipped_scenes())}.",
        )
    name = one_of(path.name if path.suffix else f"{path.name}.toml", shipped_scenes(), "scene", where=str(path))
    return Path(str(importlib.resources.files("plop.physics.scenes") / name))
