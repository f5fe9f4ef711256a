"""How plop is installed, and how to install its extras."""

from __future__ import annotations

import importlib.util
import json
import shlex
from importlib import metadata
from pathlib import Path
from urllib.parse import unquote, urlparse

SOURCE = Path(__file__).resolve().parents[1]
"""Folder that contains the packages: a checkout, or site-packages."""


def checkout() -> Path | None:
    """Return the checkout that plop runs from; None when it was installed from a wheel."""
    try:
        source = json.loads(metadata.distribution("plop").read_text("direct_url.json") or "{}")
    except (metadata.PackageNotFoundError, OSError, ValueError):
        source = {}
    if (SOURCE / "pyproject.toml").is_file():
        return SOURCE
    if source.get("dir_info", {}).get("editable"):
        return Path(unquote(urlparse(str(source.get("url", ""))).path))
    return None


def installer() -> str:
    """Return the start of a command that installs into this environment: environments made by uv have no pip."""
    return "pip install" if importlib.util.find_spec("pip") is not None else "uv pip install"


def install_extra(extra: str, here: Path | None = None) -> str:
    """Return the command that installs one of plop's extras.

    Args:
        extra: E.g. "view".
        here: Folder in which it will be typed; the current one when absent.
    """
    folder = checkout()
    if folder is None:
        return f"{installer()} 'plop[{extra}]'"
    path = "." if folder == (here or Path.cwd()) else str(folder)
    return f"{installer()} -e {shlex.quote(f'{path}[{extra}]')}"


def install_package(requirement: str) -> str:
    """Return the command that installs a package."""
    return f"{installer()} {shlex.quote(requirement)}"
