"""Checks of the values of a scene's TOML file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, TypeVar

from plop.errors import PlopError
from plop.physics.engine.material import ElasticLaw, Material
from plop.physics.scenes.names import one_of
from plop.physics.scenes.shapes import SHAPES, Shape

MATERIAL = Material(
    youngs_modulus_pa=1.5e4,
    poisson=0.40,
    density_kg_m3=1050.0,
    damping_per_s=2.0,
    table_friction=0.5,
    tool_friction=0.3,
    cut_friction=0.3,
    toughness_j_m2=2.0,
    law=ElasticLaw.FIXED_COROTATED,
)
"""Default material of an object."""
Built = TypeVar("Built")
_WRITE = "Write the value as docs/how-to/simulate.md shows it."


def table_of(value: Any, key: str) -> Mapping[str, Any]:
    """Reject a value in place of a table."""
    if not isinstance(value, Mapping):
        raise PlopError(
            "A value of the scene should be a table.",
            where=key,
            expected=f"[{key}] with keys",
            found=repr(value),
            fix="docs/how-to/simulate.md shows a scene.",
        )
    return value


def known_keys(table: Mapping[str, Any], owner: type, prefix: str) -> dict[str, Any]:
    """Reject keys that a dataclass does not have, with a suggestion."""
    names = [entry.name for entry in fields(owner)]
    for key in table:
        one_of(key, names, "key", where=f"{prefix}{key}")
    return dict(table)


def built(owner: type[Built], values: dict[str, Any], where: str) -> Built:
    """Build a dataclass; a value of the wrong type becomes a PlopError."""
    kind: Any = owner
    for entry in fields(kind):
        value = values.get(entry.name, 0)
        if entry.type in ("int", "float") and (isinstance(value, bool) or not isinstance(value, (int, float))):
            raise PlopError(
                "A value of the scene has the wrong type.",
                where=f"{where}.{entry.name}",
                expected="a number without quotes",
                found=repr(value),
                fix=_WRITE,
            )
    try:
        return owner(**values)
    except TypeError as error:
        raise PlopError(
            "A value of the scene has the wrong type.",
            where=where,
            found=str(error),
            expected="numbers without quotes, names in quotes",
            fix=_WRITE,
        ) from error


def numbers(value: Any, key: str) -> tuple[float, ...]:
    """Read a pair, or one number for a range without width."""
    pair = value if isinstance(value, list) else [value, value]
    if not all(isinstance(number, (int, float)) and not isinstance(number, bool) for number in pair):
        raise PlopError(
            "A value of the scene has the wrong type.",
            where=key,
            expected="[least, most]",
            found=repr(value),
            fix=_WRITE,
        )
    return tuple(float(number) for number in pair)


def shape_of(table: Mapping[str, Any]) -> Shape:
    """Read [shape]: size_m, or radius_m (and height_m) of a round object."""
    known = ("kind", "size_m", "radius_m", "height_m")
    for key in table:
        one_of(key, known, "key", where=f"shape.{key}")
    kind = one_of(str(table.get("kind", "block")), SHAPES, "shape", where="shape.kind")
    if "radius_m" in table and "size_m" in table:
        raise PlopError(
            "The shape has two conflicting sizes.",
            where="shape",
            found="radius_m and size_m",
            expected="one of them",
            fix="Remove radius_m for a block, size_m for a round object.",
        )
    if "radius_m" in table and kind != "block":
        across = 2 * numbers(table["radius_m"], "shape.radius_m")[0]
        height = across if kind == "sphere" else numbers(table.get("height_m", 0.04), "shape.height_m")[0]
        return Shape(kind, (across, across, height))
    if "size_m" not in table:
        raise PlopError(
            "The shape has no size.",
            where="shape",
            found=", ".join(table) or "nothing",
            expected="size_m = [length, width, height] of a block; radius_m of a sphere; radius_m and "
            "height_m of a cylinder",
            fix="Write its size in metres.",
        )
    size = numbers(table["size_m"], "shape.size_m")
    return built(Shape, {"kind": kind, "size_m": size}, "shape")


def material_of(table: dict[str, Any]) -> Material:
    """Read [material]; missing values are those of MATERIAL."""
    base = {entry.name: getattr(MATERIAL, entry.name) for entry in fields(Material)}
    if "law" in table:
        laws = {law.name.lower(): law for law in ElasticLaw}
        table["law"] = laws[one_of(str(table["law"]), laws, "elastic law", where="material.law")]
    material: Material = built(Material, base | table, "material")
    return material
