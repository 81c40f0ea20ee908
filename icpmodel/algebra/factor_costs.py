"""Predicted costs of factorising A and matrices with its pattern, by one symbolic analysis for each A.

The pattern and the symmetry of A + D do not depend on the diagonal D, so one analysis serves for all D.
"""

from __future__ import annotations

from functools import cached_property
from weakref import WeakKeyDictionary, ref

import numpy as np

from ..numerics import work
from ..numerics.arrays import row_of
from ..numerics.condensed import product_cost
from ..numerics.factorisation import FACTOR_BYTES
from ..numerics.fill import Fill, SymbolicAnalysis, dense_cost, factor_cost, part_fill, refactor_cost
from ..numerics.linear import steps_cost
from ..problem.facts import Facts
from ..problem.matrix import Matrix


class FactorCosts:
    """The costs of factorising `matrix`, in nanoseconds; made by `factor_costs`, which caches them with the matrix."""

    def __init__(self, matrix: Matrix) -> None:
        self._matrix = ref(matrix)
        self.analysis = SymbolicAnalysis(matrix.sparse, self._is_symmetric)
        self.n = matrix.n

    def _is_symmetric(self) -> bool:
        matrix = self._matrix()
        return matrix is not None and matrix.is_symmetric

    @cached_property
    def complete(self) -> FactorCosts:
        """The costs by a complete symbolic analysis, which pays where many matrices with the pattern are factorised."""
        matrix = self._matrix()
        if self.fill.is_exact or matrix is None:
            return self
        complete = FactorCosts(matrix)
        complete.analysis = self.analysis.exact()
        return complete

    @cached_property
    def fill(self) -> Fill:
        """The entries and operations of a sparse factorisation; an estimate where a full analysis does not pay."""
        return self.analysis.fill

    @cached_property
    def dense(self) -> float:
        """The cost of a dense factorisation of A."""
        return dense_cost(self.n, self._is_symmetric())

    @cached_property
    def reuses_order(self) -> bool:
        """Whether `SymmetricFactors` applies to matrices with the pattern of A, and costs less than dense factors."""
        fill = self.fill
        return fill.is_exact and fill.symmetric and refactor_cost(fill) < self.dense

    @cached_property
    def first(self) -> float:
        """The cost of a first factorisation with the pattern of A: sparse or dense, whichever is less."""
        return self.part(self.n)

    @cached_property
    def unsymmetric(self) -> float:
        """The cost for an unsymmetric matrix with the pattern of A."""
        return self.part(self.n, symmetric=False)

    def part(self, rows: int, *, symmetric: bool = True) -> float:
        """The lesser cost, sparse or dense, for `rows` of the rows with their columns; `symmetric` if A is."""
        fill = part_fill(self.fill, rows)
        if not symmetric:
            fill = fill._replace(symmetric=False)
        return min(factor_cost(fill), dense_cost(rows, symmetric and self._is_symmetric()))

    @cached_property
    def repeated(self) -> float:
        """The cost for a matrix with the pattern of A once another one has been factorised."""
        return refactor_cost(self.fill) if self.reuses_order else self.first

    @cached_property
    def condensed(self) -> float:
        """The cost by `CondensedFactors` that keep the rows of sign +1; inf if `repeated` is less or D not diagonal."""
        M = self.analysis.matrix
        if M.nnz == self.n**2 or self.analysis.is_band or (signs := self.analysis.signs) is None:
            return np.inf
        kept = int(np.count_nonzero(signs > 0.0))
        cost = product_cost(kept, self.n - kept) + dense_cost(kept)
        i = row_of(M)
        pays = cost < self.repeated and not (signs[i] + signs[M.indices] < 0.0)[i != M.indices].any()
        return cost if pays else np.inf


_COSTS: WeakKeyDictionary[Matrix, FactorCosts] = WeakKeyDictionary()


def factor_costs(matrix: Matrix) -> FactorCosts:
    """The `FactorCosts` of `matrix`, made once for all matrices that differ from one `origin` only in the diagonal."""
    matrix = matrix.origin or matrix
    costs = _COSTS.get(matrix)
    if costs is None:
        costs = _COSTS[matrix] = FactorCosts(matrix)
    return costs


#: the number of vectors that a Krylov method holds
_WORK_VECTORS = 24


def system_cost(matrix: Matrix, factors: float) -> tuple[float, float]:
    """The (nanoseconds, bytes) that `solver_of` is expected to take for a system with the pattern of A.

    `factors` is the cost of a factorisation, in nanoseconds.
    """
    memory = FACTOR_BYTES * factor_costs(matrix).fill.entries
    steps = steps_cost(matrix.n, matrix.nnz) if matrix.has_positive_diagonal else np.inf
    if steps < factors or (steps < np.inf and not work.memory_suffices(memory)):
        return steps, work.ENTRY_BYTES * matrix.nnz + _WORK_VECTORS * 8.0 * matrix.n
    return factors, memory


def newton_cost(facts: Facts) -> float:
    """The cost of a Newton step without the solution of its equations, in nanoseconds."""
    return work.newton_cost(facts.matrix.n, facts.entries, mixed=not facts.psi.is_constant)


def interior_cost(facts: Facts) -> float:
    """The cost of an interior-point step without the solution of its equations, in nanoseconds.

    It is half that of a Newton step, which also extracts the free rows. Measured on 13 problems, n = 300 to 20000.
    """
    return 0.5 * newton_cost(facts)
