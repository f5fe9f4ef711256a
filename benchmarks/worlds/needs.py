"""Packages of the extra `worlds`, asked for when they are needed."""

from __future__ import annotations

import importlib
from types import ModuleType

from plop.errors import PlopError
from plop.installed import install_extra


def needed(module: str) -> ModuleType:
    """Import a module of a simulator.

    Raises:
        PlopError: Its package is not installed; names the extra that brings it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise PlopError(
            "A foreign simulator is not installed.",
            where=module.split(".")[0],
            expected="the packages of the extra `worlds`",
            found=str(error),
            fix=install_extra("worlds"),
        ) from error
