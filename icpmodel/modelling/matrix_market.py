"""Read Matrix Market files of real numbers: SciPy reads the header, NumPy the lines; contradictions are errors.

SciPy's own reader of the lines takes 1,5 for 1, and ignores the rest of a line.

Reference: Boisvert, Pozo and Remington, The Matrix Market exchange formats (1996), NISTIR 5935.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import FileError
from .archive import open_to_read, table_of

_INDICES: list[tuple[str, Any]] = [("i", np.int64), ("j", np.int64)]
#: the kinds of entries, the first one in coordinates only
_FIELDS = ("pattern", "real", "integer", "unsigned-integer")
#: symmetry → a_ji / a_ij for the entries a_ij, i > j, in the file
_MIRRORED = {"general": 0, "symmetric": 1, "skew-symmetric": -1}


def read_matrix(path: Path) -> Any:
    """The matrix in a Matrix Market file, sparse if it is in coordinates, else dense. Raises FileError."""
    from scipy.io import mminfo

    with open_to_read(path) as (file, size):
        check_end(path, file, size)
        try:
            rows, columns, count, layout, field, symmetry = mminfo(path)
        except (ValueError, OverflowError) as error:
            raise FileError(f"{path}: not a readable Matrix Market file ({error})") from error
        is_dense = layout == "array"
        if field not in _FIELDS[is_dense:] or symmetry not in _MIRRORED:
            actual = f"is {layout} {field} {symmetry}"
            raise FileError(f"{path}: {actual}; real numbers, {', '.join(_MIRRORED)}, were expected")
        mirrored = _MIRRORED[symmetry]
        if mirrored and rows != columns:
            raise FileError(f"{path}: is {rows} x {columns}, and cannot be {symmetry}")
        if is_dense and mirrored:
            count = rows * (rows + mirrored) // 2
        # a line has two bytes or more, and a square matrix with fewer bytes than rows has almost no entries
        if 2 * count > size or min(rows, columns) > size:
            actual = f"its header promises {rows} x {columns} with {count} entries"
            raise FileError(f"{path}: {actual}, which do not fit into {size} bytes; is the file truncated?")
        kind = [*([] if is_dense else _INDICES), *([] if field == "pattern" else [("a", np.float64)])]
        file.seek(0)
        lines = (line for line in file if line.strip() and not line.startswith(b"%"))
        next(lines)  # the line of sizes
        numbers = table_of(path, lines, dtype=kind, ndmin=1) if count else np.empty(0, kind)
        found = numbers.size + sum(1 for _ in lines)
        if found != count:
            raise FileError(f"{path}: holds {found} entries; its header promises {count}")
    matrix = _assemble(path, (rows, columns), is_dense, mirrored, numbers)
    return matrix.toarray() if is_dense else matrix


def _assemble(path: Path, shape: tuple[int, int], is_dense: bool, mirrored: int, numbers: NDArray[Any]) -> sp.coo_array:
    """The matrix of the lines; `mirrored` times its strict lower triangle is mirrored above it. Raises FileError."""
    rows, columns = shape
    if is_dense:
        j, i = np.divmod(np.arange(numbers.size), rows) if not mirrored else np.triu_indices(rows, int(mirrored < 0))
    else:
        i, j = numbers["i"] - 1, numbers["j"] - 1
    values = numbers["a"] if "a" in (numbers.dtype.names or ()) else np.ones(numbers.size)
    outside = (i < 0) | (i >= rows) | (j < 0) | (j >= columns)
    if mirrored:
        outside |= i < j + (mirrored < 0)
    if outside.any():
        k = int(np.argmax(outside))
        part = ("", " on or below the diagonal", " below the diagonal")[mirrored]
        actual = f"has an entry at {i[k] + 1}, {j[k] + 1}"
        raise FileError(f"{path}: {actual}; places within {rows} x {columns}{part} were expected")
    matrix = sp.coo_array((values, (i, j)), shape=shape)
    return (matrix + mirrored * sp.tril(matrix, -1).T).tocoo() if mirrored else matrix


def check_end(path: Path, raw: BinaryIO, size: int) -> None:
    """Raise FileError unless the last line ends, since a truncated number is a number, too."""
    if size and (raw.seek(-1, os.SEEK_END), raw.read(1))[1] not in b"\r\n":
        raise FileError(f"{path}: its last line does not end; is the file truncated?")
    raw.seek(0)
