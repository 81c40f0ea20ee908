"""Read any rows of PETSc's binary files of one sparse matrix or one vector, as `MatView` and `VecView` write them.

All is big-endian: a header of integers; for a matrix, the number of entries of each row and the column of each entry;
then the numbers. Integers have 32 or 64 bits, as in the PETSc that wrote the file; numbers are real, of double
precision. NumPy maps the arrays to memory, so that a process reads only what it uses.

Reference: the manual page of MatLoad of PETSc.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import FileError
from ..numerics.arrays import Vector
from .archive import open_to_read

#: PETSc's mark of a matrix, and mark → number of integers in the header, for a matrix and a vector
_MATRIX = 1211216
_HEADS = {_MATRIX: 4, 1211214: 2}
_NUMBER = np.dtype(">f8")


def read_petsc(path: Path) -> Any:
    """The CSR matrix, or the vector of shape (n,), in one of PETSc's binary files. Raises FileError."""
    file = PetscFile(path)
    return file.matrix(0, file.rows) if file.is_matrix else file.vector(0, file.rows)


class PetscFile:
    """One binary file, `size` bytes: a matrix if `is_matrix`, else a vector; `rows` × `columns`. Raises FileError.

    Parameters
    ----------
    path : Path
        The file.
    shares : int
        How many processes read it, each its rows.
    """

    def __init__(self, path: Path, shares: int = 1) -> None:
        with open_to_read(path, shares) as (file, self.size):
            content: Any = np.memmap(file, np.uint8, "r") if self.size else np.empty(0, np.uint8)
        # integers of 64 bits: the first four bytes of the mark are 0
        integer = np.dtype(">i4" if content[:4].any() else ">i8")
        head = content[: 4 * integer.itemsize].copy()
        numbers = head[: head.size // integer.itemsize * integer.itemsize].view(integer).tolist()
        count = _HEADS.get(numbers[0] if numbers else 0)
        if count is None or len(numbers) < count:
            raise FileError(f"{path}: is no binary file of PETSc: it does not begin with the head of a Mat or a Vec")
        self.path = path
        self.is_matrix = numbers[0] == _MATRIX
        self.rows: int = numbers[1]
        self.columns: int = numbers[2] if self.is_matrix else 1
        entries: int = numbers[3] if self.is_matrix else self.rows
        if min(self.rows, self.columns, entries) < 0:
            actual = f"has the head {', '.join(map(str, numbers[:count]))}"
            raise FileError(f"{path}: {actual}; one of a sparse matrix, or of a vector, was expected")
        begin = after = count * integer.itemsize
        if self.is_matrix:
            after += self.rows * integer.itemsize
            self._check_size(after, self.size >= after)
            self.lengths = content[begin:after].view(integer)
            self._check_lengths()
            total = int(self.lengths.sum(dtype=np.int64))
            # where its integers cannot count the entries PETSc writes the largest integer
            if min(total, np.iinfo(integer).max) != entries:
                raise FileError(f"{path}: has rows with {total} entries, and says that there are {entries}")
            entries = total
            begin = after
            after += entries * integer.itemsize
        end = after + entries * _NUMBER.itemsize
        self._check_size(end, self.size == end)
        self._places = content[begin:after].view(integer)
        self._numbers = content[after:].view(_NUMBER)

    def _check_lengths(self) -> None:
        outside = (self.lengths < 0) | (self.lengths > self.columns)
        if outside.any():
            i = int(np.argmax(outside))
            actual = f"row {i} has {self.lengths[i]} entries, and there are {self.columns} columns"
            raise FileError(f"{self.path}: {actual}")

    def _check_size(self, expected: int, is_right: bool) -> None:
        if not is_right:
            kind = "sparse matrix" if self.is_matrix else "vector"
            raise FileError(
                f"{self.path}: has {self.size} bytes where one real {kind} of double precision with {self.rows} rows "
                f"has {expected} or more; truncated, of another precision, or more than one object?"
            )

    def vector(self, low: int, high: int) -> Vector:
        """The entries low ≤ i < high."""
        return self._numbers[low:high].astype(np.float64)

    def matrix(self, low: int, high: int) -> sp.csr_array:
        """The rows low ≤ i < high, with all columns."""
        starts = np.append(0, np.cumsum(self.lengths[low:high], dtype=np.int64))
        before = int(self.lengths[:low].sum(dtype=np.int64))
        entries = slice(before, before + int(starts[-1]))
        places = self._places[entries].astype(np.int64)
        outside = (places < 0) | (places >= self.columns)
        if outside.any():
            k = int(np.argmax(outside))
            row = low + int(np.searchsorted(starts, k, side="right")) - 1
            raise FileError(f"{self.path}: row {row} has an entry in column {places[k]} of {self.columns}")
        values = self._numbers[entries].astype(np.float64)
        matrix = sp.csr_array((values, places, starts), shape=(high - low, self.columns))
        matrix.sum_duplicates()
        return matrix
