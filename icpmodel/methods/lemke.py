"""Lemke's complementary pivot method: small LCPs solved in finitely many steps, or proved to have no solution."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..arrays import Vector
from ..errors import SingularOperator
from ..maps import Affine, Constant
from ..problem import ICP
from ..theory.certificates.equations import solve_on
from ..theory.certificates.infeasible import infeasible
from . import Infeasible, Method

#: the dictionary has n² entries, and every pivot changes all of them
UP_TO = 500


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Lemke(Method):
    """Pivots from basis to basis of w = q + My + d·t, wᵀy = 0, t falling to 0; one iterate is up to n pivots.

    ψ = c: M = A, and y = z − c. ψ = Gz + c: M = A(I − G)⁻¹, and y = (I − G)z − c. Rows without obstacle are eliminated
    first. Ties in the ratio test are broken lexicographically, so that, but for rounding, no basis comes back; the last
    one is refined. The start has no influence. It finds a solution where A is a P-matrix, and one, if there is any,
    where A is positive semidefinite (copositive-plus). Else it may end in a ray, which is tried as a proof that p ≥ 0
    and r ≥ 0 contradict each other: then it raises `Infeasible`, and if it is none, it stands still.
    References: Lemke, Management Science 11 (1965); Cottle, Pang and Stone, The Linear Complementarity Problem (1992),
    sections 4.4 and 4.9.

    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(Lemke()).z
    array([1., 1.])
    """

    name: ClassVar[str] = "lemke"
    memoryless: ClassVar[bool] = False

    def why_not(self, problem: ICP) -> str | None:
        """See `Method.why_not`: ψ must be constant or affine, and n small.

        >>> Lemke().why_not(ICP([[2.0]], [1.0], np.sin))
        'pivoting needs a psi that is constant or affine, not Function(sin)'
        """
        if not isinstance(problem.psi, Constant | Affine):
            return f"pivoting needs a psi that is constant or affine, not {problem.psi!r}"
        if problem.n > UP_TO:
            return f"pivoting works on all n x n entries: n = {problem.n} is more than {UP_TO}"
        return None

    def iterates(self, problem: ICP, z: Vector) -> Iterator[tuple[Vector, float | None]]:
        """See `Method.iterates`. Raises SingularOperator where I − G is, or A in the rows without obstacle."""
        from ..kernels.pivoting import RAY, SINGULAR, UNFINISHED, begin, go_on  # loads numba
        from ..kernels.units import scale

        yield z, None
        lcp = _Linear(problem)
        state = begin(*scale(lcp.M), lcp.q, lcp.free)
        ended, entering = UNFINISHED, -1
        while ended == UNFINISHED:
            ended, entering, y = go_on(*state, entering, problem.n)
            if ended == SINGULAR:
                row = int(np.argmax(lcp.free))
                raise SingularOperator("A is singular in the rows and columns without obstacle", row)
            if ended != RAY:
                z = lcp.z(y)
                yield z, None
        if ended == RAY:
            answer = infeasible(problem, y)
            if answer.holds:
                raise Infeasible(answer)
        else:
            with suppress(SingularOperator):  # then what the pivots found has to do
                z = solve_on(problem, z, ~lcp.free & (y == 0.0))
        while True:
            yield z, None


class _Linear:
    """The LCP My + q ≥ 0, y ≥ 0 (0 and any sign in the rows that are `free`) behind an ICP with affine ψ."""

    def __init__(self, problem: ICP) -> None:
        psi: Any = problem.psi
        self.M = problem.dense()
        self.free = np.isneginf(psi.c)
        self.c = np.where(self.free, 0.0, psi.c)
        self.inverse = None
        if isinstance(psi, Affine):
            try:
                self.inverse = np.linalg.inv(np.eye(problem.n) - psi.G.toarray())
            except np.linalg.LinAlgError:
                raise SingularOperator("I - G is singular", 0) from None
            self.M = self.M @ self.inverse
        self.q = problem.q + self.M @ self.c

    def z(self, y: Vector) -> Vector:
        """The z that belongs to y."""
        z: Vector = y + self.c
        return z if self.inverse is None else self.inverse @ z
