"""One `.npz` file of plain arrays: written whole or not at all, read by name, and never further than it reaches.

What is written is stored, not compressed: the size of the file is then what it takes in memory.
"""

from __future__ import annotations

import math
import os
import secrets
import shutil
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import scipy.sparse as sp

from ..errors import FileError, IcpError, InputError
from ..numerics.arrays import Vector, described


def as_path(value: Any) -> Path:
    """`value` as the path of a file. Raises InputError for what is none, FileError for an empty text."""
    if not isinstance(value, str | os.PathLike):
        raise InputError(f"path is {described(value)}; a text or a pathlib.Path was expected")
    if not str(value):
        raise FileError("the path is empty; the name of a file was expected")
    return Path(value)


@contextmanager
def told(path: Path, done: str) -> Iterator[None]:
    """Whatever the system or a library has to say of `path` while it is `done` becomes a FileError that names it."""
    try:
        yield
    except IcpError:
        raise
    except Exception as error:  # libraries raise what they like on damaged files, and say little
        reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
        if isinstance(error, FileNotFoundError) and done == "read":
            raise FileError(f"{path}: no such file or folder") from error
        raise FileError(f"{path}: cannot be {done} ({reason})") from error


@contextmanager
def opened(path: Path) -> Iterator[tuple[BinaryIO, int]]:
    """The file `path` for reading, and how many bytes it has. Raises FileError, for pipes and folders, too."""
    with told(path, "read"):
        if path.exists() and not path.is_file():
            raise FileError(f"{path}: is no file")
        with path.open("rb") as file:
            yield file, os.fstat(file.fileno()).st_size


def write_archive(path: Path, kind: str, arrays: dict[str, Any], *others: str) -> None:
    """The `arrays` and their `kind` in the file `path`: an interruption at any moment leaves the old file or the new.

    A file of this kind or of the `others` is replaced. Raises FileError where it cannot be written, or where another
    kind of file is in its place.
    """
    if path.suffix.lower() != ".npz":
        raise FileError(f"{path}: a file whose name ends in .npz was expected; all of it is written to one file")
    with told(path, "written"):
        check_free(path, kind, *others)
        beside = path.with_name(f".{secrets.token_hex(8)}.part")
        with beside.open("xb") as file:
            try:
                if path.exists():
                    shutil.copymode(path, beside)
                np.savez(file, format=np.array(kind), **arrays)
                file.flush()
                os.fsync(file.fileno())
                beside.replace(path)
            finally:
                beside.unlink(missing_ok=True)
        # the new name reaches the disk with its folder, where the file system can be asked for that
        with suppress(OSError):
            folder = os.open(path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)


def check_free(path: Path, *kinds: str) -> None:
    """Raise FileError where something is at `path` that must not be replaced: all but a file of these kinds."""
    if path.is_symlink():
        raise FileError(f"{path}: is a symbolic link, which is not followed; name the file behind it, or another one")
    if not os.path.lexists(path) or (path.is_file() and not path.stat().st_size):
        return
    try:
        with read_archive(path, *kinds):
            path.open("r+b").close()  # it is protected where this fails
    except FileError as error:
        raise FileError(f"{path}: is in the way; remove it, or choose another name ({error})") from error


@contextmanager
def read_archive(path: Path, *kinds: str) -> Iterator[Archive]:
    """The arrays of a file of one of the `kinds` that `write_archive` wrote, while it is open. Raises FileError for
    anything else."""
    if path.suffix.lower() != ".npz":
        raise FileError(f"{path}: a file whose name ends in .npz was expected")
    with opened(path) as (file, size):
        try:
            directory = zipfile.ZipFile(file)
        except (zipfile.BadZipFile, NotImplementedError) as error:
            raise FileError(f"{path}: not a readable .npz file, or truncated ({error})") from error
        with directory:
            archive = Archive(path, directory, size)
            if (found := archive.text("format")) not in kinds:
                raise FileError(f"{path}: field format is {found!r}; {' or '.join(map(repr, kinds))} was expected")
            yield archive


class Archive:
    """An `.npz` file of `size` bytes. A field is read when it is asked for, once its header is as it should be."""

    def __init__(self, path: Path, directory: zipfile.ZipFile, size: int) -> None:
        self.path, self.directory, self.size = path, directory, size

    def _array(self, name: str, ndim: int, kinds: str, wanted: str, size: int | None = None) -> np.ndarray:
        """The field `name`: of `ndim` axes, one of the `kinds` that NumPy has letters for, and of `size` entries."""
        found = sorted(one.removesuffix(".npy") for one in self.directory.namelist())
        if name not in found:
            raise FileError(f"{self.path}: field {name} is missing; found {', '.join(found) or 'none'}")
        about = self.directory.getinfo(f"{name}.npy")
        with self.directory.open(about) as file:
            if np.lib.format.read_magic(file) != (1, 0):
                raise FileError(f"{self.path}: field {name} is no array in version 1.0 of NumPy's format")
            shape, _, dtype = np.lib.format.read_array_header_1_0(file)
            if len(shape) != ndim or dtype.kind not in kinds or size not in (None, math.prod(shape)):
                raise FileError(f"{self.path}: field {name} has shape {shape}, dtype {dtype}; {wanted} expected")
            bytes_ = math.prod(shape) * dtype.itemsize
            if about.compress_type != zipfile.ZIP_STORED:
                raise FileError(f"{self.path}: field {name} is compressed; np.savez writes what can be read")
            if min(shape, default=0) < 0 or file.tell() + bytes_ != about.file_size or about.file_size > self.size:
                raise FileError(
                    f"{self.path}: field {name} promises {bytes_} bytes, which it does not have; truncated?"
                )
            return np.frombuffer(file.read(), dtype=dtype)

    def text(self, name: str) -> str:
        """The field `name`, a text."""
        return str(self._array(name, 0, "U", "a text")[0])

    def vector(self, name: str, size: int | None = None) -> Vector:
        """The field `name`, a vector of `size` real numbers."""
        wanted = "a vector of numbers" if size is None else f"{size} numbers"
        return self._array(name, 1, "biuf", wanted, size).astype(np.float64)

    def positions(self, name: str, size: int) -> np.ndarray:
        """The field `name`, a vector of `size` integers."""
        return self._array(name, 1, "iu", f"{size} integers", size).astype(np.int64)

    def matrix(self, name: str, n: int) -> sp.csr_array:
        """The CSR matrix of shape (n, n) in three fields."""
        data, indptr = self.vector(f"{name}_data"), self.positions(f"{name}_indptr", n + 1)
        indices = self.positions(f"{name}_indices", data.size)
        # SciPy's own check lets some of these pass and its compiled code then writes out of bounds
        ordered = indptr[0] == 0 and indptr[-1] == data.size and bool((indptr[1:] >= indptr[:-1]).all())
        if not ordered or ((indices < 0) | (indices >= n)).any():
            raise FileError(f"{self.path}: fields {name}_* are not a CSR matrix of shape ({n}, {n})")
        return sp.csr_array((data, indices, indptr), shape=(n, n))
