"""The dense LCP that is equivalent to a small problem with an affine ψ, in the form for pivoting."""

from __future__ import annotations

import math
from contextlib import suppress
from copy import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import SingularOperator
from ..numerics import work
from ..numerics.arrays import Mask, Vector, read_only
from ..numerics.fill import dense_cost
from ..numerics.rounding import SQRT_EPSILON
from ..numerics.threads import one_blas_thread
from ..problem.data import ProblemData
from ..problem.facts import Facts
from ..problem.map import Map
from ..problem.matrix import MAX_DENSE_ROWS

Matrix = NDArray[np.float64]


#: the largest number of pivots for a small LCP, in units of n + 1
MAX_PIVOTS_PER_ROW = 50
#: the largest number of rows of a problem, or of a block of one, that is solved by pivoting
PIVOT_UP_TO = MAX_DENSE_ROWS
#: number of arrays of n² entries held at once: A, its exponents and units, its scaled copy, and the dictionary
_WORK_ARRAYS = 5
#: nanoseconds, times n², to make and fill these arrays: 40 to 50 at n = 10⁴ and 2·10⁴, where all pages are new
_SETUP_COST = 45.0
#: the cost of an inverse and a product with it, in units of a factorisation
INVERSE_COST = 6.0


def lcp_rows(facts: Facts) -> int:
    """The number of rows of the LCP: one per unknown, and one per upper obstacle unless bounds on y stand for these."""
    return facts.matrix.n if in_box(facts) else obstacles(facts)


def obstacles(facts: Facts) -> int:
    """The number of unknowns plus that of upper obstacles; moving ones count in every row."""
    n = facts.matrix.n
    upper = facts.psi.upper
    if upper is None:
        return n
    return n + (int(np.count_nonzero(upper.value(np.zeros(n)) < np.inf)) if upper.is_constant else n)


def in_box(facts: Facts) -> bool:
    """Whether bounds on y stand for the two obstacles: both are fixed, or differ by a constant vector."""
    psi = facts.psi
    # an affine ψ that is equivalent to a fixed obstacle keeps its G
    is_fixed = facts.has_fixed_obstacle and (psi.is_constant or psi.linear is None)
    return is_fixed or bool(psi.parallel)


def too_large(facts: Facts) -> str | None:
    """Why pivoting is impossible: its dense arrays do not fit into memory. None if they fit."""
    n = lcp_rows(facts)
    if work.memory_suffices(_WORK_ARRAYS * 8.0 * n**2):
        return None
    return f"pivoting works on all n x n entries: with n = {n} they need {_WORK_ARRAYS * 8e-6 * n**2:.3g} MB"


class AffineLcp:
    """The LCP My + q ≥ 0, y ≥ 0 of an ICP with ψ(z) = Gz + c; with two obstacles y may have a second bound.

    Parameters
    ----------
    A : array of shape (n, n) or (k, n, n)
        The dense matrix, or k of them; then `M` holds k matrices as well.
    q, c : array of shape (n,)
        The vectors; with k matrices q has the shape (k, n).
    G : array of shape (n, n), optional
        Dense; None for 0.
    upper : tuple (d, H), optional
        The vector and the matrix (None for 0) of the upper obstacle Hz + d; None where there is none.
    adds_rows : bool, default True
        Whether the upper obstacle adds rows, because H differs from G.

    Raises
    ------
    SingularOperator
        Where I − G is singular.

    Notes
    -----
    y is z minus the obstacle whose constant is nearer to 0, and `bound` is y at the other one, of either sign, as in
    `kernels.dictionary`. In the rows `without_obstacle`, y has any sign and the inequality is an equation. An upper
    obstacle with H ≠ G adds one row for each of its rows. The first n rows are then Az + q + Ds ≥ 0, where D is the
    diagonal of max_j |a_ij|. The last entries of y are s ≥ 0, with the rows D(Hz + d − z) ≥ 0. So p may be negative
    where z is at the upper obstacle.

    References
    ----------
    Cottle, Pang and Stone, The Linear Complementarity Problem (1992), section 1.2, for the added
    rows.
    """

    def __init__(
        self,
        A: Matrix,
        q: Vector,
        c: Vector,
        G: Matrix | None = None,
        upper: tuple[Vector, Any] | None = None,
        adds_rows: bool = True,
    ) -> None:
        from .kernels.dictionary import nearest_obstacles  # loads numba

        self.n = A.shape[-1]
        self.rows: Any = None
        d = np.full(self.n, np.inf) if upper is None or adds_rows else upper[0]
        self.c, far = nearest_obstacles(*read_only((c, d)))
        with np.errstate(over="ignore"):
            self.bound = far - self.c
        self.M = A
        self.inverse = None
        if G is not None:
            with one_blas_thread():
                self.inverse = inverse_of_I_minus_G(G)
                self.M = A @ self.inverse
        if upper is not None and adds_rows:
            q = self._add_upper_rows(A, q, *upper)
        self.q = q + self.M @ self.c

    def _add_upper_rows(self, A: Matrix, q: Vector, d: Vector, H: Any) -> Vector:
        """Add the rows for the upper obstacle to M, c and `bound`; return q with them."""
        n = self.n
        self.rows = np.flatnonzero(d < np.inf)
        k = self.rows.size
        weight = np.abs(A).max(axis=-1)[..., self.rows]
        self.weight = np.where(weight > 0.0, weight, 1.0)
        moves = np.eye(n) if H is None else np.eye(n) - H
        if self.inverse is not None:
            moves = moves @ self.inverse
        M = np.zeros((*A.shape[:-2], n + k, n + k))
        M[..., :n, :n] = self.M
        M[..., n:, :n] = -self.weight[..., None] * moves[self.rows]
        M[..., self.rows, n + np.arange(k)] = self.weight
        self.M = M
        self.c = np.append(self.c, np.zeros(k))
        self.bound = np.append(self.bound, np.full(k, np.inf))
        return self.right_sides(q, d)

    @property
    def without_obstacle(self) -> Mask:
        """The rows without obstacle, a mask of the shape of q."""
        return np.isnan(self.bound)

    def right_sides(self, Q: Any, D: Any) -> Any:
        """[q, Dd], the q of the LCP before Mc is added, for the vectors q and d, or for the rows of `Q` and `D`."""
        return Q if self.rows is None else np.concatenate([Q, self.weight * D[..., self.rows]], axis=-1)

    def active_rows(self, y: Vector) -> tuple[Mask, Mask]:
        """The rows at an obstacle and those at the upper one for the final `y` of the pivots; masks of shape (n,)."""
        own = y[: self.n]
        bound = self.bound[: self.n]
        below = np.where(bound < 0.0, own == bound, (own == 0.0) & (bound >= 0.0))
        above = ~below & np.where(bound < 0.0, own == 0.0, own == bound)
        if self.rows is not None:
            above[self.rows] |= y[self.n :] > 0.0
        return below | above, above

    @property
    def covering(self) -> Vector:
        """The vector d in w = q + My + d·t, shape (m,) for m rows: 1, but 0 in the added rows.

        Where y = 0 violates an added row, `kernels.pivoting.start` replaces 0 by 1. So z stays between the
        obstacles along the path, which ends in a solution if all rows have both.
        """
        d = np.ones(self.M.shape[-1])
        d[self.n :] = 0.0
        return d

    def first_dictionary(self, covering: Vector | None = None, dropped: int | None = None) -> Any:
        """The arguments of `kernels.pivoting.continue_pivots` for a new run, without the last two.

        `covering` is the vector d in w = q + My + d·t for the scaled rows, by default the property of that name; it is
        0 in the added rows. With `dropped` = j, d is column j of the scaled M where that is positive. If no row is an
        equation, t then plays the role of y_j, and the condition y_j w_j = 0 is dropped along the path.
        """
        from .kernels import balancing, pivoting  # loads numba

        S, *units = balancing.scale(read_only(self.M))
        covering = self.covering if covering is None else covering * self.covering
        if dropped is not None:
            covering = np.where(S[:, dropped] > 0.0, S[:, dropped], covering)
        return pivoting.first_dictionary(S, *units, self.q, np.zeros(len(self.q)), self.bound, covering)

    def pivot_transform(self, rows: NDArray[np.int64]) -> AffineLcp:
        """The principal pivot transform: w_i and y_i change places in `rows`, where y_i has no upper bound.

        Raises SingularOperator where the condition number of M in the rows and columns `rows` is 1/√ε or more.
        """
        new = copy(self)
        block = self.M[np.ix_(rows, rows)]
        condition = math.inf
        with suppress(np.linalg.LinAlgError), np.errstate(all="ignore"):  # the inverse may overflow
            inverse = np.linalg.inv(block)
            condition = float(np.linalg.norm(block, 1) * np.linalg.norm(inverse, 1))
        if not SQRT_EPSILON * condition < 1.0:
            raise SingularOperator("M is singular in the rows that change places", int(rows[0]))
        columns = self.M[:, rows] @ inverse
        new.M = self.M - columns @ self.M[rows]
        new.M[rows] = -inverse @ self.M[rows]
        new.M[:, rows] = columns
        new.M[np.ix_(rows, rows)] = inverse
        new.q = self.q - columns @ self.q[rows]
        new.q[rows] = -inverse @ self.q[rows]
        return new

    def solve(self, covering: Vector | None = None, dropped: int | None = None) -> Vector | None:
        """The solution y by Lemke's pivots from `first_dictionary`, None where they find none. Raises OutOfTime."""
        from .kernels.pivoting import SOLVED, START  # loads numba

        state = self.first_dictionary(covering, dropped)
        ended, _, y, _ = run_pivots(state, START, MAX_PIVOTS_PER_ROW * (len(self.q) + 1))
        return y if ended == SOLVED else None

    def w(self, y: Vector) -> Vector:
        """q + My."""
        return self.q + self.M @ y

    def z(self, y: Vector) -> Vector:
        """z = (I − G)⁻¹(y + c)."""
        return self.solve_I_minus_G(y + self.c)

    def solve_I_minus_G(self, x: Any) -> Any:
        """(I − G)⁻¹x for a vector x, or for each row of a matrix, after the entries for added rows are dropped."""
        if self.rows is not None:
            x = x[..., : self.n]
        return x if self.inverse is None else x @ self.inverse.T


def dense_matrix(problem: ProblemData) -> Matrix:
    """A as a dense array for pivoting. Raises OutOfTime or OutOfMemory if the limits do not allow it."""
    entries = float(lcp_rows(problem.facts)) ** 2
    work.check_budget(_SETUP_COST * entries, _WORK_ARRAYS * 8.0 * entries)
    return problem.dense()


def dense_lcp(problem: ProblemData) -> AffineLcp:
    """The LCP of `problem`, whose ψ is affine or equivalent to a fixed obstacle. Raises SingularOperator, MapError."""
    A = dense_matrix(problem)
    upper = None if problem.upper is None else affine_obstacle(problem.facts, problem.upper)
    return AffineLcp(A, problem.q, *affine_obstacle(problem.facts, problem.psi), upper, not in_box(problem.facts))


def affine_obstacle(facts: Facts, psi: Map) -> tuple[Vector, Matrix | None]:
    """c and the dense G of Gz + c, where `psi` is the lower or the upper obstacle of `facts`.

    G is None where both are constant, or where they are not affine but equivalent to fixed ones. Raises MapError.
    """
    if facts.psi.is_constant or facts.psi.linear is None or psi.linear is None:
        c = facts.obstacle if psi is facts.psi else facts.upper_obstacle
        assert c is not None
        return c, None
    G, c = psi.linear
    return c, G.toarray()


def run_pivots(state: Any, entering: int, max_pivots: int) -> Any:
    """Make up to `max_pivots` pivots in pieces, on `state`; return as `continue_pivots` does. Raises OutOfTime."""
    from .kernels.pivoting import UNFINISHED, continue_pivots  # loads numba

    n = len(state[0])
    pivot_cost = work.COSTS.pivot_entry * n**2
    piece = work.steps_per_piece(pivot_cost)
    equations = np.count_nonzero(np.isnan(state[4])) if entering < 0 else 0
    if equations:  # they are eliminated in one piece, by at most n pivots
        work.check_budget(n * pivot_cost)
        work.count(equations * pivot_cost)
    while True:
        count = min(piece, max_pivots)
        work.check_budget(min(count, n) * pivot_cost)
        result = continue_pivots(*state, entering, count)
        # unfinished: as many pivots as were requested; else at least one for each nonzero entry of the solution
        work.count(pivot_cost * (count if result[0] == UNFINISHED else np.count_nonzero(result[2]) + 1))
        max_pivots -= count
        entering = result[1]
        if result[0] != UNFINISHED or max_pivots == 0:
            return result


def inverse_of_I_minus_G(G: Matrix) -> Matrix:
    """(I − G)⁻¹, shape (n, n). Raises SingularOperator."""
    work.check_budget(INVERSE_COST * dense_cost(len(G)))
    with suppress(np.linalg.LinAlgError):
        return np.asarray(np.linalg.inv(np.eye(len(G)) - G), dtype=np.float64)
    raise SingularOperator("I - G is singular", 0)
