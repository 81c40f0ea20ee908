"""PETSc's binary files of one sparse matrix or one vector, as `MatView` and `VecView` write them, any rows at a time.

All is big-endian: a head of integers, of a matrix the number of entries of each row and the column of each entry, then
the numbers. Integers have 32 or 64 bits, as the PETSc that wrote the file; numbers are real, of double precision.
Reference: the manual page of MatLoad of PETSc.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import FileError
from ..numerics.arrays import Vector
from .archive import opened

#: how PETSc marks what follows
_MATRIX, _VECTOR = 1211216, 1211214
#: the head of a matrix: the mark, rows, columns, entries; of a vector: the mark, rows
_HEADS = {_MATRIX: 4, _VECTOR: 2}
_NUMBER = np.dtype(">f8")


def read_petsc(path: Path) -> Any:
    """The CSR matrix, or the vector of shape (n,), in one of PETSc's binary files. Raises FileError."""
    with opened(path) as (raw, size):
        file = PetscFile(path, raw, size)
        if not file.is_matrix:
            return file.vector(0, file.rows)
        lengths = file.lengths(0, file.rows)
        return file.matrix(lengths, 0, 0, int(lengths.sum()))


class PetscFile:
    """What the file `raw` of `size` bytes, called `path`, holds: `is_matrix` or vector, `rows`, `columns`. Raises
    FileError."""

    def __init__(self, path: Path, raw: BinaryIO, size: int) -> None:
        self.path, self._raw, self._size = path, raw, size
        marks = raw.read(8)
        wide = int.from_bytes(marks, "big") in _HEADS  # four bytes of zeros come first
        self._integer = np.dtype(">i8" if wide else ">i4")
        mark = int.from_bytes(marks if wide else marks[:4], "big")
        if mark not in _HEADS:
            raise FileError(f"{path}: is no binary file of PETSc: it does not begin with the mark of a Mat or a Vec")
        self.is_matrix, count = mark == _MATRIX, _HEADS[mark]
        self._begin = count * self._integer.itemsize
        if size < self._begin:
            raise FileError(f"{path}: ends within its head; truncated?")
        self.rows, *others = (int(x) for x in self._read(0, count, self._integer)[1:])
        self.columns, self._entries = others or (1, self.rows)
        if min(self.rows, self.columns) < 0 or self._entries < 0:
            dense = self.is_matrix and self._entries == -1
            actual = "holds a dense matrix" if dense else f"says that it has {self.rows} rows, {self.columns} columns"
            raise FileError(f"{path}: {actual}; a sparse matrix, or a vector, was expected")
        if not self.is_matrix and size != self._begin + _NUMBER.itemsize * self.rows:
            raise FileError(f"{path}: {self._but(self._begin + _NUMBER.itemsize * self.rows)}")
        if size < self._begin + self._integer.itemsize * self.rows:
            raise FileError(f"{path}: promises {self.rows} rows, which do not fit into {size} bytes; truncated?")

    def _but(self, expected: int) -> str:
        """The message on a file of another size than expected."""
        return (
            f"has {self._size} bytes where one real {'sparse matrix' if self.is_matrix else 'vector'} of double "
            f"precision with {self.rows} rows has {expected}; truncated, of another precision, or more than one object?"
        )

    def _read(self, begin: int, count: int, kind: np.dtype) -> NDArray[Any]:
        """`count` numbers from the byte `begin` on."""
        self._raw.seek(begin)
        numbers = np.frombuffer(self._raw.read(count * kind.itemsize), kind)
        if numbers.size != count:
            raise FileError(f"{self.path}: ends within its numbers; truncated?")
        return numbers.astype(kind.newbyteorder("="))

    def vector(self, low: int, high: int) -> Vector:
        """The entries low ≤ i < high."""
        return self._read(self._begin + low * _NUMBER.itemsize, high - low, _NUMBER)

    def lengths(self, low: int, high: int) -> NDArray[np.int64]:
        """How many entries the rows low ≤ i < high have."""
        begin = self._begin + low * self._integer.itemsize
        counts = self._read(begin, high - low, self._integer).astype(np.int64)
        if (counts < 0).any() or (counts > self.columns).any():
            i = int(np.argmax((counts < 0) | (counts > self.columns)))
            raise FileError(f"{self.path}: row {low + i} has {counts[i]} entries, and there are {self.columns} columns")
        return counts

    def matrix(self, lengths: NDArray[np.int64], low: int, before: int, total: int) -> sp.csr_array:
        """The rows from `low` on, which have these `lengths`; `before` them are so many entries, of the `total`."""
        wide = self._integer.itemsize
        places = self._begin + wide * self.rows
        values = places + wide * total
        # of more entries than its integers can count PETSc writes the largest of them
        if min(total, np.iinfo(self._integer).max) != self._entries:
            raise FileError(f"{self.path}: has rows with {total} entries, and says that there are {self._entries}")
        if self._size != values + _NUMBER.itemsize * total:
            raise FileError(f"{self.path}: {self._but(values + _NUMBER.itemsize * total)}")
        count = int(lengths.sum())
        columns = self._read(places + wide * before, count, self._integer)
        if count and (columns.min() < 0 or columns.max() >= self.columns):
            k = int(np.argmax((columns < 0) | (columns >= self.columns)))
            row = low + int(np.searchsorted(np.cumsum(lengths), k, side="right"))
            raise FileError(f"{self.path}: row {row} has an entry in column {columns[k]} of {self.columns}")
        data = self._read(values + _NUMBER.itemsize * before, count, _NUMBER)
        matrix = sp.csr_array((data, columns, np.r_[0, np.cumsum(lengths)]), shape=(lengths.size, self.columns))
        matrix.sum_duplicates()
        return matrix
