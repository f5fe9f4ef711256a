"""An HDF5 file that is complete or absent, also when the disk is full.

HDF5 itself does not handle a full disk: every object that is closed later fails again, the failures
are printed, and the process may end in a segmentation fault. So it writes through a Python file that
stores the first error; the error is raised from here, as one clear message.
"""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import Self

import h5py

from plop.artifacts.atomic_file import scratch_of
from plop.errors import PlopError


class AtomicHdf5:
    """Write under a scratch name, rename it on `commit`, leave nothing on `discard`.

    As a context manager it commits when the block succeeds, and discards otherwise.

    Args:
        path: Where the file goes; its folder is made.

    Raises:
        PlopError: The file cannot be made.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._scratch = scratch_of(self.path)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._disk = _PatientFile(self._scratch)
        except OSError as error:
            raise self._explained(error) from error
        self.file = h5py.File(self._disk, "w")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.commit()
        else:
            self.discard()

    def check(self) -> None:
        """Raise PlopError, and discard the file, if a write has failed so far."""
        if self._disk.error is not None:
            error = self._disk.error
            self.discard()
            raise self._explained(error) from error

    def commit(self) -> None:
        """Close the file and give it its name.

        Raises:
            PlopError: Something could not be written; nothing is left.
        """
        self.file.close()
        self._disk.sync()
        self.check()
        self._disk.close()
        try:
            os.replace(self._scratch, self.path)
        except OSError as error:
            self.discard()
            raise self._explained(error) from error

    def discard(self) -> None:
        """Close the file and delete it, unless it was committed; may be called repeatedly."""
        if self.file.id.valid:
            self.file.close()
        self._disk.close()
        self._scratch.unlink(missing_ok=True)

    def _explained(self, error: OSError) -> PlopError:
        return PlopError(
            "The file cannot be written.",
            where=self.path,
            expected="a writable disk with free space",
            found=error.strerror or str(error),
            fix="Free some space or choose another folder, then run the same command again.",
        )


class _PatientFile(io.RawIOBase):
    """A file that stores its first failed write instead of raising it, and ignores later writes."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("w+b", buffering=0)
        self.error: OSError | None = None

    def readable(self) -> bool:
        return True

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        count = self._file.readinto(buffer) or 0
        if self.error is not None:
            buffer[count:] = bytes(len(buffer) - count)
            return len(buffer)
        return count

    def write(self, data: memoryview) -> int:  # type: ignore[override]
        left = memoryview(data).cast("B")
        size = len(left)
        try:
            while len(left) and self.error is None:
                left = left[self._file.write(left) :]
        except OSError as error:
            self.error = error
        return size

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        return self._file.tell()

    def truncate(self, size: int | None = None) -> int:
        try:
            return self._file.truncate(size)
        except OSError as error:
            self.error = self.error or error
            return size or 0

    def sync(self) -> None:
        """Check that everything was written to the disk."""
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            self.error = self.error or error

    def close(self) -> None:
        if not self._file.closed:
            self._file.close()
        super().close()
