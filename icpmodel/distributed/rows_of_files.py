"""Read matrices and vectors from files, each rank a part.

Of a Matrix Market file each rank reads a range of bytes, and PETSc sends the entries to the ranks that own them. Of a
binary file of PETSc each rank reads its own rows.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import scipy.sparse as sp

from ..errors import FileError
from ..modelling.archive import opened
from ..modelling.matrix_market import MarketHead, Places, check_count, check_end, entries_of, market_head, numbers_of
from ..modelling.petsc_binary import PetscFile
from ..numerics.arrays import Vector
from .distributed_matrix import from_rows
from .ranks import petsc, together

#: the ends of the names of files that can be read in parts
PARTED = (".mtx", ".bin")


def matrix_in(path: Path, comm: Any) -> Any:
    """The `Mat`, n × n, in the file `path`. Collective. Raises FileError on all ranks."""
    if path.suffix.lower() == ".bin":
        return _petsc_matrix(path, comm)
    head, i, j, values = _market(path, comm, None)
    with together(comm):
        _check_square(path, head.rows, head.columns)
    return _assembled(comm, head.rows, i, j, values)


def vector_in(path: Path, mat: Any) -> Vector:
    """The entries, for the rows of `mat` that this rank has, of the vector in the file `path`. Collective. Raises
    FileError on all ranks."""
    (low, high) = mat.getOwnershipRange()
    n = mat.getSize()[0]
    comm = mat.comm.tompi4py()
    if path.suffix.lower() == ".bin":
        with together(comm), opened(path, comm.size) as (raw, size):
            file = PetscFile(path, raw, size)
            if file.is_matrix or file.rows != n:
                actual = f"a matrix with {file.rows} rows" if file.is_matrix else f"a vector of {file.rows} numbers"
                raise FileError(f"{path}: holds {actual}; a vector of {n} numbers was expected")
            own = file.vector(low, high)
        return own
    _, i, j, values = _market(path, comm, n)
    vector = mat.createVecLeft()
    vector.set(0.0)
    # one of i and j is 0
    vector.setValues((i + j).astype(petsc().IntType), values, addv=petsc().InsertMode.ADD_VALUES)
    vector.assemble()
    own = vector.array.copy()
    return own


def _check_square(path: Path, rows: int, columns: int) -> None:
    if rows != columns or not rows:
        raise FileError(f"{path}: the matrix has shape ({rows}, {columns}); a square matrix was expected")


def _check_same(path: Path, comm: Any, seen: Any) -> None:
    """Raise FileError on all ranks where they do not see the same file. Collective."""
    first = comm.bcast(seen)
    with together(comm):
        if seen != first:
            raise FileError(f"{path}: is not the same file as on rank 0; one that all ranks see was expected")


def _petsc_matrix(path: Path, comm: Any) -> Any:
    PETSc = petsc()
    with together(comm), opened(path, comm.size) as (raw, size):
        file = PetscFile(path, raw, size)
        if not file.is_matrix:
            raise FileError(f"{path}: holds a vector; a matrix was expected")
        _check_square(path, file.rows, file.columns)
    _check_same(path, comm, (file.rows, size))
    low, high = PETSc.Vec().createMPI(file.rows, comm=comm).getOwnershipRange()
    with together(comm), opened(path, comm.size) as (raw, size):
        lengths = PetscFile(path, raw, size).lengths(low, high)
    count = int(lengths.sum())
    before = comm.exscan(count) or 0
    total = comm.allreduce(count)
    with together(comm), opened(path, comm.size) as (raw, size):
        rows = PetscFile(path, raw, size).matrix(lengths, low, before, total)
    return from_rows(rows, comm)


def _market(path: Path, comm: Any, n: int | None) -> tuple[MarketHead, Places, Places, Vector]:
    """What a Matrix Market file, of a vector of `n` entries unless that is None, says it holds, and the entries in the
    bytes of this rank: i, j and a_ij, counted from 0. Collective. Raises FileError on all ranks."""
    with together(comm), opened(path, comm.size) as (raw, size):
        check_end(path, raw, size)
        head = market_head(path, lambda *most: raw.readline(*most).decode("utf-8", "replace"), size, n)
        begin = raw.tell()
        ends = [begin + (size - begin) * k // comm.size for k in (comm.rank, comm.rank + 1)]
        numbers = numbers_of(path, head, lines_within(raw, begin, *ends))
    _check_same(path, comm, (head, size))
    before = comm.exscan(numbers.size) or 0
    total = comm.allreduce(numbers.size)
    with together(comm):
        check_count(path, head, total)
        i, j, values = entries_of(path, head, numbers, before)
    return head, i, j, values


def lines_within(raw: BinaryIO, begin: int, low: int, high: int) -> Iterator[bytes]:
    """The lines that begin at the bytes `low` ≤ b < `high` of a file whose first line begins at the byte `begin`."""
    raw.seek(low)
    if low > begin:  # where a line begins is seen at the byte before
        raw.seek(low - 1)
        low += len(raw.readline()) - 1
    while low < high and (line := raw.readline()):
        low += len(line)
        yield line


def _assembled(comm: Any, n: int, i: Places, j: Places, values: Vector) -> Any:
    """The n × n `Mat` of the entries that all ranks have, those that are there twice added. Collective."""
    low, high = petsc().Vec().createMPI(n, comm=comm).getOwnershipRange()
    owner = np.searchsorted(comm.allgather(high), i, side="right")
    received = comm.alltoall([(i[mine], j[mine], values[mine]) for mine in (owner == k for k in range(comm.size))])
    i, j, values = (np.concatenate(parts) for parts in zip(*received, strict=True))
    return from_rows(sp.csr_array((values, (i - low, j)), shape=(high - low, n)), comm)
