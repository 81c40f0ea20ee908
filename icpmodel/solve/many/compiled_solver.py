"""The rows of one `solve_many` in compiled code: pivots for small problems, and the tridiagonal pass."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...algebra.affine_lcp import MAX_PIVOTS_PER_ROW, PIVOT_UP_TO, AffineLcp, affine_obstacle, in_box
from ...methods.contract import Method
from ...methods.shortcuts import MAX_ROUNDS, STEPS_PER_ROUND, Lemke, Tridiagonal
from ...numerics import work
from ...numerics.arrays import Vector, read_only
from ...numerics.threads import cores, run_in_threads
from ...problem.map import Map
from ...problem.matrix import EMPTY_ROW_SIZE, weights_of
from ...problem.point_values import smallest_size
from ...problem.two_sided import mid, sides_of
from ...problem.verdict import certify_rows, entries_of
from ..solutions import BatchData

Matrix = NDArray[np.float64]

#: arrays of the size of Q that solving all rows at once needs
_WORK_ARRAYS = 6
#: the number of unknowns, of all rows together, for which one thread pays
UNKNOWNS_A_THREAD = 10_000


class CompiledSolver:
    """Solver in compiled code of rows with fixed or affine obstacles, with one A, or small ones each with its own.

    Parameters
    ----------
    data : BatchData
        The problems.
    obstacles, above : array of shape (k, n), optional
        The lower and the upper obstacles of each row, where they are numbers.
    """

    def __init__(self, data: BatchData, obstacles: Matrix | None, above: Matrix | None) -> None:
        self.data = data
        self.problem = data.problems[0]
        self.obstacles = obstacles
        self.above = above
        self.limits = data.limits
        self.Q = data.Q
        #: the matrices, shape (k, n, n), where each row has its own
        self.stack: Matrix | None = getattr(data.problems, "matrices", None)
        self.small = self.problem.n <= PIVOT_UP_TO
        psi = self.problem.psi
        self.affine = psi.linear is not None and not psi.is_constant
        self.method: Method = Lemke() if self.small else Tridiagonal()

    def row_cost(self) -> float | None:
        """The cost of a row, in nanoseconds; None if compiled code does not apply."""
        problem = self.problem
        if not (self.affine or problem.facts.has_fixed_obstacle):
            return None
        if self.small:
            return work.COSTS.pivot_entry * problem.n**3 / 3.0
        return None if self.affine or self.method.why_not(problem) else work.COSTS.band_entry * 3.0 * problem.n

    def pieces(self, row_cost: float) -> Iterator[tuple[slice, tuple[Matrix, Vector, Vector, Any]]]:
        """Yield batches of rows with their z, residuals, tolerances, and a mask of the solved ones.

        Raises MapError, SingularOperator, OutOfTime and MemoryError.
        """
        psi = self.problem.psi
        work.check_budget(memory=_WORK_ARRAYS * 8.0 * self.Q.size)
        C, G = self._affine(psi, self.obstacles)
        D, H = (None, None) if psi.upper is None else self._affine(psi.upper, self.above)
        above = None if D is None else (D[0], H)
        piece = work.steps_per_piece(row_cost)
        for low in range(0, len(C), piece):
            rows = slice(low, low + piece)
            work.check_budget(row_cost)
            work.count(row_cost * len(C[rows]))
            arrays = self.Q[rows], C[rows], None if D is None else D[rows]
            if self.small:
                A = self.problem.dense() if self.stack is None else self.stack[rows]
                q = self.Q[0] if self.stack is None else self.Q[rows]
                lcp = AffineLcp(A, q, C[0], G, above, not in_box(self.problem.facts))
                Z = lcp.solve_I_minus_G(self._pivot(lcp, *arrays))
            else:
                Z = self._solve_tridiagonal(*arrays)
            yield rows, (Z, *self._judge(rows, Z, *arrays))

    def _affine(self, psi: Map, rows: Matrix | None) -> tuple[Matrix, Any]:
        """c and G of one obstacle Gz + c, c row by row; G is None where it is fixed."""
        c, G = affine_obstacle(self.problem.facts, psi)
        return np.broadcast_to(c if rows is None else rows, self.Q.shape), G

    def _on_threads(self, loop: Callable[[int, int], Any], rows: int) -> None:
        """Call `loop` for parts of the `rows`, on as many threads as pay."""
        worth = -(-rows * self.problem.n // UNKNOWNS_A_THREAD)
        run_in_threads(rows, min(cores(), rows, worth), loop)

    def _values(self, psi: Map, Z: Matrix, C: Any) -> Matrix:
        """ψ(z), row by row."""
        if psi.is_constant:
            return C
        return (psi.linear[0] @ Z.T).T + psi.linear[1] if psi.linear else np.array([psi.value(z) for z in Z])

    def _judge(self, rows: slice, Z: Matrix, Q: Matrix, C: Matrix, D: Matrix | None) -> tuple[Vector, Vector, Any]:
        """The residuals of Z, the tolerances, and a mask of the solved `rows`."""
        problem = self.problem
        sides = list(zip(sides_of(problem.psi), (C, D), strict=False))
        values = [self._values(psi, Z, c) for psi, c in sides]
        distances = [Z - value for value in values]
        distances_at_0 = [-self._values(psi, np.zeros_like(Z[:1]), c) for psi, c in sides]
        known = [Q, Z, *(value if psi.linear is None else c for (psi, c), value in zip(sides, values, strict=True))]
        if self.stack is None:
            weights = problem.matrix.row_weights[None]
            p = (problem.A @ Z.T).T + Q
        else:
            weights = weights_of(np.abs(self.stack[rows]).max(2))
            p = np.einsum("kij,kj->ki", self.stack[rows], Z) + Q
        residuals = _row_norms(mid(weights * p, *distances))
        tolerances = self.limits.tolerance(self._scales(rows, weights, Q, distances_at_0))
        self._certify(rows, known, residuals, tolerances, weights)
        solved = residuals <= tolerances
        if self.limits.atol:
            paper = _row_norms(mid(p, *distances))
            self._certify(rows, known, paper, np.full(len(Q), self.limits.atol), np.ones_like(weights))
            solved |= paper <= self.limits.atol
        return residuals, tolerances, solved

    def _scales(self, rows: slice, weights: Matrix, Q: Matrix, distances_at_0: list[Matrix]) -> Vector:
        """The `residual_scale` of each of the `rows`, shape (rows,)."""
        scales = _row_norms(mid(weights * Q, *distances_at_0))
        if not scales.all():
            scaled_p = np.where(weights == 1.0 / EMPTY_ROW_SIZE, 0.0, weights * Q)
            sizes = smallest_size(*np.broadcast_arrays(scaled_p, *distances_at_0))
            scales = np.where(scales == 0.0, sizes, scales)
        for row in np.flatnonzero(~(scales < np.inf)):
            scales[row] = self.data.problem(rows.start + int(row)).residual_scale()
        return scales

    def _certify(self, rows: slice, known: list[Any], residuals: Vector, tolerances: Vector, weights: Any) -> None:
        """Replace residuals within the tolerances by upper bounds of the exact ones."""
        Q, Z, *offsets = known
        arrays = [Q, Z, residuals, tolerances, *offsets]
        indptr, indices, data = entries_of(self.problem.matrix)
        if self.stack is not None:
            data = self.stack[rows].reshape(len(Q), -1)

        def part(low: int, high: int) -> None:
            own = slice(low, high) if len(data) > 1 else slice(None)
            certify_rows(self.problem.psi, (indptr, indices, data[own]), weights[own], *(X[low:high] for X in arrays))

        self._on_threads(part, len(Q))

    def _pivot(self, lcp: AffineLcp, Q: Matrix, C: Matrix, D: Matrix | None) -> Matrix:
        """Solve the rows by pivoting, one LCP each."""
        from ...algebra.kernels.balancing import scale
        from ...algebra.kernels.batched_lcps import solve_lcps, solve_stack  # loads numba

        size = lcp.M.shape[-1]
        covering = lcp.covering
        if lcp.rows is not None:
            Q = lcp.right_sides(Q, D)
            C = np.concatenate([C, np.zeros((len(C), size - lcp.n))], axis=1)
        D = np.full(Q.shape, np.inf) if D is None or lcp.rows is not None else D
        M, Q, C, D = read_only((lcp.M, Q, C, D))
        X = np.empty(Q.shape)
        limit = MAX_PIVOTS_PER_ROW * (size + 1)
        scaled = scale(M) if self.stack is None else None

        def loop(low: int, high: int) -> None:
            arrays = covering, Q[low:high], C[low:high], D[low:high], limit, X[low:high]
            if scaled is None:
                solve_stack(M[low:high], *arrays)
            else:
                solve_lcps(*scaled, *arrays)

        self._on_threads(loop, len(Q))
        return X

    def _solve_tridiagonal(self, Q: Matrix, C: Matrix, D: Matrix | None) -> Matrix:
        """Solve the rows by `Tridiagonal`."""
        from ...algebra.kernels.tridiagonal import bands, solve_rows  # loads numba

        A = self.problem.A
        Z = np.zeros(Q.shape)
        Q, C, D = read_only((Q, C, D))
        matrix = bands(A.indptr, A.indices, A.data)
        limits = MAX_ROUNDS, STEPS_PER_ROUND

        def part(low: int, high: int) -> None:
            solve_rows(*matrix, Q[low:high], C[low:high], None if D is None else D[low:high], *limits, Z[low:high])

        self._on_threads(part, len(Q))
        return Z


def _row_norms(F: Matrix) -> Vector:
    """The norms of the rows of `F`, safe against over- and underflow of the squares; NaN where an entry is."""
    largest = np.abs(F).max(axis=1, keepdims=True)
    unit = np.where((largest > 0.0) & (largest < np.inf), largest, 1.0)
    return unit[:, 0] * np.linalg.norm(F / unit, axis=1)
