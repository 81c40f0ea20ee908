"""A PETSc matrix whose rows are distributed over ranks, with cached properties."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import InputError
from ..numerics.arrays import Vector
from ..numerics.rounding import SMALLEST, gamma
from ..numerics.sparse_structure import ROUNDING_RTOL, diagonal_positions
from ..problem.matrix import weights_of
from .ranks import anywhere, largest, petsc, together


class DistributedMatrix:
    """A square `mat` of PETSc (aij) on the ranks of `comm`; this one holds the rows `low` ≤ i < `high` of `n`."""

    def __init__(self, mat: Any) -> None:
        self.mat = mat
        self.comm = mat.comm.tompi4py()
        self.low, self.high = mat.getOwnershipRange()
        self.n = mat.getSize()[0]

    @cached_property
    def diagonal(self) -> Vector:
        """The diagonal of the own rows."""
        entries: Vector = self.mat.getDiagonal().array.copy()
        entries.flags.writeable = False
        return entries

    @property
    def row_weights(self) -> Vector:
        """The weights of the own rows: see `problem.Matrix.row_weights`."""
        return self.own_rows[0]

    @cached_property
    def smallest_row(self) -> float:
        """The smallest weight d_i of D: ‖D⁻¹x‖ ≤ ‖x‖/min d_i. Collective, the first time."""
        return 1.0 / largest(self.comm, self.row_weights)

    @cached_property
    def block(self) -> sp.csr_array:
        """The own rows and columns, CSR."""
        indptr, indices, data = self.mat.getDiagonalBlock().getValuesCSR()
        return sp.csr_array((data, indices, indptr), shape=(self.high - self.low,) * 2)

    @cached_property
    def block_diagonal(self) -> NDArray[np.integer]:
        """Where the diagonal entries of the block are stored."""
        return diagonal_positions(self.block)

    def free_block(self) -> None:
        """Free the arrays that sweeps use: `block` and `block_diagonal`."""
        for name in ("block", "block_diagonal"):
            vars(self).pop(name, None)

    @cached_property
    def own_rows(self) -> tuple[Vector, int, bool, bool]:
        """(weights, entries of the longest row, whether the signs are those of an M-matrix, whether all are finite).

        Local. PETSc copies the entries, twice on several ranks: better before the levels are made.
        """
        indptr, _, data = self.mat.getValuesCSR()
        signs = (self.diagonal > 0).all() and np.count_nonzero(data > 0) == self.diagonal.size
        finite = bool(np.isfinite(data).all())
        entries = np.diff(indptr)
        largest_of_rows = np.zeros(entries.size)
        full = entries > 0
        if full.any():
            largest_of_rows[full] = np.maximum.reduceat(np.abs(data, out=data), indptr[:-1][full])
        return weights_of(largest_of_rows), int(entries.max(initial=0)), bool(signs), finite

    @cached_property
    def terms(self) -> int:
        """The number of entries of the longest row, which bounds the rounding of a product. Collective, at first."""
        return int(largest(self.comm, self.own_rows[1]))

    @cached_property
    def comparison(self) -> DistributedMatrix:
        """⟨A⟩, |a_ii| on the diagonal and −|a_ij| off it; this object itself if A has these signs. Collective."""
        if not anywhere(self.comm, not self.own_rows[2]):
            return self
        new = DistributedMatrix(map_entries(self.mat, lambda data: -np.abs(data)))
        new.mat.setDiagonal(self.vector(np.abs(self.diagonal)))
        new.mat.assemble()
        return new

    def absolute(self, v: Vector) -> Vector:
        """A bound ≥ |A|v = 2|D|v − ⟨A⟩v in the own rows, rounding included, for `v` ≥ 0 in them. Collective."""
        double = 2.0 * np.abs(self.diagonal) * v
        image = self.comparison.product(self.vector(v)).array
        # each of the two products and their difference lose at most γ_k(2|D|v + |A|v) ≤ 3γ_k|A|v
        return (double - image) * (1.0 + 8.0 * gamma(self.terms + 2)) + self.terms * SMALLEST

    @cached_property
    def is_symmetric(self) -> bool:
        """Whether Au = Aᵀu up to rounding, for one irregular u. Collective.

        It decides which Krylov method is tried; no proof depends on it.
        """
        u = self.vector(np.cos(np.arange(self.low, self.high) ** 2.0))
        image = self.product(u)
        difference = self.image(self.mat, u, transposed=True)
        difference.axpy(-1.0, image)
        largest_entry = petsc().NormType.INFINITY  # whose squares are not needed
        return bool(difference.norm(largest_entry) <= ROUNDING_RTOL * image.norm(largest_entry))

    def vector(self, own: Vector | None = None) -> Any:
        """A new PETSc vector of shape (n,), with the `own` entries, or zeros."""
        vector = self._template.duplicate()
        vector.set(0.0) if own is None else vector.setArray(own)
        return vector

    @cached_property
    def _template(self) -> Any:
        """A vector to copy: a copy needs no communication, a new vector of the matrix does."""
        return self.mat.createVecRight()

    def product(self, z: Any) -> Any:
        """Az, a new PETSc vector."""
        return self.image(self.mat, z)

    def image(self, mat: Any, z: Any, transposed: bool = False) -> Any:
        """Mz, or Mᵀz, for a `mat` whose rows, or columns, have this layout, a new PETSc vector."""
        result = self._template.duplicate()
        (mat.multTranspose if transposed else mat.mult)(z, result)
        return result


def map_entries(mat: Any, entries_of: Callable[[Vector], Vector]) -> Any:
    """A new `Mat` with the pattern of `mat` and the entries `entries_of(data)`. Collective."""
    indptr, indices, data = mat.getValuesCSR()
    new = petsc().Mat().createAIJ(mat.getSizes(), csr=(indptr, indices, entries_of(data)), comm=mat.comm)
    new.assemble()
    return new


def check_aij(mat: Any, name: str) -> None:
    """Raise InputError where `mat`, a `Mat`, is not assembled or is of another type than aij. Local."""
    kind = mat.getType() or "none"
    if not kind.startswith(("aij", "seqaij", "mpiaij")):  # others have aij in their names: baij, sbaij
        raise InputError(f"{name} is of PETSc's type {kind}; aij was expected: {name}.convert('aij')")
    if not mat.isAssembled():
        raise InputError(f"{name} is not assembled; call {name}.assemble() on all ranks")


def check_counts(n: int, entries: int) -> None:
    """Raise InputError where PETSc's integers cannot count the unknowns, or the entries of one rank."""
    most = np.iinfo(petsc().IntType).max
    if max(n, entries) > most:
        actual = f"{n} unknowns" if n > most else f"{entries} entries on one rank"
        raise InputError(f"{actual} are too many for this PETSc, whose indices have {most.bit_length() + 1} bits")


def from_rows(rows: sp.csr_array, comm: Any) -> Any:
    """A square PETSc matrix from the `rows` of each rank, CSR with all columns. Collective. Raises InputError."""
    PETSc = petsc()
    local_rows = rows.shape[0]
    n = comm.allreduce(local_rows)
    with together(comm):
        if rows.shape[1] != n:
            raise InputError(f"A has {rows.shape[1]} columns in the rows of this rank; {n} were expected")
        check_counts(n, rows.nnz)
        csr = (rows.indptr.astype(PETSc.IntType), rows.indices.astype(PETSc.IntType), rows.data)
    mat = PETSc.Mat().createAIJ(((local_rows, n), (local_rows, n)), csr=csr, comm=comm)
    mat.assemble()
    return mat
