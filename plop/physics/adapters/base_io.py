"""Engine settings as JSON types, and back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from plop.errors import PlopError
from plop.physics.adapters.filled import EngineBase
from plop.physics.engine.material import ElasticLaw, Material


def base_to_dict(base: EngineBase) -> dict[str, Any]:
    """Write settings of the engine as JSON types; the elastic law by its name."""
    return {**asdict(base), "material": {**asdict(base.material), "law": base.material.law.name.lower()}}


def base_from_dict(table: Mapping[str, Any]) -> EngineBase:
    """Read what `base_to_dict` wrote.

    Raises:
        PlopError: A key is missing or unknown.
    """
    values = dict(table)
    try:
        material = dict(values.pop("material"))
        law = ElasticLaw[str(material.pop("law")).upper()]
        return EngineBase(Material(law=law, **material), **values)
    except (KeyError, TypeError, AttributeError) as error:
        raise PlopError(
            "The engine's settings cannot be read.",
            where="engine",
            expected="material, spacing_m, settled",
            found=str(error),
            fix="Run `plop identify` again.",
        ) from error
