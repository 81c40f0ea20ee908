"""One `.npz` file of plain arrays: written whole or not at all, read by name, and never further than it reaches.

What is written is stored, not compressed: the size of the file is then what it takes in memory.
"""

from __future__ import annotations

import math
import os
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, BinaryIO

import numpy as np
import scipy.sparse as sp

from ..errors import FileError
from ..numerics import work
from ..numerics.arrays import Vector
from ..numerics.sparse_input import is_compressed
from ..present.whole_files import check_replaceable, check_suffix, told, write_whole

#: what NumPy calls the kinds of real numbers, and what such an array is called here
REAL, NUMBERS = "biuf", "an array of real numbers"
#: the last character that there is
_LAST = 0x10FFFF
#: the bytes of the last record of an archive, which has the number of its entries; more where there is a comment
_END = 22


@contextmanager
def opened(path: Path, shares: int = 1) -> Iterator[tuple[BinaryIO, int]]:
    """The file `path` for reading, and how many bytes it has, of which one of so many `shares` is read. Raises
    FileError, for pipes and folders, too."""
    with told(path, "read"):
        if path.exists() and not path.is_file():
            raise FileError(f"{path}: is {'a folder' if path.is_dir() else 'no file'}; a file was expected")
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            check_room(str(path), size / shares)
            yield file, size


def check_room(what: str, size: float) -> None:
    """Raise FileError where `what`, of so many bytes, is more than the machine has free."""
    if not work.fits(size):
        raise FileError(f"{what} takes {1e-9 * size:.3g} GB of memory, which is more than there is free")


def read_array(file: IO[bytes], size: int, what: str, wanted: str, fits: Callable[..., bool]) -> np.ndarray:
    """The array in NumPy's format, `size` bytes in all, that `file` holds; `what` is how messages call it.

    Before it is read, its shape and its dtype must be what `fits`, which is `wanted`. Objects are never read.
    """
    if np.lib.format.read_magic(file) != (1, 0):
        raise FileError(f"{what} is no array in version 1.0 of NumPy's format")
    shape, in_columns, dtype = np.lib.format.read_array_header_1_0(file)
    if dtype.hasobject or not fits(shape, dtype):
        raise FileError(f"{what} has shape {shape}, dtype {dtype}; {wanted} expected")
    promised = math.prod(shape) * dtype.itemsize
    if min(shape, default=0) < 0 or file.tell() + promised != size:
        raise FileError(f"{what} promises {promised} bytes, which it does not have; truncated?")
    check_room(what, promised)
    content, letters = file.read(), np.dtype("u4").newbyteorder(dtype.byteorder)
    if dtype.kind == "U" and np.frombuffer(content, letters).max(initial=0) > _LAST:
        raise FileError(f"{what} holds characters that there are not; damaged?")
    return np.frombuffer(content, dtype=dtype).reshape(shape, order="F" if in_columns else "C")


def write_archive(path: Path, kind: str, arrays: dict[str, Any], *others: str) -> None:
    """The `arrays` and their `kind` in the file `path`; a file of this kind or of the `others` is replaced. Raises
    FileError where it cannot be written, or where another kind of file is in its place."""
    check_suffix(path, (".npz",))

    def write(file: BinaryIO) -> None:
        np.savez(file, format=np.array(kind), **arrays)

    write_whole(path, write, lambda: check_free(path, kind, *others))


def check_free(path: Path, *kinds: str) -> None:
    """Raise FileError where something is at `path` that must not be replaced: all but an archive of these kinds."""

    def recognise() -> None:
        with read_archive(path, *kinds):
            pass

    check_replaceable(path, recognise)


@contextmanager
def read_archive(path: Path, *kinds: str) -> Iterator[Archive]:
    """The arrays of an `.npz` file of one of the `kinds`, while it is open; of any kind where none is named. Raises
    FileError for anything else."""
    if path.suffix.lower() != ".npz":
        raise FileError(f"{path}: a file whose name ends in .npz was expected")
    with opened(path) as (file, size):
        try:
            directory = zipfile.ZipFile(file)
        except (zipfile.BadZipFile, NotImplementedError) as error:
            raise FileError(f"{path}: not a readable .npz file, or truncated ({error})") from error
        with directory:
            file.seek(size - _END)
            end = file.read(_END)
            # a damaged entry can swallow the next one, which zipfile does not notice
            if end[:4] == b"PK\5\6" and int.from_bytes(end[10:12], "little") not in (len(directory.namelist()), 0xFFFF):
                raise FileError(f"{path}: does not have as many fields as it says; damaged?")
            archive = Archive(path, directory, size)
            if kinds:
                archive.check(*kinds)
            yield archive


class Archive:
    """An `.npz` file of `size` bytes. A field is read when it is asked for, once its header is as it should be."""

    def __init__(self, path: Path, directory: zipfile.ZipFile, size: int) -> None:
        self.path, self.directory, self.size = path, directory, size
        self.names = sorted(one.removesuffix(".npy") for one in directory.namelist() if one.endswith(".npy"))

    @property
    def is_ours(self) -> bool:
        """Whether it says what it is as those by `write_archive` do, and not as SciPy's matrices."""
        return "format" in self.names and "data" not in self.names

    def check(self, *kinds: str) -> None:
        """Raise FileError unless it is of one of the `kinds`."""
        if (found := self.text("format")) not in kinds:
            raise FileError(f"{self.path}: field format is {found!r}; {' or '.join(map(repr, kinds))} was expected")

    def array(self, name: str, wanted: str, fits: Callable[..., bool], *, compressed: bool = False) -> np.ndarray:
        """The field `name`, whose shape and dtype must be what `fits`; it may be `compressed` where that is said."""
        if name not in self.names:
            raise FileError(f"{self.path}: field {name} is missing; found {', '.join(self.names) or 'none'}")
        what, about = f"{self.path}: field {name}", self.directory.getinfo(f"{name}.npy")
        stored = about.compress_type == zipfile.ZIP_STORED
        if not (stored or compressed):
            raise FileError(f"{what} is compressed; np.savez writes what can be read")
        with self.directory.open(about) as file:
            # of what is stored there is no more than the file has
            size = about.file_size if not stored or about.file_size <= self.size else -1
            return read_array(file, size, what, wanted, fits)

    def field(
        self, name: str, wanted: str, ndim: int, kinds: str, size: int | None = None, *, compressed: bool = False
    ) -> np.ndarray:
        """The field `name`: of `ndim` axes, one of the `kinds` that NumPy has letters for, and of `size` entries."""
        right = lambda shape, dtype: (  # noqa: E731
            len(shape) == ndim and dtype.kind in kinds and size in (None, math.prod(shape))
        )
        return self.array(name, wanted, right, compressed=compressed)

    def text(self, name: str) -> str:
        """The field `name`, a text."""
        return str(self.field(name, "a text", 0, "U"))

    def vector(self, name: str, size: int | None = None) -> Vector:
        """The field `name`, a vector of `size` real numbers."""
        wanted = "a vector of numbers" if size is None else f"{size} numbers"
        return self.field(name, wanted, 1, REAL, size).astype(np.float64)

    def positions(self, name: str, size: int) -> np.ndarray:
        """The field `name`, a vector of `size` integers."""
        return self.field(name, f"{size} integers", 1, "iu", size).astype(np.int64)

    def matrix(self, name: str, n: int) -> sp.csr_array:
        """The CSR matrix of shape (n, n) in three fields."""
        data, indptr = self.vector(f"{name}_data"), self.positions(f"{name}_indptr", n + 1)
        indices = self.positions(f"{name}_indices", data.size)
        if not is_compressed(indptr, indices, n, n):
            raise FileError(f"{self.path}: fields {name}_* are not a CSR matrix of shape ({n}, {n})")
        return sp.csr_array((data, indices, indptr), shape=(n, n))
