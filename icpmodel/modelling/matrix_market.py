"""Matrices and vectors from Matrix Market files, whatever these claim to hold."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import FileError
from ..numerics.arrays import Vector

#: a sparse vector may claim any length in a few bytes
_LONGEST_VECTOR = 10**9


def read_matrix(path: Path) -> Any:
    """A sparse or dense matrix from a Matrix Market file. Raises FileError."""
    from scipy.io import mminfo, mmread

    if not path.is_file():
        raise FileError(f"{path}: no such file")
    try:
        path.open("rb").close()  # says so if it may not be read; SciPy would call its banner missing
        # SciPy allocates what the header promises
        rows, columns, entries, *_ = mminfo(path)
        if entries <= path.stat().st_size or path.suffix in (".gz", ".bz2"):
            return mmread(path, spmatrix=False)
    except PermissionError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror})") from error
    except (ValueError, OverflowError, OSError, EOFError) as error:
        raise FileError(f"{path}: not a readable Matrix Market file ({error})") from error
    raise FileError(
        f"{path}: its header promises {rows} x {columns} with {entries} entries, which do not fit into "
        f"{path.stat().st_size} bytes; is the file truncated?"
    )


def read_vector(path: Path) -> Vector:
    """A vector, shape (n,), from a Matrix Market file of n × 1 or 1 × n. Raises FileError."""
    matrix = read_matrix(path)
    if 1 not in matrix.shape:
        raise FileError(f"{path}: holds a matrix of shape {matrix.shape}; a vector (n x 1) was expected")
    if sp.issparse(matrix):
        if max(matrix.shape) > _LONGEST_VECTOR:
            raise FileError(
                f"{path}: holds a vector of shape {matrix.shape}; at most {_LONGEST_VECTOR} entries are read"
            )
        matrix = matrix.toarray()
    return np.asarray(matrix).reshape(-1)
