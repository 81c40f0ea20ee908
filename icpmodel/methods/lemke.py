"""Lemke's complementary pivot method: small LCPs solved in finitely many steps, or proved to have no solution."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..algebra.equations import solve_on
from ..algebra.subproblems import with_fixed_obstacle
from ..errors import SingularOperator
from ..numerics.arrays import Vector
from ..problem.affine import Affine
from ..problem.data import ProblemData
from ..theory.certificates.infeasible import infeasible, multipliers
from .contract import Infeasible, Method

Matrix = NDArray[np.float64]

#: the dictionary has n² entries, and every pivot changes all of them
UP_TO = 500
#: so many pivots, times n + 1, and an LCP that is one of many counts as not solved
PIVOTS = 50


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Lemke(Method):
    """Pivots from basis to basis of w = q + My + d·t, wᵀy = 0, t falling to 0; one iterate is up to n pivots.

    ψ = c: M = A, and y = z − c. ψ = Gz + c: M = A(I − G)⁻¹, and y = (I − G)z − c. A ψ_i that moves with z_i alone, and
    by less than it, is a constant (see `with_fixed_obstacle`). Rows without obstacle are eliminated
    first. Ties in the ratio test are broken lexicographically, so that, but for rounding, no basis comes back; the last
    one is refined. The start has no influence. It finds a solution where A is a P-matrix, and one, if there is any,
    where A is positive semidefinite (copositive-plus). Else it may end in a ray, which is tried as a proof that p ≥ 0
    and r ≥ 0 contradict each other, as is the y of a linear program: then it raises `Infeasible`, and if neither is
    one, it stands still.
    References: Lemke, Management Science 11 (1965); Cottle, Pang and Stone, The Linear Complementarity Problem (1992),
    sections 4.4 and 4.9.

    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(Lemke()).z
    array([1., 1.])
    """

    name: ClassVar[str] = "lemke"
    memoryless: ClassVar[bool] = False

    def why_not(self, problem: ProblemData) -> str | None:
        """See `Method.why_not`: ψ must be affine, or every ψ_i move with z_i alone, by less than it; and n small.

        >>> Lemke().why_not(ICP([[2.0]], [1.0], np.sin))
        'pivoting needs a psi that is constant or affine, or moves with z_i alone and by less, not Function(sin)'
        """
        if not (isinstance(problem.psi, Affine) or problem.facts.has_fixed_obstacle):
            wanted = "constant or affine, or moves with z_i alone and by less"
            return f"pivoting needs a psi that is {wanted}, not {problem.psi!r}"
        if problem.n > UP_TO:
            return f"pivoting works on all n x n entries: n = {problem.n} is more than {UP_TO}"
        return None

    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[tuple[Vector, float | None]]:
        """See `Method.iterates`. Raises SingularOperator where I − G is, or A in the rows without obstacle."""
        from ..numerics.kernels.pivoting import RAY, SINGULAR, UNFINISHED, go_on  # loads numba

        yield z, None
        psi = problem.psi
        if isinstance(psi, Affine):
            lcp = Linear(problem.dense(), problem.q, psi.c, psi.G.toarray())
        else:
            lcp = Linear(problem.dense(), problem.q, with_fixed_obstacle(problem).psi.value(z))
        state = lcp.start()
        ended, entering = UNFINISHED, -1
        while ended == UNFINISHED:
            ended, entering, y, ray = go_on(*state, entering, problem.n)
            if ended == SINGULAR:
                row = int(np.argmax(lcp.free))
                raise SingularOperator("A is singular in the rows and columns without obstacle", row)
            z = lcp.z(y)  # where a ray begins because A is nearly singular, t may be as good as 0
            yield z, None
        if ended == RAY:
            answer = infeasible(problem, ray)
            if not answer.holds and (y := multipliers(problem)) is not None:
                answer = infeasible(problem, y)
            if answer.holds:
                raise Infeasible(answer)
        else:
            with suppress(SingularOperator):  # then what the pivots found has to do
                z = solve_on(problem, z, ~lcp.free & (y == 0.0))
        while True:
            yield z, None


class Linear:
    """The LCP My + q ≥ 0, y ≥ 0 (0 and any sign in the rows that are `free`) behind an ICP with ψ(z) = Gz + c.

    Parameters: `A` dense, shape (n, n); `q` and `c` shape (n,); `G` dense, shape (n, n), or its diagonal, shape (n,),
    if it is one, or None for 0. Raises SingularOperator where I − G is singular.
    """

    def __init__(self, A: Matrix, q: Vector, c: Vector, G: Matrix | Vector | None = None) -> None:
        self.free = np.isneginf(c)
        self.c = np.where(self.free, 0.0, c)
        self.M, self.inverse = A, None
        if G is not None:
            self.inverse = _inverse(G)
            self.M = A * self.inverse if G.ndim == 1 else A @ self.inverse
        self.q = q + self.M @ self.c

    def start(self) -> Any:
        """The first dictionary, as `kernels.pivoting.go_on` takes it."""
        from ..numerics.kernels.balancing import scale
        from ..numerics.kernels.pivoting import begin  # loads numba

        return begin(*scale(self.M), self.q, self.free)

    def z(self, y: Vector) -> Vector:
        """The z that belongs to y."""
        return self.back(y + self.c)

    def back(self, x: Any) -> Any:
        """(I − G)⁻¹x, for x of shape (n,) or for all rows of a matrix."""
        if self.inverse is None:
            return x
        return x * self.inverse if self.inverse.ndim == 1 else x @ self.inverse.T


def _inverse(G: Matrix | Vector) -> Any:
    """(I − G)⁻¹, as a diagonal where G is one."""
    if G.ndim == 1 and (G != 1.0).all():
        return 1.0 / (1.0 - G)
    with suppress(np.linalg.LinAlgError):
        if G.ndim == 2:
            return np.linalg.inv(np.eye(len(G)) - G)
    raise SingularOperator("I - G is singular", 0)
