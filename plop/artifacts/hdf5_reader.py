"""An HDF5 file of a known layout, read lazily."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, Self

import h5py

from plop.errors import PlopError


class Hdf5Reader:
    """Open a file and check its schema; use as a context manager or call `close`.

    Args:
        path: The file.

    Raises:
        PlopError: It is missing, damaged, of another schema, or incomplete.
    """

    noun: ClassVar[str]
    """Name of such a file in errors."""
    schema: ClassVar[int]
    """Its attribute `schema`."""
    maker: ClassVar[str]
    """How to make it again."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        if not self.path.is_file():
            raise PlopError(
                f"There is no such {self.noun}.",
                where=self.path,
                expected=f"an HDF5 {self.noun}",
                found="no file",
                fix=f"{self.maker}, or correct the path.",
            )
        try:
            self._file = h5py.File(self.path, "r")
        except OSError as error:
            raise PlopError(
                f"The {self.noun} cannot be opened.",
                where=self.path,
                expected="a complete HDF5 file",
                found=str(error),
                fix=f"{self.maker} again.",
            ) from error
        try:
            self._check_schema()
            self._check()
        except BaseException:
            self._file.close()
            raise

    def _check_schema(self) -> None:
        schema = int(self._file.attrs.get("schema", -1))
        if schema != self.schema:
            fix = "Update plop." if schema > self.schema else f"{self.maker} again."
            raise PlopError(
                f"The {self.noun} has another schema.",
                where=self.path,
                expected=f"schema {self.schema}",
                found=f"schema {schema}",
                fix=fix,
            )

    def _check(self) -> None:
        """Raise PlopError when a required part of such a file is missing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class EpisodeFile(Hdf5Reader):
    """A file with what cameras see of one episode."""

    @property
    def name(self) -> str:
        """Name of the episode."""
        return str(self._file.attrs["name"])

    @property
    def environment(self) -> str:
        """Name of the environment that the episode belongs to, e.g. "prism-jelly"."""
        return str(self._file.attrs["environment"])

    @property
    def camera_names(self) -> list[str]:
        """Names of the cameras, sorted."""
        return sorted(self._file["cameras"])
