"""Read numbers in files of NumPy, SciPy, MATLAB, PETSc and spreadsheets, by the suffix of the file.

- .npy: an array
- .npz: a matrix by scipy.sparse.save_npz, or arrays by numpy.savez
- .mtx: a Matrix Market file
- .mat: variables by MATLAB (-v6, -v7) or scipy.io.savemat
- .csv: numbers with commas between
- .txt: numbers with spaces between, as numpy.savetxt writes them
- .bin: a matrix or vector by PETSc
"""

from __future__ import annotations

import io
from collections.abc import Callable
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import FileError
from ..numerics.sparse_input import checked_sparse
from ..present.whole_files import file_errors
from .archive import REAL_KINDS, array_of, check_room, content_errors, open_to_read, read_arrays, table_of
from .matlab import read_variables
from .matrix_market import check_end, read_matrix
from .petsc_binary import read_petsc


def _of_npz(path: Path) -> Any:
    """The matrix by scipy.sparse.save_npz, or all arrays; a file of this package has `format`, but not `data`."""
    fields = read_arrays(path)
    if "format" not in fields:
        return {name: checked_numbers(path, name, one) for name, one in fields.items()}
    if "data" not in fields:  # what it may hold depends on the kind
        return fields
    size = sum(one.nbytes for one in fields.values())
    with file_errors(path, "read"), content_errors(path):
        # fewer bytes than rows: a huge matrix with almost no entries
        if np.max(fields.get("shape", 0), initial=0) > size:
            raise FileError(f"{path}: has the shape {tuple(fields['shape'].tolist())}, but only {size} bytes")
        return checked_sparse(sp.load_npz(path), "it").astype(np.float64)


def checked_numbers(path: Path, name: str, value: Any) -> Any:
    """`value`, if it is a matrix, a vector or a number. Raises FileError otherwise."""
    if sp.issparse(value) or (value.ndim <= 2 and value.dtype.kind in REAL_KINDS):
        return value
    raise FileError(f"{path}: {name} has shape {value.shape}, dtype {value.dtype}; an array of real numbers expected")


def read_values(path: Path, name: str, n: int) -> Any:
    """The `n` numbers, or the only one, in a file; of several variables the one called `name`. Raises FileError."""
    arrays = read_named(path)
    value = arrays.get(name, next(iter(arrays.values())) if len(arrays) == 1 else None)
    if value is None:
        raise FileError(f"{path}: holds {', '.join(arrays) or 'nothing'}; {name}, or one thing only, was expected")
    return as_values(path, value, n)


def as_values(path: Path, value: Any, n: int) -> Any:
    """`value`, read from `path`, as an array. Raises FileError for a sparse matrix that is not a vector of size `n`."""
    if not sp.issparse(value):
        return value
    if sorted(value.shape) != sorted((n, 1)):
        raise FileError(f"{path}: holds a matrix of shape {value.shape}; a vector of {n} numbers was expected")
    return value.toarray()


def _has_names(line: str, between: str | None) -> bool:
    """Whether every cell of the line begins with a letter, and is neither "nan" nor "inf"."""
    cells = [cell.strip(" \"'\n").lower() for cell in line.split(between)]
    return all(cell[:1].isalpha() and cell not in ("nan", "inf", "infinity") for cell in cells)


def read_text(path: Path, heads: str = "") -> np.ndarray:
    """The 2-D table of numbers in a text file, below the line `heads` or, if there is one, a line of names."""
    between = "," if path.suffix.lower() == ".csv" else None
    with open_to_read(path) as (raw, size):
        check_room(str(path), 8.0 * size / 2)  # a number has a digit and a separator
        check_end(path, raw, size)
        if not size:
            raise FileError(f"{path}: is empty")
        file = io.TextIOWrapper(raw, encoding="utf-8-sig", errors="replace")
        first = file.readline()
        if heads and first.strip() != heads:
            raise FileError(f"{path}: its first line is not {heads!r}")
        lines = file if heads or _has_names(first, between) else chain([first], file)
        expected = f"numbers with {'commas' if between else 'spaces'} between, and names in the first line at most,"
        return table_of(path, lines, expected, delimiter=between, ndmin=2)


def _of_npy(path: Path) -> Any:
    with open_to_read(path) as (file, _):
        return checked_numbers(path, "it", array_of(file.read(), f"{path}: it"))


#: suffix → reader
_READERS: dict[str, Callable[[Path], Any]] = {
    ".npy": _of_npy,
    ".npz": _of_npz,
    ".mat": read_variables,
    ".mtx": read_matrix,
    ".bin": read_petsc,
    ".csv": read_text,
    ".txt": read_text,
}
SUFFIXES = tuple(_READERS)


def read_named(path: Path) -> dict[str, Any]:
    """Name → array or sparse matrix in a file; "" is the name in files that hold one value without a name.

    Raises FileError.
    """
    with file_errors(path, "read"):
        path.stat()
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise FileError(f"{path}: a file name that ends in one of {', '.join(SUFFIXES)} was expected")
    content = reader(path)
    return content if isinstance(content, dict) else {"": content}
