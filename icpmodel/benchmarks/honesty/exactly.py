"""What is true of an answer, in fractions: a judge that shares nothing with the package's own."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from fractions import Fraction
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

Vector = list[Fraction]
Matrix = list[Vector]

#: all active sets of so many unknowns are tried
_MOST = 4
#: one active set of so many unknowns is tried
_MOST_NEARBY = 16
#: as an obstacle: none
_NONE = -math.inf


def fractions(values: Any) -> list[Any]:
    """Finite floats as fractions, −inf as it is."""
    return [Fraction(value) if math.isfinite(value) else value for value in np.asarray(values, np.float64).tolist()]


def solved_system(M: Matrix, b: Vector) -> Vector | None:
    """x with Mx = b, None where M is singular."""
    n, rows = len(b), [[*row, right] for row, right in zip(M, b, strict=True)]
    for k in range(n):
        pivot = next((i for i in range(k, n) if rows[i][k]), None)
        if pivot is None:
            return None
        rows[k], rows[pivot] = rows[pivot], rows[k]
        for i in range(n):
            if i != k and rows[i][k]:
                factor = rows[i][k] / rows[k][k]
                rows[i] = [x - factor * y if y else x for x, y in zip(rows[i], rows[k], strict=True)]
    return [rows[i][n] / rows[i][i] for i in range(n)]


def _times(row: Sequence[Fraction], x: Vector) -> Fraction:
    return sum((a * b for a, b in zip(row, x, strict=True) if a and b), Fraction(0))


class ExactProblem:
    """An ICP in fractions; ψ = Gz + c exactly, any other ψ by the values that it gives in floats."""

    def __init__(self, problem: Any) -> None:
        self.A, self.n = problem.A, problem.n
        self.q, self.psi, self.linear = fractions(problem.q), problem.psi, problem.psi.linear

    @cached_property
    def rows(self) -> list[list[tuple[int, Fraction]]]:
        """The entries of A."""
        A = self.A
        return [
            [(int(j), Fraction(x)) for j, x in zip(A.indices[low:high], A.data[low:high].tolist(), strict=True) if x]
            for low, high in zip(A.indptr[:-1], A.indptr[1:], strict=True)
        ]

    def obstacle(self, z: Vector) -> list[Any]:
        """ψ(z); raises what the user's function raises, ValueError for NaN."""
        if self.linear is None:
            value = np.asarray(self.psi.value(np.array([float(x) for x in z])))
            if np.isnan(value).any() or np.isposinf(value).any():
                raise ValueError
            return fractions(value)
        G, c = self.linear[0].tocsr(), fractions(self.linear[1])
        for i in range(self.n):
            for k in range(G.indptr[i], G.indptr[i + 1]):
                if c[i] != _NONE:
                    c[i] += Fraction(float(G.data[k])) * z[G.indices[k]]
        return c

    def p(self, z: Vector) -> Vector:
        """Az + q."""
        return [q + sum((a * z[j] for j, a in row), Fraction(0)) for q, row in zip(self.q, self.rows, strict=True)]

    def residual(self, z: Any) -> Fraction | None:
        """Res(z)², None where ψ has no value or z is not finite."""
        if not np.isfinite(z).all():
            return None
        try:
            return self.residual_of(fractions(z))
        except Exception:
            return None

    def residual_of(self, z: Vector) -> Fraction:
        """Res(z)² of fractions."""
        rows = zip(self.obstacle(z), z, self.p(z), strict=True)
        return sum(((p if c == _NONE else min(p, x - c)) ** 2 for c, x, p in rows), Fraction(0))

    def solutions(self) -> tuple[list[Vector], bool] | None:
        """All isolated solutions by all active sets, and whether no other ones are possible, as no set is singular;
        None where there are too many sets, or ψ is not affine."""
        if self.n > _MOST or self.linear is None:
            return None
        tried = [self._on(active) for active in product((False, True), repeat=self.n)]
        found: list[Vector] = []
        for z in filter(None, tried):
            if z not in found and self.residual_of(z) == 0:
                found.append(z)
        return found, None not in tried

    def nearby(self, z: Any) -> list[Vector]:
        """The solution with the active set that `z` has, if it is one."""
        if self.linear is None or self.n > _MOST_NEARBY or not np.isfinite(z).all():
            return []
        exact = fractions(z)
        active = [c != _NONE and x - c <= p for c, x, p in zip(self.obstacle(exact), exact, self.p(exact), strict=True)]
        found = self._on(active)
        return [found] if found and self.residual_of(found) == 0 else []

    def _on(self, active: Sequence[bool]) -> Vector | None:
        """z with r_i = 0 in the `active` rows and p_i = 0 in the others, empty where one has no obstacle, None where
        the system is singular."""
        G, c = self.linear[0].toarray().tolist(), fractions(self.linear[1])
        if any(on and c[i] == _NONE for i, on in enumerate(active)):
            return []
        M = [
            [(i == j) - Fraction(x) for j, x in enumerate(G[i])]
            if on
            else [dict(self.rows[i]).get(j, Fraction(0)) for j in range(self.n)]
            for i, on in enumerate(active)
        ]
        return solved_system(M, [c[i] if on else -self.q[i] for i, on in enumerate(active)])


def optimum(P: Any, q: Any, G: Any, h: Any, equal: int) -> Fraction | None:
    """The least ½xᵀPx + qᵀx with Gx ≤ h, the first `equal` rows as equations; None where no basic set has it."""
    P, q, G, h = ([fractions(row) for row in P], fractions(q), [fractions(row) for row in G], fractions(h))
    for active in _sets(len(h), equal):
        k, zero = len(active), Fraction(0)
        M = [[*P[i], *(G[j][i] for j in active)] for i in range(len(q))] + [[*G[j], *[zero] * k] for j in active]
        found = solved_system(M, [-x for x in q] + [h[j] for j in active])
        if found is None:
            continue
        x, multipliers = found[: len(q)], found[len(q) :]
        if all(_times(row, x) <= right for row, right in zip(G[equal:], h[equal:], strict=True)) and all(
            multiplier >= 0 for j, multiplier in zip(active, multipliers, strict=True) if j >= equal
        ):
            return objective(P, q, x)
    return None


def objective(P: Any, q: Any, x: Any) -> Fraction:
    """½xᵀPx + qᵀx of fractions."""
    return _times([_times(row, x) for row in P], x) / 2 + _times(q, x)


def _sets(rows: int, equal: int) -> Iterator[list[int]]:
    for active in product((False, True), repeat=rows - equal):
        yield [*range(equal), *(equal + j for j, on in enumerate(active) if on)]
