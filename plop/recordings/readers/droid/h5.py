"""Safe reading of foreign HDF5 files: links into other files are not followed, and missing filters are named."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import h5py

from plop.errors import PlopError

FILTERS = {
    305: "LZO",
    307: "bzip2",
    32001: "Blosc",
    32004: "LZ4",
    32008: "Bitshuffle",
    32013: "ZFP",
    32015: "Zstandard",
    32017: "SZ",
    32018: "FCIDECOMP",
    32024: "SZ3",
    32026: "Blosc2",
    32028: "SPERR",
}
"""Registered filters that are not part of HDF5, all in the package hdf5plugin except LZO."""
BUILT_IN = {4: "szip"}


def node_of(file: h5py.File, path: Path, key: str) -> h5py.Group | h5py.Dataset | None:
    """Return a readable group or data set; None where there is none.

    Args:
        file: The open file.
        path: Its path, for messages.
        key: Names joined by "/".

    Raises:
        PlopError: A link leads into another file, or a filter is missing.
    """
    node: h5py.Group | h5py.Dataset = file
    for part in key.split("/"):
        if not isinstance(node, h5py.Group):
            return None
        link = node.get(part, getlink=True)
        if isinstance(link, h5py.ExternalLink):
            raise PlopError(
                "The trajectory contains a link into another file.",
                where=f"{path}:/{key}",
                expected="data in the file itself",
                found=f"a link to {link.filename}",
                fix="Copy the data into the file: links are not followed.",
            )
        if link is None:
            return None
        node = node.get(part)
    if isinstance(node, h5py.Dataset):
        if node.external or node.is_virtual:
            raise PlopError(
                "The trajectory stores data in another file.",
                where=f"{path}:/{key}",
                expected="data in the file itself",
                found="an external or virtual data set",
                fix="Copy the data into the file: links are not followed.",
            )
        _check_filters(node, f"{path}:/{key}")
    return node


def _readable(data: h5py.Dataset) -> bool:
    """Return whether it can be read anyway: an optional filter may have been skipped."""
    try:
        data[:]
    except OSError:
        return False
    return True


def _check_filters(data: h5py.Dataset, where: str) -> None:
    """Check that a data set can be decompressed; hdf5plugin is loaded only if needed and installed."""
    created = data.id.get_create_plist()
    used = [created.get_filter(index) for index in range(created.get_nfilters())]
    missing = [used_ for used_ in used if not h5py.h5z.filter_avail(used_[0])]
    if missing and find_spec("hdf5plugin") is not None:
        import hdf5plugin  # noqa: F401  registers its filters

        missing = [used_ for used_ in missing if not h5py.h5z.filter_avail(used_[0])]
    if missing and not _readable(data):
        code, _, _, name = missing[0]
        stored = name.decode(errors="replace").split(";")[0][:40] if name else ""
        known = FILTERS.get(code) or BUILT_IN.get(code) or stored or "an unknown filter"
        fix = "pip install hdf5plugin, and run again; or" if code in FILTERS and code != 305 else "Re-write the file:"
        raise PlopError(
            "The file is compressed with a filter that is not installed.",
            where=where,
            expected="gzip or lzf, or hdf5plugin installed",
            found=f"{known} (filter {code}); the file is intact",
            fix=f"{fix} h5repack -f GZIP=1 <file> <new file> on a machine with the filter.",
        )
