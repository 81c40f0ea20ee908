"""All solutions of a small problem with affine obstacles, confirmed in rational arithmetic.

The problem is a union of linear pieces (see `algebra.linear_rows`). First, pieces that certainly hold no solution are
discarded in floats, with bounds on the rounding errors. Then those with contradictory equations are discarded in
integers. Every remaining piece is solved in rational arithmetic. Where its linear system is singular, its solutions are
a polyhedron, given by a point and directions.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from ..algebra.linear_rows import LinearRows, RowEquation, piece_count
from ..errors import Interrupted, NotApplicable, OutOfTime
from ..numerics import work
from ..numerics.arrays import ReadOnly, Vector, as_number
from ..numerics.rational import (
    Echelon,
    Rational,
    affine_solutions,
    dot,
    in_integers,
    nearest,
    rationals,
    relative_interior,
    with_row,
)
from ..numerics.rounding import public_entry
from ..present.display import Displayable, counted
from ..problem.data import ProblemData, ProblemLike, as_problem

#: problems with more pieces are refused; this many take half a minute
MAX_PIECES = 262_144


@dataclass(frozen=True, eq=False, repr=False)
class Face(ReadOnly, Displayable):
    """Solutions that are not isolated: `point` + combinations of `directions`, as far as p and r keep their signs.

    Attributes
    ----------
    point : ndarray, shape (n,)
        A solution in the relative interior of the face, rounded once.
    directions : ndarray, shape (k, n)
        A basis of the k directions in which z may move without leaving the solutions.

    Examples
    --------
    >>> (segment,) = icp.all_solutions(ICP([[1, 1], [1, 1]], [-2, -2])).faces
    >>> segment.point, segment.directions
    (array([1., 1.]), array([[-1.,  1.]]))
    """

    point: Vector
    directions: Any


@dataclass(frozen=True, eq=False, repr=False)
class SolutionSet(ReadOnly, Displayable):
    """The solutions of a problem that were found; all of them if `complete`.

    Attributes
    ----------
    points : ndarray, shape (m, n)
        The isolated solutions, each correct to one rounding.
    faces : tuple of Face
        Segments, rays, lines and larger polyhedra of solutions.
    pieces : int
        The number of linear pieces that were examined.
    complete : bool
        Whether these are all solutions: every piece was examined.

    Examples
    --------
    >>> found = icp.all_solutions(ICP([[-1]], [1]))
    >>> len(found), found.complete, found.points
    (2, True, array([[0.],
           [1.]]))
    """

    points: Any
    faces: tuple[Face, ...]
    pieces: int
    complete: bool

    def __len__(self) -> int:
        """The number of isolated solutions and of faces."""
        return len(self.points) + len(self.faces)

    def __str__(self) -> str:
        isolated = counted(len(self.points) or "no", "isolated solution")
        faces = counted(len(self.faces) or "no", "face")
        examined = "all" if self.complete else "not all"
        rows = [f"{isolated} and {faces} of solutions; {examined} {self.pieces} linear pieces were examined"]
        rows += [f"z = {listed(point)}" for point in self.points]
        for face in self.faces:
            along = ", ".join(listed(direction) for direction in face.directions)
            rows.append(f"z = {listed(face.point)}, and it may move along {along}")
        return "\n".join(rows)


def listed(z: Vector) -> str:
    """The entries of `z` in parentheses."""
    return "(" + ", ".join(f"{entry:.6g}" for entry in z) + ")"


@dataclass(frozen=True, eq=False)
class _ExactSolutions:
    """In fractions: an isolated solution, or a polyhedron of them by a relative interior point and its directions."""

    point: Rational
    directions: list[Rational]

    def rounded(self) -> Face:
        """The same in floats."""
        return Face(_round_exact(self.point), np.array([_round_exact(direction) for direction in self.directions]))


class ExactRows:
    """The rows p, r and s of `LinearRows`, each scaled to integers: every float is a fraction.

    A row holds the coefficients of z and a constant; it is None where there is no obstacle.
    """

    def __init__(self, problem: ProblemData) -> None:
        # raises NotApplicable where an obstacle is not affine
        if problem.psi.linear is None:
            raise NotApplicable(f"pieces are linear only for constant and affine obstacles, not for {problem.psi!r}")
        self.n = problem.n
        self.p = [in_integers(row) for row in rationals(np.column_stack([problem.dense(), problem.q]))]
        self.r = _distance_rows(problem.psi.linear, 1)
        of_upper = None if problem.upper is None else problem.upper.linear
        self.s = [None] * self.n if of_upper is None else _distance_rows(of_upper, -1)
        self.rows: dict[int, list[Any]] = {
            RowEquation.FREE: self.p,
            RowEquation.LOWER: self.r,
            RowEquation.UPPER: self.s,
        }

    def equations(self, sides: Any) -> list[list[int]]:
        """The rows that have to be 0 in a piece."""
        return [self.rows[side][i] for i, side in enumerate(sides)]

    def inequalities(self, sides: Any) -> list[list[int]]:
        """The rows that have to be ≥ 0 in a piece."""
        system = []
        for i, side in enumerate(sides):
            if side != RowEquation.FREE:
                system.append(self.p[i] if side == RowEquation.LOWER else [-entry for entry in self.p[i]])
            others = (
                row
                for obstacle, row in ((RowEquation.LOWER, self.r[i]), (RowEquation.UPPER, self.s[i]))
                if obstacle != side
            )
            system.extend(row for row in others if row is not None)
        return system

    def consistent(self, pieces: Iterable[Any]) -> Iterator[Any]:
        """Yield the `pieces` whose equations are consistent, whatever the signs. Raises OutOfTime.

        Leading rows that a piece shares with the previous one are not eliminated again. So a contradiction among them
        excludes all consecutive pieces that share them.
        """
        before: Any = ()
        echelons: list[Echelon] = [()]
        for sides in pieces:
            work.check_budget()
            shared = next((i for i, (a, b) in enumerate(zip(before, sides, strict=False)) if a != b), len(before))
            del echelons[shared + 1 :]
            while len(echelons) <= self.n and not self._is_contradiction(echelons[-1]):
                i = len(echelons) - 1
                echelons.append(with_row(echelons[-1], self.rows[sides[i]][i]))
            before = sides
            if not self._is_contradiction(echelons[-1]):
                yield sides

    def _is_contradiction(self, echelon: Echelon) -> bool:
        return bool(echelon) and echelon[-1][0] == self.n  # 0 = c ≠ 0

    def solve(self, sides: Any) -> _ExactSolutions | None:
        """The solutions of the problem in a piece; None if there are none."""
        solutions = affine_solutions(self.equations(sides), self.n)
        if solutions is None:
            return None
        start, span = solutions
        signs = [[*(dot(row, one) for one in span), dot(row, start) + row[-1]] for row in self.inequalities(sides)]
        t = relative_interior(signs, len(span))
        if t is None:
            return None
        equations = [[*row[:-1], Fraction(0)] for row in signs if dot(row, [*t, 1]) == 0]
        within = affine_solutions(equations, len(span))
        assert within is not None  # 0 is in it
        none = [Fraction(0)] * self.n
        return _ExactSolutions(_sum(start, span, t), [_sum(none, span, direction) for direction in within[1]])

    def lies_in(self, solutions: _ExactSolutions, sides: Any) -> bool:
        """Whether the set `solutions` lies in the piece `sides`. Raises OutOfTime.

        The equations of the piece have to hold at the point and in every direction. A sign that holds at a point of
        the relative interior holds on all of `solutions`.
        """
        work.check_budget()
        return all(
            dot(row, solutions.point) + row[-1] == 0 and not any(dot(row, one) for one in solutions.directions)
            for row in self.equations(sides)
        ) and all(dot(row, solutions.point) + row[-1] >= 0 for row in self.inequalities(sides))


class _Distinct:
    """The sets of solutions found so far that lie in no other one: isolated `points` and `faces`."""

    def __init__(self, exact: ExactRows) -> None:
        self.exact = exact
        self.points: dict[tuple[Fraction, ...], _ExactSolutions] = {}
        self.faces: list[tuple[Any, _ExactSolutions]] = []

    def add(self, sides: Any, found: _ExactSolutions) -> None:
        """Add the solutions in the piece `sides`; drop sets that lie in it. If OutOfTime is raised, nothing changes."""
        if any(self.exact.lies_in(found, other) for other, _ in self.faces):
            return
        if not found.directions:
            self.points[tuple(found.point)] = found
            return
        points = {point: one for point, one in self.points.items() if not self.exact.lies_in(one, sides)}
        faces = [(other, one) for other, one in self.faces if not self.exact.lies_in(one, sides)]
        self.faces = [*faces, (sides, found)]
        self.points = points


def _distance_rows(linear: Any, sign: int) -> list[Any]:
    """The rows of `sign` · (z − ψ(z)) for ψ = Gz + c in integers, None where c is infinite."""
    G, c = linear
    rows = []
    for i, (slopes, end) in enumerate(zip(rationals(G), c.tolist(), strict=True)):
        row = [-sign * slope for slope in slopes]
        row[i] += sign
        rows.append(in_integers([*row, -sign * Fraction(end)]) if np.isfinite(end) else None)
    return rows


def _round_exact(x: Rational) -> Vector:
    return np.array([nearest(entry) for entry in x])


def _sum(start: Rational, span: list[Rational], t: Rational) -> Rational:
    return [one + sum((w * v[j] for w, v in zip(t, span, strict=True)), Fraction(0)) for j, one in enumerate(start)]


@public_entry
@np.errstate(all="ignore")  # what overflows proves nothing
def all_solutions(problem: ProblemLike, *, time_limit: float | None = None) -> SolutionSet:
    """Find all solutions of a small problem with constant or affine obstacles.

    Parameters
    ----------
    problem : ICP, or what holds or makes one
        Of up to 2¹⁸ linear pieces: n ≤ 18 with one obstacle in every row, n ≤ 11 with two.
    time_limit : float, optional
        Seconds, after which the solutions found so far are returned, with ``complete`` False.

    Returns
    -------
    SolutionSet
        Isolated solutions, and faces where solutions are not isolated, confirmed in rational arithmetic.

    Raises
    ------
    NotApplicable
        Where an obstacle is not affine, or there are too many pieces.
    Interrupted
        After Ctrl-C; it carries the solutions found so far.

    Notes
    -----
    In every row one of three equations holds: p_i = 0, z_i = ψ_i(z) or z_i = ψ̄_i(z). Each choice leaves a linear
    system, which is solved and whose signs are checked. The data are taken as exact: every float is a fraction.

    References
    ----------
    Cottle, Pang and Stone, The Linear Complementarity Problem (1992), section 1.3: complementary cones.

    Examples
    --------
    >>> print(icp.all_solutions(ICP([[0, 1], [1, 0]], [-1, -1])))
    1 isolated solution and no faces of solutions; all 4 linear pieces were examined
    z = (1, 1)
    """
    problem = as_problem(problem)
    if time_limit is not None:
        as_number(time_limit, "time_limit", minimum=0)
    exact = ExactRows(problem)
    count = piece_count(problem)
    if count > MAX_PIECES:
        raise NotApplicable(f"problem has too many linear pieces (more than {MAX_PIECES}): solve() finds one solution")
    distinct = _Distinct(exact)
    end: BaseException | None = None
    with work.work_limit(np.inf if time_limit is None else time_limit):
        try:
            for sides in exact.consistent(plausible(problem)):
                one = exact.solve(sides)
                if one is not None:
                    distinct.add(sides, one)
        except (OutOfTime, KeyboardInterrupt) as error:
            end = error
    points = sorted(_round_exact(point.point).tolist() for point in distinct.points.values())
    faces = tuple(face.rounded() for _, face in sorted(distinct.faces, key=lambda pair: -len(pair[1].directions)))
    solutions = SolutionSet(np.array(points).reshape(-1, problem.n), faces, int(count), end is None)
    if isinstance(end, KeyboardInterrupt):
        raise Interrupted(solutions) from None
    return solutions


def plausible(problem: ProblemData) -> Any:
    """Yield the pieces that floats, rounding included, do not prove to hold no solution. Raises OutOfTime."""
    for batch in LinearRows.of(problem, np.zeros(problem.n)).batches():
        yield from batch.sides[~batch.empty]
