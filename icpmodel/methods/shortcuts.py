"""Shortcuts: methods that solve small or narrow problems without the modulus equation.

Lemke: an LCP with a fixed or affine obstacle is solved by pivots on a dense dictionary in finitely many steps, or
proved to have no solution.
Josephy: ψ is linearised at zᵏ, and the affine problem solved by pivots.
Tridiagonal: problems in one dimension, solved directly in O(n).
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from contextlib import suppress
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..algebra.affine_lcp import AffineLcp, dense_lcp, dense_matrix, run_pivots, too_large
from ..algebra.equations import linearised, solve_on
from ..errors import SingularOperator
from ..numerics import work
from ..numerics.arrays import Vector
from ..problem.data import ProblemData
from ..problem.map import Map
from ..theory.certificates.infeasible import infeasible
from .contract import REDUCTION, Infeasible, Iterate, Method, why_not_diagonal, with_options
from .newton import MAX_HALVINGS

#: rounds of Newton's steps, and steps in a round; where A is an M-matrix one step usually suffices
MAX_ROUNDS = 5
STEPS_PER_ROUND = 10
#: steps of iterative refinement, for the last digit
_REFINEMENTS = 2


class Shortcut(Method):
    """The common base of these methods."""

    family: ClassVar[str] = "shortcut"
    finite: ClassVar[bool] = True


@with_options
class Lemke(Shortcut):
    """Lemke's method: pivots between bases of w = q + My + d·t, wᵀy = 0, until t is 0.

    One iterate is up to n pivots. The start has no influence.

    Notes
    -----
    **Form.** For ψ = c it is M = A and y = z − c. For ψ = Gz + c it is M = A(I − G)⁻¹ and y = (I − G)z − c. An upper
    obstacle with the same G bounds y; another one adds rows. If ψ is not affine, but every ψ_i depends on z_i alone and
    changes by less than z_i, a fixed obstacle replaces it. Rows without obstacle are eliminated first. Where A is
    singular there, other rows change places as well, a principal pivot transform. An equation that nearly depends on
    others is left out at first.

    **Ties** in the ratio test are broken lexicographically, so that no basis recurs. If one does, rounding has hidden a
    tie. Then the pivots begin again with q perturbed by 1e-8 of its size. The last basis is refined, for q itself.

    **What it solves.** It finds a solution where A is a P-matrix, or all rows have two fixed obstacles. Where A is
    positive semidefinite (copositive-plus) it finds one if there is any. Otherwise it may end in a ray, which is tried
    as a proof that p ≥ 0 and r ≥ 0 contradict each other. If it is one, `Infeasible` is raised, else the method ends.

    References
    ----------
    Lemke, Management Science 11 (1965). Cottle, Pang and Stone, The Linear Complementarity Problem (1992), sections 4.4
    and 4.9.

    Examples
    --------
    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(Lemke()).z
    array([1., 1.])
    """

    name: ClassVar[str] = "lemke"

    def why_not(self, problem: ProblemData) -> str | None:
        if problem.psi.linear is None and not problem.facts.has_fixed_obstacle:
            expected = "constant or affine, or dependent on z_i alone with a slope below 1"
            return f"pivoting needs a psi that is {expected}, not {problem.psi!r}"
        return too_large(problem.facts)

    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[Iterate]:
        # raises SingularOperator where I − G is singular, or A in the rows without obstacle
        from ..algebra.kernels.pivoting import FULL_RANK, PERTURBED, SINGULAR, SOLVED, START, UNFINISHED  # loads numba

        yield z, None
        lcp = dense_lcp(problem)
        rows = len(lcp.q)
        state = lcp.first_dictionary()
        ended = UNFINISHED
        for first in (START, PERTURBED, FULL_RANK):
            if first == PERTURBED and ended != UNFINISHED:
                continue
            ended, y, ray = yield from _path(lcp, state, first)
            if ended == SOLVED:
                with suppress(SingularOperator):  # then the z of the pivots remains
                    z = solve_on(problem, lcp.z(y), *lcp.active_rows(y))
                    yield z, None
            elif ended != UNFINISHED or first != START:
                raise_if_infeasible(problem, ray[: problem.n])
            basic = state[8][0, :rows]
            left_out = lcp.without_obstacle[basic[basic < rows]].any()
            if ended != SINGULAR and (ended, first) != (UNFINISHED, START) and not left_out:
                break
        if ended == SINGULAR:
            raise SingularOperator(
                "A is singular in the rows and columns without obstacle", int(np.argmax(lcp.without_obstacle))
            )


def raise_if_infeasible(problem: ProblemData, y: Vector) -> None:
    """Raise Infeasible where `y` proves that p ≥ 0 and r ≥ 0 contradict each other."""
    answer = infeasible(problem, y)
    if answer.holds:
        raise Infeasible(answer)


def _path(lcp: AffineLcp, state: Any, entering: int) -> Generator[Iterate, None, tuple[int, Vector, Vector]]:
    """Yield an iterate after every n pivots, until the path ends or a basis comes back.

    Returns (how it ended, y, the direction of the ray).
    """
    from ..algebra.kernels.pivoting import SINGULAR, UNFINISHED  # loads numba

    seen = set[bytes]()
    ended = UNFINISHED
    while ended == UNFINISHED:
        ended, entering, y, ray = run_pivots(state, entering, len(lcp.q))
        if ended == SINGULAR:
            break
        yield lcp.z(y), None  # where a ray begins because A is nearly singular, t may be as good as 0
        basic, _, mirrored = state[8][:3, : len(lcp.q)]
        basis = np.append(np.sort(basic), mirrored).tobytes()
        if basis in seen:
            break
        seen.add(basis)
    return ended, y, ray


@with_options
class Josephy(Shortcut):
    """zᵏ⁺¹ solves the ICP with ψ(zᵏ) + ψ′(zᵏ)(z − zᵏ) in place of ψ, by the pivots of `Lemke`.

    Near a solution where these affine problems have one answer each the steps converge quadratically. A step that does
    not reduce the residual is halved. Where that does not help, I − ψ′ is singular, or the pivots end in a ray, the
    method ends.

    References
    ----------
    Josephy, Newton's method for generalized equations, MRC Technical Summary Report 1965 (1979). Cottle, Pang and
    Stone, The Linear Complementarity Problem (1992), section 4.4, for the pivots.

    Examples
    --------
    >>> psi = icp.Elementwise(np.cos, lambda z: -np.sin(z))
    >>> ICP([[2.0]], [-1.0], psi).solve(icp.Josephy()).z.round(9)
    array([0.73908513])
    """

    name: ClassVar[str] = "josephy"

    def why_not(self, problem: ProblemData) -> str | None:
        return too_large(problem.facts) or problem.psi.no_derivative()

    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[Iterate]:
        best = problem.residual(z)
        yield z, best
        A = dense_matrix(problem)
        with suppress(SingularOperator):
            while best > 0.0:
                upper = None if problem.upper is None else _linearise(problem.upper, z)
                lcp = AffineLcp(A, problem.q, *_linearise(problem.psi, z), upper, not problem.psi.parallel)
                y = lcp.solve()
                if y is None:
                    break
                step = lcp.z(y) - z
                following = _shorten_step(problem, z, step, best)
                if following is None:
                    yield z + step, None  # ψ may have no value there, which then ends the run
                    break
                z, best = following
                yield z, best


@with_options
class Tridiagonal(Shortcut):
    """Find the rows off the obstacle in one pass, and z by one tridiagonal system.

    Rows are added one by one, from the top, to a problem whose solution is known. Where a row leaves the obstacle, rows
    above it may have to follow. A run of free rows is represented by the corners of the inverse of its block, so that
    two runs are joined in one step, whatever their length.

    For tridiagonal M-matrices this finds the active set up to rounding. Newton's steps correct the rounding: z_i = c_i
    where p_i ≥ a_ii(z_i − c_i), p_i = 0 elsewhere. For other matrices these steps start from the set that was found,
    and the method ends where they fail.

    With an upper obstacle z_i = ψ̄_i where p_i < a_ii(z_i − ψ̄_i). The pass takes the lower obstacle only. Where ten
    steps do not find the active set, the rows at each obstacle are found in turn, with those at the other one held. The
    start z⁰ has no influence.

    References
    ----------
    Cryer, ACM Trans. Math. Softw. 9 (1983), for a direct method on tridiagonal M-matrices. Chandrasekaran, Opsearch 7
    (1970): rows that have left the obstacle stay off it.

    Examples
    --------
    >>> ICP([[2, -1, 0], [-1, 2, -1], [0, -1, 2]], [-1, 3, -1]).solve(Tridiagonal()).z
    array([0.5, 0. , 0.5])
    """

    name: ClassVar[str] = "tridiagonal"

    def why_not(self, problem: ProblemData) -> str | None:
        if problem.nnz > 3 * problem.n - 2:
            return f"A is not tridiagonal: it has {problem.nnz} entries"
        if not problem.facts.has_fixed_obstacle:
            return f"psi_i has to depend on z_i alone, with a slope below 1, which is not known of {problem.psi!r}"
        rows = problem.matrix.rows
        if max(rows.below, rows.above) > 1:
            reach = f"reach {rows.below} rows below the diagonal and {rows.above} above"
            return f"A is not tridiagonal: its entries {reach}"
        return why_not_diagonal(problem, "it divides by the diagonal of A")

    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[Iterate]:
        from ..algebra.kernels.tridiagonal import SETTLED, UNSETTLED, alternate, bands, free_rows, newton, refine

        yield z, None
        A = problem.A
        q = problem.q
        c = problem.facts.obstacle
        top = problem.facts.upper_obstacle
        matrix = bands(A.indptr, A.indices, A.data)
        obstacle = c if top is None else c.copy()
        free = free_rows(*matrix, q, c)
        for number in range(MAX_ROUNDS if top is None else 2):
            candidate, ended = newton(*matrix, q, c, top, obstacle, free, STEPS_PER_ROUND)
            work.count(work.sweep_cost(problem.n, problem.nnz))
            if np.isfinite(candidate).all():
                z = candidate
                yield z, None
            if ended != UNSETTLED:
                break
            if top is not None and number == 0:
                alternate(*matrix, q, c, top, MAX_ROUNDS, STEPS_PER_ROUND, obstacle, free)
                work.count(2.0 * MAX_ROUNDS * work.sweep_cost(problem.n, problem.nnz))
        for _ in range(_REFINEMENTS if ended == SETTLED else 0):
            z = refine(*matrix, q, free, z)
            yield z, None


def _shorten_step(problem: ProblemData, z: Vector, step: Vector, residual: float) -> tuple[Vector, float] | None:
    """z + t·step and its residual for the first t of 1, 1/2, 1/4, … that reduces `residual` enough, or None."""
    for k in range(MAX_HALVINGS):
        following = z + 0.5**k * step
        reduced = problem.residual(following)
        if reduced <= (1.0 - (1.0 - REDUCTION) * 0.5**k) * residual:
            return following, reduced
    return None


def _linearise(psi: Map, z: Vector) -> tuple[Vector, NDArray[np.float64]]:
    """c and the dense G of Gx + c, which is ψ or its linearisation at `z`. Raises MapError where it is not finite."""
    G, c = linearised(psi, z)
    return c, G.toarray()
