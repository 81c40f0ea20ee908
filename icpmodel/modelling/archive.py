"""Arrays in files: read whole, checked, and never unpickled; and `.npz` files, written whole or not at all."""

from __future__ import annotations

import io
import os
import struct
import warnings
import zipfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import scipy.sparse as sp

from ..errors import FileError, InputError
from ..numerics import work
from ..numerics.sparse_input import checked_sparse
from ..present.whole_files import check_replaceable, check_suffix, file_errors, write_whole

#: NumPy's letters for the kinds of real numbers
REAL_KINDS = "biuf"
#: the last record of an archive; its fifth field is the number of entries, and a comment may follow it
_DIRECTORY_END = struct.Struct("<4s4H2LH")
#: the suffixes of the three fields of a sparse matrix
_CSR = ("data", "indices", "indptr")


@contextmanager
def open_to_read(path: Path, shares: int = 1) -> Iterator[tuple[BinaryIO, int]]:
    """Open the file `path`, to read one of its `shares` equal parts; yields it and its size in bytes.

    Raises FileError, also for pipes and folders, or if the part exceeds the free memory.
    """
    with file_errors(path, "read"):
        if path.exists() and not path.is_file():
            raise FileError(f"{path}: is {'a folder' if path.is_dir() else 'no file'}; a file was expected")
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            check_room(str(path), size / shares)
            yield file, size


@contextmanager
def content_errors(path: Path | None) -> Iterator[None]:
    """Turn an InputError about the content of the file `path`, unless this is None, into a FileError that names it."""
    try:
        yield
    except InputError as error:
        if path is None:
            raise
        raise FileError(f"{path}: {error}") from error


def check_room(what: str, size: float) -> None:
    """Raise FileError if `what`, whose size in bytes is `size`, exceeds the free memory."""
    if not work.memory_suffices(size):
        raise FileError(f"{what} takes {1e-9 * size:.3g} GB of memory, more than is free")


def array_of(content: bytes, name: str) -> np.ndarray:
    """The array of numbers, or the text, in `content` in NumPy's format. Raises FileError, which calls it `name`."""
    file = io.BytesIO(content)
    try:
        array: np.ndarray = np.lib.format.read_array(file, allow_pickle=False)
    except (ValueError, EOFError, MemoryError, UnicodeError) as error:
        raise FileError(f"{name} is no array by NumPy, or truncated: {error}") from error
    if array.dtype.kind not in REAL_KINDS + "SU" or file.read(1):
        raise FileError(f"{name} has shape {array.shape}, dtype {array.dtype}; numbers, or a text, were expected")
    return array


def table_of(path: Path, lines: Iterable[Any], expected: str = "numbers", **options: Any) -> np.ndarray:
    """The numbers in the `lines` of a file, by NumPy with these `options`. Raises FileError."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # NumPy warns of empty input
            table: np.ndarray = np.loadtxt(lines, comments=None, **options)
    except (ValueError, Warning) as error:
        actual = str(error).strip().rstrip(".") if isinstance(error, ValueError) else "holds no numbers"
        raise FileError(f"{path}: {actual}; {expected} were expected") from error
    return table


def read_arrays(path: Path) -> dict[str, Any]:
    """The arrays and CSR matrices of an `.npz` file by name. Raises FileError."""
    if path.suffix.lower() != ".npz":
        raise FileError(f"{path}: a file name that ends in .npz was expected")
    with open_to_read(path) as (file, size), zipfile.ZipFile(file) as archive:
        entries = archive.infolist()
        check_room(str(path), sum(one.file_size for one in entries))
        file.seek(size - _DIRECTORY_END.size)
        mark, _, _, _, count, *_ = _DIRECTORY_END.unpack(file.read(_DIRECTORY_END.size))
        # a damaged entry can swallow the next one, which zipfile does not notice
        if mark == b"PK\5\6" and count not in (len(entries), 0xFFFF):
            raise FileError(f"{path}: does not have the number of fields in its directory; is it damaged?")
        arrays: dict[str, Any] = {}
        for one in entries:
            name = one.filename.removesuffix(".npy")
            with archive.open(one) as entry:  # at most the stated size: a small file could unpack to a large one
                arrays[name] = array_of(entry.read(one.file_size + 1), f"{path}: field {name}")
    for name in [name.removesuffix("_indptr") for name in arrays if name.endswith("_indptr")]:
        arrays[name] = _matrix(path, name, arrays)
    return arrays


def _matrix(path: Path, name: str, fields: dict[str, Any]) -> sp.csr_array:
    """The square CSR matrix `name`; its three fields are removed from `fields`. Raises FileError."""
    parts = [fields.pop(f"{name}_{part}", np.empty((0, 0))) for part in _CSR]
    data, indices, indptr = parts
    n = indptr.size - 1
    kinds = [one.dtype.kind in allowed for one, allowed in zip(parts, (REAL_KINDS, "iu", "iu"), strict=True)]
    try:
        if not all(kinds):
            raise ValueError
        places = indices.astype(np.int64), indptr.astype(np.int64)
        matrix = checked_sparse(sp.csr_array((data.astype(np.float64), *places), shape=(n, n)), name)
        if matrix.nnz < data.size:  # SciPy drops entries behind the last row
            raise ValueError
        return matrix
    except ValueError:
        raise FileError(f"{path}: fields {name}_* are not a square CSR matrix") from None


def text_of(path: Path, fields: dict[str, Any], name: str) -> str:
    """The text in the field `name`, or "" if there is none. Raises FileError."""
    with file_errors(path, "read"):  # for invalid characters
        return str(fields[name]) if name in fields and fields[name].dtype.kind == "U" else ""


def check_kind(path: Path, fields: dict[str, Any], kind: str) -> None:
    """Raise FileError unless the field format says that the file is of this `kind`."""
    actual = text_of(path, fields, "format")
    if actual != kind:
        raise FileError(f"{path}: field format is {actual!r}; {kind!r} was expected")


def write_arrays(path: Path, kind: str, arrays: dict[str, Any]) -> None:
    """Write the `arrays`, matrices as CSR, and their `kind` to the file `path`; only a file of this kind is replaced.

    Raises FileError where it cannot be written.
    """
    check_suffix(path, (".npz",))
    fields: dict[str, Any] = {"format": np.array(kind)}
    for name, one in arrays.items():
        if sp.issparse(one):
            fields |= {f"{name}_{part}": getattr(one, part) for part in _CSR}
        else:
            fields[name] = one
    write_whole(path, lambda file: np.savez(file, **fields), lambda: check_free(path, kind))


def check_free(path: Path, kind: str) -> None:
    """Raise FileError if something else than a file of this `kind`, which may be replaced, is at `path`."""
    check_replaceable(path, lambda: check_kind(path, read_arrays(path), kind))
