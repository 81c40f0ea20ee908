"""Numbers as NumPy, SciPy, MATLAB and spreadsheets write them: what a file holds, by the end of its name.

.npy    an array                    .npz    a matrix by scipy.sparse.save_npz, or arrays by numpy.savez
.mtx    a Matrix Market file        .mat    variables by MATLAB (-v6, -v7) or scipy.io.savemat
.csv    numbers, commas between     .txt    numbers, spaces between, as numpy.savetxt writes them
.bin    a matrix or vector by PETSc
"""

from __future__ import annotations

import io
import warnings
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import FileError, InputError
from ..numerics.sparse_input import checked_sparse
from ..present.whole_files import told
from .archive import NUMBERS, REAL, Archive, check_room, opened, read_archive, read_array
from .matlab import read_variables
from .matrix_market import check_end, read_matrix, read_vector
from .petsc_binary import read_petsc

#: the end of the name → what is between two numbers in a line, None for any spaces
_TEXTS = {".csv": ",", ".txt": None}
SUFFIXES = (".npy", ".npz", ".mat", ".mtx", ".bin", *_TEXTS)
#: a matrix as save_npz writes it → the fields beside data that hold its positions
_SPARSE = {
    "csr": ("indices", "indptr"),
    "csc": ("indices", "indptr"),
    "bsr": ("indices", "indptr"),
    "coo": ("row", "col"),
    "dia": ("offsets",),
}


def read_named(path: Path) -> dict[str, Any]:
    """Name → array or sparse matrix, of a file that names what it holds; "" is the name where it holds one thing only
    and does not say which. Raises FileError."""
    suffix = path.suffix.lower()
    with told(path, "read"):
        path.stat()
    if suffix == ".npz":
        with read_archive(path) as archive:
            return read_fields(archive)
    if suffix == ".mat":
        return read_variables(path)
    if suffix == ".npy":
        with opened(path) as (file, size):
            return {"": read_array(file, size, f"{path}: it", NUMBERS, _is_numbers)}
    if suffix == ".mtx":
        return {"": read_matrix(path)}
    if suffix == ".bin":
        return {"": read_petsc(path)}
    if suffix in _TEXTS:
        return {"": read_text(path)}
    raise FileError(f"{path}: a file whose name ends in one of {', '.join(SUFFIXES)} was expected")


def read_fields(archive: Archive) -> dict[str, Any]:
    """The same of an `.npz` file: the matrix by save_npz, or all arrays."""
    if "format" in archive.names:
        return {"": _sparse(archive)}
    if len(archive.names) < len(archive.directory.namelist()):  # an array that is overlooked is another problem
        raise FileError(f"{archive.path}: holds more than arrays by numpy.savez")
    return {name: archive.array(name, NUMBERS, _is_numbers, compressed=True) for name in archive.names}


def read_values(path: Path, name: str, n: int) -> Any:
    """The `n` numbers, or the only one, in a file, where they are called `name` if it names several."""
    if path.suffix.lower() == ".mtx":
        return read_vector(path, n)
    found = read_named(path)
    value = found.get(name, next(iter(found.values())) if len(found) == 1 else None)
    if value is None:
        raise FileError(f"{path}: holds {', '.join(found) or 'nothing'}; {name}, or one thing only, was expected")
    return as_values(path, value, n)


def as_values(path: Path, value: Any, n: int) -> Any:
    """`value`, which was read from `path`, as an array; no sparse matrix of another shape is made one."""
    if not sp.issparse(value):
        return value
    if sorted(value.shape) != sorted((n, 1)):
        raise FileError(f"{path}: holds a matrix of shape {value.shape}; a vector of {n} numbers was expected")
    return value.toarray()


def read_text(path: Path, heads: str = "") -> np.ndarray:
    """The table of numbers in a text file, of two axes, below the line `heads` where there is to be one."""
    between = _TEXTS[path.suffix.lower()]
    with opened(path) as (raw, size):
        check_room(str(path), 8.0 * size / 2)  # a number has a digit and what ends it
        check_end(path, raw, size)
        file = io.TextIOWrapper(raw, encoding="utf-8-sig", errors="replace")
        if heads and file.readline().strip() != heads:
            raise FileError(f"{path}: its first line is not {heads!r}")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")  # NumPy warns where there is nothing at all
                return np.loadtxt(file, delimiter=between, comments=None, ndmin=2)
        except (ValueError, Warning) as error:
            if not size:
                raise FileError(f"{path}: is empty") from error
            wanted = f"lines of numbers with {'commas' if between else 'spaces'} between, and no heads, were expected"
            raise FileError(f"{path}: {str(error).strip().rstrip('.')}; {wanted}") from error


def _is_numbers(shape: tuple[int, ...], dtype: np.dtype) -> bool:
    return len(shape) <= 2 and dtype.kind in REAL


def _sparse(archive: Archive) -> Any:
    """A matrix as `scipy.sparse.save_npz` writes it."""
    path, field = archive.path, partial(archive.field, compressed=True)
    name = field("format", "the name of a sparse format", 0, "SU").item()
    form = name.decode("ascii", "replace") if isinstance(name, bytes) else name
    if form not in _SPARSE:
        raise FileError(f"{path}: field format is {form!r}; a matrix by scipy.sparse.save_npz was expected")
    data = field("data", NUMBERS, {"bsr": 3, "dia": 2}.get(form, 1), REAL)
    shape = field("shape", "two integers", 1, "i").tolist()
    places = [field(one, "a vector of integers", 1, "iu").astype(np.int64) for one in _SPARSE[form]]
    # as in a Matrix Market file: fewer bytes than rows are a huge matrix with next to no entries
    if len(shape) != 2 or min(shape) < 0 or max(shape) > data.nbytes + sum(one.nbytes for one in places):
        raise FileError(f"{path}: has the shape {tuple(shape)}, but only {data.size} entries")
    rows, columns = shape
    parts = (data, tuple(places)) if form == "coo" else (data, *places)
    made: Any = getattr(sp, f"{form}_array")
    try:
        return checked_sparse(made(parts, shape=(rows, columns)), "it")
    except (InputError, ValueError, ZeroDivisionError) as error:
        raise FileError(
            f"{path}: its fields are no {form.upper()} matrix of shape ({rows}, {columns}): {error}"
        ) from None
