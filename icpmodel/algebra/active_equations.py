"""The linear systems of Newton's method on the modulus equation, and of the derivative of its answer.

J has the rows of I − ψ′ where rows are active, those of A in the others, the free ones. With I for
the active rows and F for the free ones,

    (I − N)x_I = S⁻¹f_I + T₀x_F,     A_FI x_I + A_FF x_F = f_F.

S = 1 − ∂ψ_i/∂z_i is the slope of a row in its own unknown; N and T₀ hold the rest of S⁻¹ψ′.
"""

from __future__ import annotations

from contextlib import suppress
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import OutOfTime
from ..numerics import work
from ..numerics.arrays import Mask, Vector, row_of
from ..numerics.fill import SymbolicAnalysis, of_band
from ..numerics.krylov import NotConverged
from ..numerics.linear import Solver, dense_solver, is_for_multigrid, multigrid_pays, solver_of
from ..problem.data import ProblemData
from .cycled_equations import CycledEquations, cycles_cost
from .equations import equations_on, submatrix
from .hierarchy import Hierarchy, NoHierarchy


class ActiveEquations:
    """Jx = f and Jᵀx = f for many f: by V-cycles of A's hierarchy where these pay, or by elimination.

    Parameters
    ----------
    problem : ProblemData
        The problem.
    active : mask of shape (n,)
        The active rows.
    jacobian : CSR array of shape (n, n)
        ψ′(z).
    by_cycles : bool, optional
        Whether the hierarchy is taken; by default the predicted cost of a factorisation decides.

    Raises
    ------
    OutOfTime, OutOfMemory
        Where a factorisation takes more than is left.

    Notes
    -----
    The levels of A serve every active set, factors one only. So the cost of the levels is not
    counted for the cycles. Cycles cost again for every f, so a factorisation takes over once it
    costs no more than they have. Where A has no hierarchy, or where the cycles do not converge,
    elimination takes over.
    """

    def __init__(
        self, problem: ProblemData, active: Mask, jacobian: sp.csr_array, by_cycles: bool | None = None
    ) -> None:
        self._of, self._cycled, self._decided = (problem, active, jacobian), None, by_cycles is not None
        self._by_lu = None
        if by_cycles is None and problem.matrix.dense is not None:
            J = np.where(active[:, None], np.eye(problem.n) - jacobian.toarray(), problem.dense())
            self._by_lu = dense_solver(J)
            return
        # what cycles have cost, and what they may cost until that is weighed again
        self._spent, self._most = 0.0, cycles_cost(problem)
        if by_cycles or (by_cycles is None and self._factors_cost_more()):
            with suppress(NoHierarchy):
                self._cycled = CycledEquations(Hierarchy(problem), 0, active, jacobian if jacobian.nnz else None)

    @cached_property
    def _eliminated(self) -> Elimination:
        return Elimination(*self._of)

    def _factors_cost_more(self) -> bool:
        """Whether a factorisation costs more than cycles may."""
        problem, active, jacobian = self._of
        if not jacobian.nnz:  # M is a part of A, and need not be made where its size says enough
            free = ~active
            rows = problem.matrix.rows
            count = int(np.count_nonzero(free))
            if work.factor_cost(of_band(count, rows.below, rows.above, rows.below == rows.above)) > self._most:
                entries = int(np.count_nonzero(free[row_of(problem.A)] & free[problem.A.indices]))
                if work.least_factor_cost(count, entries) > self._most and is_for_multigrid(problem.A):
                    return True
        if not self._eliminated.costs_more(self._most):
            return False
        vars(self).pop("_eliminated", None)  # as large as A
        return True

    def solve(self, f: Vector, tolerance: float) -> Vector | None:
        """x with Jx = f, shape (n,), its free rows to the relative `tolerance` where that is inexact; None where J is
        singular."""
        return self._solved(f, tolerance, transposed=False)

    def transposed(self, f: Vector, tolerance: float) -> Vector | None:
        """x with Jᵀx = f, in the same manner."""
        return self._solved(f, tolerance, transposed=True)

    def _solved(self, f: Vector, tolerance: float, transposed: bool) -> Vector | None:
        if self._by_lu is not None:
            return self._by_lu(f, tolerance, transposed)
        if self._cycled is not None and not self._decided and self._spent > 2.0 * self._most:
            self._most = self._spent
            if not self._factors_cost_more():
                self._cycled = None
        with np.errstate(all="ignore"):
            if self._cycled is not None:
                done = work.done()
                try:
                    return self._cycled.solve(f, tolerance, transposed)
                except NotConverged:
                    self._cycled = None
                finally:
                    self._spent += work.done() - done
            return self._eliminated.solve(f, tolerance, transposed)


class Elimination:
    """J without its active unknowns: x_I = Tx_F + s leaves M = A_FF + A_FI T, and in Jᵀ the transpose of M.

    Parameters
    ----------
    problem, active, jacobian
        As for `ActiveEquations`.
    shift : array of shape (n,), optional
        Added to the diagonal of A.

    Notes
    -----
    The chains of ψ′ through the active rows end where ψ consists of jumps. Then (I − N)⁻¹ is a
    product of few sparse factors. With few rows at the border of I, M has little more entries than
    A_FF. Else M is J.
    """

    def __init__(self, problem: ProblemData, active: Mask, jacobian: sp.csr_array, shift: Vector | None = None) -> None:
        rows = np.flatnonzero(active)
        free = np.flatnonzero(~active)
        self._matrix, self._rows, self._free = problem.matrix, rows, free
        self._by_multigrid: bool | None = None
        try:
            self._slope, self._links, self._T = _chains(jacobian, rows, free)
            self._M = submatrix(problem, free)
            if self._T is not None:
                self._M = sp.csr_array(self._M + _product(sp.csr_array(problem.A[free][:, rows]), self._T))
            self._whole = False
        except _NotWorth:
            self._M, self._whole = equations_on(problem, active, jacobian), True
        if shift is not None:
            more = np.where(active, 0.0, shift) if self._whole else shift[free]
            self._M = sp.csr_array(self._M + sp.diags_array(more))
        is_part = not self._whole and self._T is None
        self._analysis = SymbolicAnalysis(self._M, (lambda: problem.matrix.is_symmetric) if is_part else None)

    def costs_more(self, most: float) -> bool:
        """Whether M is for multigrid, and a factorisation is foreseen to cost more than so many nanoseconds."""
        try:
            with work.work_limit(nanoseconds=most):
                found = multigrid_pays(self._M, self._analysis, most)
        except OutOfTime:  # the analysis alone costs less than the factorisation
            found = True
        self._by_multigrid = found
        return found

    @cached_property
    def _solver(self) -> Solver:
        return solver_of(self._M, self._by_multigrid, self._analysis)

    def solve(self, f: Vector, tolerance: float, transposed: bool) -> Vector | None:
        if self._whole:
            return self._solver(f, tolerance, transposed)
        return (self._backward if transposed else self._forward)(f, tolerance)

    def _forward(self, f: Vector, tolerance: float) -> Vector | None:
        rows = self._rows
        free = self._free
        s = f[rows] / self._slope
        for link in self._links:
            s = s + link @ s
        x = np.zeros(f.size)
        x[rows] = s
        part = self._solver((f - self._matrix.product(x))[free], tolerance)
        if part is None or not np.isfinite(s).all():
            return None
        x[free] = part
        if self._T is not None:
            x[rows] += self._T @ part
        return x

    def _backward(self, f: Vector, tolerance: float) -> Vector | None:
        # Mᵀx_F = f_F + Tᵀf_I, then S(I − N)ᵀx_I = f_I − A_FIᵀx_F
        rows = self._rows
        free = self._free
        part = self._solver(f[free] if self._T is None else f[free] + self._T.T @ f[rows], tolerance, True)
        if part is None:
            return None
        x = np.zeros(f.size)
        x[free] = part
        s = (f - (self._matrix.product(x) if self._matrix.is_symmetric else self._matrix.sparse.T @ x))[rows]
        for link in reversed(self._links):
            s = s + link.T @ s
        x[rows] = s / self._slope
        return x if np.isfinite(x).all() else None


class _NotWorth(Exception):
    """The active unknowns cannot be eliminated, or that costs more than a dense factorisation of the whole."""


def _chains(
    J: sp.csr_array, rows: NDArray[np.intp], free: NDArray[np.intp]
) -> tuple[Vector, list[sp.csr_array], sp.csr_array | None]:
    """1 − own slope, the list N, N², N⁴, …, and T, None where it is 0.

    N is nilpotent and (I − N)⁻¹ = … (I + N²)(I + N).
    """
    from scipy.sparse.csgraph import connected_components

    if not J.nnz:
        return np.ones(rows.size), [], None
    own = J.diagonal()[rows]
    slope = 1.0 - own
    J_I = J[rows]
    if not slope.all():
        raise _NotWorth
    if own.any():
        J_I = sp.diags_array(1.0 / slope) @ J_I
    T = sp.csr_array(J_I[:, free])
    N = sp.csr_array(J_I[:, rows])
    if own.any():
        N.data[row_of(N) == N.indices] = 0.0
        N.eliminate_zeros()
    if N.nnz and connected_components(N, connection="strong")[0] < rows.size:
        raise _NotWorth
    links: list[sp.csr_array] = []
    while N.nnz:
        links.append(N)
        T = sp.csr_array(T + _product(N, T))
        N = _product(N, N)
    return slope, links, T if T.nnz else None


def _product(A: sp.csr_array, B: sp.csr_array) -> sp.csr_array:
    """AB. Raises _NotWorth where it costs more than a dense factorisation with as many rows as B has in all."""
    cost = work.COSTS.sparse_flop * float(np.diff(B.indptr)[A.indices].sum())
    if cost > work.dense_cost(sum(B.shape)):
        raise _NotWorth
    work.charge(cost)
    return sp.csr_array(A @ B)
