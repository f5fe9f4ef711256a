"""open3d, imported on first use: commands that cast no rays work without it and its system libraries."""

from __future__ import annotations

import importlib
from typing import Any

from plop.errors import PlopError
from plop.system_libraries import install_command, missing_packages


class _Open3d:
    """Proxy of the package; attributes are those of the real one."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # tools that inspect every name of a module must not import it
            raise AttributeError(name)
        return getattr(load_open3d(), name)


o3d: Any = _Open3d()


def load_open3d() -> Any:
    """Import open3d.

    Raises:
        PlopError: It is not installed, or a library of the system is missing; names the package that holds it.
    """
    try:
        return importlib.import_module("open3d")
    except (ImportError, OSError) as error:
        raise _unloadable(error) from error


def _unloadable(error: Exception) -> PlopError:
    packages = missing_packages()
    if getattr(error, "name", None) == "open3d":
        fix = "pip install open3d-cpu   (on x86-64 Linux; elsewhere: pip install open3d)"
    elif packages:
        fix = f"{install_command(packages)}   (on Debian and Ubuntu, as root)"
    else:
        fix = "Install it again; on Linux it needs glibc 2.35 or newer."
    return PlopError(
        "open3d, which casts the rays, cannot be loaded.",
        expected="the package and its system libraries",
        found=next(iter(str(error).splitlines()), "") or type(error).__name__,
        fix=fix,
    )
