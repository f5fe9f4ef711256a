"""Read the vertices of a PLY file, whatever properties they have."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from plop.errors import PlopError

_TYPES = {
    "char": "i1",
    "int8": "i1",
    "uchar": "u1",
    "uint8": "u1",
    "short": "i2",
    "int16": "i2",
    "ushort": "u2",
    "uint16": "u2",
    "int": "i4",
    "int32": "i4",
    "uint": "u4",
    "uint32": "u4",
    "float": "f4",
    "float32": "f4",
    "double": "f8",
    "float64": "f8",
}
_FORMATS = {"binary_little_endian": "<", "binary_big_endian": ">"}
_HEADER_LIMIT = 1 << 20


def read_vertices(path: str | Path) -> dict[str, np.ndarray]:
    """Read the vertex element of a PLY: binary of either byte order, or ASCII.

    Args:
        path: A PLY file whose first element is `vertex`, with number properties only.

    Returns:
        One array per property, shape [N], in the file's number types (ASCII: float64).

    Raises:
        PlopError: The file is missing, truncated or not such a PLY.
    """
    path = Path(path)
    if not path.is_file():
        raise PlopError("There is no such PLY file.", where=path, expected="a PLY file", found="no file")
    data = path.read_bytes()
    end = data.find(b"end_header", 0, _HEADER_LIMIT)
    if not data.startswith(b"ply") or end < 0:
        raise PlopError(
            "This is not a PLY file.",
            where=path,
            expected="a header from 'ply' to 'end_header'",
            found=repr(data[:16].decode("latin1")),
        )
    layout, count, properties = _parse_header(path, data[:end].decode("latin1").splitlines())
    start = data.find(b"\n", end) + 1
    if layout == "ascii":
        try:
            numbers = np.array(data[start:].split()[: count * len(properties)], dtype=np.float64)
        except ValueError as error:
            raise PlopError(
                "The PLY file holds something that is not a number.", where=path, found=str(error)
            ) from error
        _check_length(path, count * len(properties), len(numbers), "numbers")
        return dict(zip((name for name, _ in properties), numbers.reshape(count, -1).T, strict=True))
    kind = np.dtype([(name, _FORMATS[layout] + code) for name, code in properties])
    _check_length(path, count * kind.itemsize, len(data) - start, "bytes")
    records = np.frombuffer(data, dtype=kind, count=count, offset=start)
    return {name: records[name] for name, _ in properties}


def _parse_header(path: Path, lines: list[str]) -> tuple[str, int, list[tuple[str, str]]]:
    """Give format, number of vertices and (name, numpy code) of the vertex properties."""
    layout, count, element, properties = "", -1, "", []
    try:
        for words in (line.split() for line in lines):
            if words[:1] == ["format"]:
                layout = words[1]
            elif words[:1] == ["element"]:
                if not element and words[1] != "vertex":
                    raise ValueError(f"the first element is {words[1]!r}, not 'vertex'")
                element = words[1]
                count = int(words[2]) if element == "vertex" else count
            elif words[:1] == ["property"] and element == "vertex":
                properties.append((words[2], _TYPES[words[1]]))
        if layout not in (*_FORMATS, "ascii") or count < 0 or not properties:
            raise ValueError(f"format {layout!r}, {count} vertices, {len(properties)} properties")
    except (ValueError, IndexError, KeyError) as error:
        raise PlopError(
            "The header of this PLY cannot be understood.",
            where=path,
            expected="a vertex element with number properties",
            found=str(error),
        ) from error
    return layout, count, properties


def _check_length(path: Path, expected: int, found: int, unit: str) -> None:
    if found < expected:
        raise PlopError(
            "The PLY file is truncated.",
            where=path,
            expected=f"{expected} {unit} of data",
            found=f"{found} {unit}",
            fix="Copy or write the file again.",
        )
