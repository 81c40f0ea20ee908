"""The linear systems of Newton's method on the modulus equation, and of the derivative of its answer.

J has the rows of I − ψ′ where rows are active, those of A in the others, the free ones. With I for the active rows and
F for the free ones,

    (I − N)x_I = S⁻¹f_I + T₀x_F,     A_FI x_I + A_FF x_F = f_F,

where S = 1 − ∂ψ_i/∂z_i is what moves with the row itself, and N and T₀ hold the rest of S⁻¹ψ′.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import cached_property, partial
from itertools import islice

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import OutOfTime
from ..numerics import work
from ..numerics.arrays import Vector, inner, norm, row_of
from ..numerics.fill import Look
from ..numerics.linear import STEPS, Solver, cg_steps, cg_vector_cost, dense_solver, multigrid_pays, solver_of
from ..numerics.multigrid import KRYLOV_STEPS
from ..problem.data import ProblemData
from .equations import equations_on
from .hierarchy import Hierarchy, Level, NoHierarchy

#: ψ_i is not followed where 1 − ∂ψ_i/∂z_i is smaller
LEAST_SLOPE = 0.1
#: directions that GCR keeps
_KEPT = 8


class ActiveEquations:
    """Jx = f and Jᵀx = f for many f: by V-cycles of A's hierarchy where these pay, or by elimination.

    The levels of A serve every active set, and factors one only, so that cycles are weighed without what the levels
    cost; and as they cost again for every f, a factorisation takes over once it costs no more than they have.
    Parameters: `active` a mask of shape (n,); `jacobian` = ψ′(z), CSR, shape (n, n); `by_cycles` whether the hierarchy
    is taken, None where the foreseen cost of a factorisation is to decide. Where A has none, or where the cycles do not
    converge, elimination takes over. Raises OutOfTime and OutOfMemory.
    """

    def __init__(
        self,
        problem: ProblemData,
        active: NDArray[np.bool_],
        jacobian: sp.csr_array,
        by_cycles: bool | None = None,
    ) -> None:
        self._of, self._cycled, self._decided = (problem, active, jacobian), None, by_cycles is not None
        self._by_lu = None
        if by_cycles is None and problem.matrix.dense is not None:
            self._by_lu = dense_solver(
                np.where(active[:, None], np.eye(problem.n) - jacobian.toarray(), problem.dense())
            )
            return
        # what cycles have cost, and what they may cost until that is weighed again
        self._spent, self._most = 0.0, cycles_cost(problem)
        if by_cycles or (by_cycles is None and self._factors_cost_more()):
            with suppress(NoHierarchy):
                self._cycled = CycledEquations(Hierarchy(problem), 0, active, jacobian if jacobian.nnz else None)

    @cached_property
    def _eliminated(self) -> _Elimination:
        return _Elimination(*self._of)

    def _factors_cost_more(self) -> bool:
        """Whether a factorisation costs more than cycles may."""
        if not self._eliminated.costs_more(self._most):
            return False
        vars(self).pop("_eliminated")  # as large as A
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
                except _NotConverged:
                    self._cycled = None
                finally:
                    self._spent += work.done() - done
            return self._eliminated.solve(f, tolerance, transposed)


class _Elimination:
    """J without its active unknowns: x_I = Tx_F + s leaves M = A_FF + A_FI T, and in Jᵀ the transpose of M.

    Where the chains of ψ′ through the active rows end, as those of jumps do, (I − N)⁻¹ is a product of few sparse
    factors, and with few rows at the border of I, M is little more than A_FF. Else M is J.
    """

    def __init__(self, problem: ProblemData, active: NDArray[np.bool_], jacobian: sp.csr_array) -> None:
        rows, free = np.flatnonzero(active), np.flatnonzero(~active)
        self._rows, self._free = rows, free
        self._by_multigrid: bool | None = None
        try:
            self._slope, self._links, self._T = _chains(jacobian, rows, free)
            self._A_F = A_F = problem.A[free]
            self._M = sp.csr_array(A_F[:, free])
            if self._T.nnz:
                self._M = sp.csr_array(self._M + _product(sp.csr_array(A_F[:, rows]), self._T))
            self._whole = False
        except _NotWorth:
            self._M, self._whole = equations_on(problem, active, jacobian), True
        self._look = Look(self._M)

    def costs_more(self, most: float) -> bool:
        """Whether M is for multigrid, and a factorisation is foreseen to cost more than so many nanoseconds."""
        try:
            with work.of_count(most):
                found = multigrid_pays(self._M, self._look, most)
        except OutOfTime:  # to look at M costs less than to factorise it
            found = True
        self._by_multigrid = found
        return found

    @cached_property
    def _solver(self) -> Solver:
        return solver_of(self._M, self._by_multigrid, self._look)

    def solve(self, f: Vector, tolerance: float, transposed: bool) -> Vector | None:
        if self._whole:
            return self._solver(f, tolerance, transposed)
        return (self._backward if transposed else self._forward)(f, tolerance)

    def _forward(self, f: Vector, tolerance: float) -> Vector | None:
        rows, free = self._rows, self._free
        s = f[rows] / self._slope
        for link in self._links:
            s = s + link @ s
        x = np.zeros(f.size)
        x[rows] = s
        part = self._solver(f[free] - self._A_F @ x, tolerance)
        if part is None or not np.isfinite(s).all():
            return None
        x[free] = part
        x[rows] += self._T @ part
        return x

    def _backward(self, f: Vector, tolerance: float) -> Vector | None:
        # Mᵀx_F = f_F + Tᵀf_I, then S(I − N)ᵀx_I = f_I − A_FIᵀx_F
        rows, free = self._rows, self._free
        part = self._solver(f[free] + self._T.T @ f[rows], tolerance, True)
        if part is None:
            return None
        s = f[rows] - (self._A_F.T @ part)[rows]
        for link in reversed(self._links):
            s = s + link.T @ s
        x = np.empty(f.size)
        x[rows], x[free] = s / self._slope, part
        return x if np.isfinite(x).all() else None


class _NotWorth(Exception):
    """The active unknowns cannot be eliminated, or that costs more than a dense factorisation of the whole."""


def _chains(
    J: sp.csr_array, rows: NDArray[np.intp], free: NDArray[np.intp]
) -> tuple[Vector, list[sp.csr_array], sp.csr_array]:
    """(1 − own slope, N, N², N⁴, …, and T) with (I − N)⁻¹ = … (I + N²)(I + N), where N has a power that is 0."""
    from scipy.sparse.csgraph import connected_components

    if not J.nnz:
        return np.ones(rows.size), [], sp.csr_array((rows.size, free.size))
    own = J.diagonal()[rows]
    slope, J_I = 1.0 - own, J[rows]
    if not slope.all():
        raise _NotWorth
    if own.any():
        J_I = sp.diags_array(1.0 / slope) @ J_I
    T, N = sp.csr_array(J_I[:, free]), sp.csr_array(J_I[:, rows])
    if own.any():
        N.data[row_of(N) == N.indices] = 0.0
        N.eliminate_zeros()
    if N.nnz and connected_components(N, connection="strong")[0] < rows.size:
        raise _NotWorth
    links: list[sp.csr_array] = []
    while N.nnz:
        links.append(N)
        T, N = sp.csr_array(T + _product(N, T)), _product(N, N)
    return slope, links, T


def _product(A: sp.csr_array, B: sp.csr_array) -> sp.csr_array:
    """AB. Raises _NotWorth where it costs more than a dense factorisation with as many rows as B has in all."""
    cost = work.COSTS.sparse_flop * float(np.diff(B.indptr)[A.indices].sum())
    if cost > work.dense_cost(sum(B.shape)):
        raise _NotWorth
    work.afford(cost)
    work.add(cost)
    return sp.csr_array(A @ B)


def cycles_cost(problem: ProblemData) -> float:
    """What one system costs by `CycledEquations`, with as many steps as it needs as a rule."""
    costs = work.COSTS
    return STEPS * (costs.cycle + costs.cycle_entry * problem.nnz + problem.matrix.unit + cg_vector_cost(problem.n))


class _NotConverged(Exception):
    """The Krylov steps do not get to their tolerance."""


class CycledEquations:
    """J on level `top` of a hierarchy of A, never made: its products, V-cycles on the free rows, and what they solve.

    Parameters: the `hierarchy`, whose free rows are from now on those that are not `active`; `jacobian` = ψ′(z), or
    None where ψ is constant.
    """

    def __init__(
        self, hierarchy: Hierarchy, top: int, active: NDArray[np.bool_], jacobian: sp.csr_array | None
    ) -> None:
        self._hierarchy, self._top, self._active, self._J = hierarchy, top, active, jacobian
        hierarchy.restrict(~active, top)
        own = 0.0 if jacobian is None else jacobian.diagonal()
        self._slope = np.maximum(1.0 - own, LEAST_SLOPE)
        self._coupled = jacobian is not None and jacobian.nnz > np.count_nonzero(own)
        #: whether x_I follows from the own rows of I
        self._alone = not self._coupled and bool(np.all((self._slope == 1.0 - own) | ~active))

    def start(self, f: Vector) -> Vector:
        """x_I = S⁻¹f_I, x_F = 0."""
        return np.where(self._active, f / self._slope, 0.0)

    def product(self, y: Vector, transposed: bool = False) -> Vector:
        """Jy, or Jᵀy."""
        if transposed:
            held = np.where(self._active, y, 0.0)
            image = self._level(True).problem.product(y - held) + held
            return image if self._J is None else image - self._J.T @ held
        image = self._level(False).problem.product(y)
        return np.where(self._active, y if self._J is None else y - self._J @ y, image)

    def preconditioned(self, f: Vector) -> Vector:
        """About J⁻¹f; where nothing is coupled, f_I must be 0."""
        return self._in_blocks(f, self._cycle, False) if self._coupled else self._cycle(f)

    def solve(self, f: Vector, tolerance: float, transposed: bool = False) -> Vector:
        """x with Jx = f, or Jᵀx = f. Raises _NotConverged."""
        if self._alone:
            return self._in_blocks(f, partial(self._on_free, tolerance=tolerance, transposed=transposed), transposed)
        units = np.ones(f.size) if transposed else np.where(self._active, 1.0, self._level(False).inverse)
        cycle, x = partial(self._cycle, transposed=transposed), self.start(f)
        steps = GCR(
            lambda y: units * self.product(y, transposed),
            lambda rest: self._in_blocks(rest / units, cycle, transposed),
            units * (f - self.product(x, transposed)),
        )
        return steps.until(x, tolerance * norm(units * f))

    def _on_free(self, f: Vector, tolerance: float, transposed: bool) -> Vector:
        """x with A_FF x_F = f_F, or with its transpose, and x_I = 0."""
        level, cycle = self._level(transposed), partial(self._cycle, transposed=transposed)
        f = np.where(self._active, 0.0, f)

        def product(y: Vector) -> Vector:
            return np.where(self._active, 0.0, level.problem.product(y))

        if not self._hierarchy.is_symmetric:
            units = np.ones(f.size) if transposed else level.inverse
            steps = GCR(lambda y: units * product(y), lambda rest: cycle(rest / units), units * f)
            return steps.until(np.zeros(f.size), tolerance * norm(steps.rest))
        units = np.sqrt(level.inverse)
        enough = tolerance * norm(units * f)
        for x, rest, _ in islice(cg_steps(product, cycle, f), KRYLOV_STEPS):
            work.add(cg_vector_cost(f.size))
            if norm(units * rest) <= enough:
                return x
        raise _NotConverged

    def _in_blocks(self, f: Vector, on_free: Callable[[Vector], Vector], transposed: bool) -> Vector:
        """J⁻¹f or J⁻ᵀf, with `on_free` in place of A_FF⁻¹, where nothing is coupled, else about that."""
        if transposed:
            y = on_free(f)
            return y + self.start(f - self._level(True).problem.product(y))
        step = self.start(f)
        return step + on_free(f - self._level(False).problem.product(step))

    def _cycle(self, f: Vector, transposed: bool = False) -> Vector:
        return self._way(transposed).cycle(f, self._top)

    def _level(self, transposed: bool) -> Level:
        return self._way(transposed).levels[self._top]

    def _way(self, transposed: bool) -> Hierarchy:
        return self._hierarchy.transposed if transposed else self._hierarchy


class GCR:
    """Generalised conjugate residuals: steps that each reduce the 2-norm of the rest as the last directions allow.

    Parameters: the `product` with M and a preconditioner for it; `rest` = f − Mx where they begin.
    """

    def __init__(
        self, product: Callable[[Vector], Vector], preconditioned: Callable[[Vector], Vector], rest: Vector
    ) -> None:
        self._product, self._preconditioned, self.rest = product, preconditioned, rest
        self._directions: list[tuple[Vector, Vector]] = []

    def further(self, x: Vector, wanted: float, most: int) -> tuple[Vector, bool]:
        """`x` after at most so many steps, until the rest is as small as `wanted`, and whether any was made."""
        moved = False
        for _ in range(most):
            y = self._preconditioned(self.rest)
            w = self._product(y)
            for direction, image in self._directions:
                share = inner(w, image)
                w -= share * image
                y -= share * direction
            size = norm(w)
            if not 0 < size < np.inf:
                break
            y /= size
            w /= size
            self._directions = [*self._directions[1 - _KEPT :], (y, w)]
            share = inner(self.rest, w)
            x, moved = x + share * y, True
            self.rest = self.rest - share * w
            if norm(self.rest) <= wanted:
                break
        return x, moved

    def until(self, x: Vector, wanted: float) -> Vector:
        """`x` where the rest is as small as `wanted`."""
        if norm(self.rest) > wanted:
            x, _ = self.further(x, wanted, KRYLOV_STEPS)
        if not norm(self.rest) <= wanted:
            raise _NotConverged
        return x
