"""What is true of an answer, in fractions: a judge that shares nothing with the package's own."""

from __future__ import annotations

import math
from collections.abc import Sequence
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
#: the row of p, of ψ, of ψ̄
_FREE, _BELOW, _ABOVE = 0, 1, 2


def fractions(values: Any) -> list[Any]:
    """Finite floats as fractions, infinite ones as they are."""
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
    """An ICP in fractions; ψ = Gz + c exactly, any other ψ by the values that it gives in floats; ψ̄ alike."""

    def __init__(self, problem: Any) -> None:
        self.A, self.n = problem.A, problem.n
        self.q, self.psi, self.upper = fractions(problem.q), getattr(problem.psi, "lower", problem.psi), problem.upper
        sides = [side for side in (self.psi, self.upper) if side is not None]
        #: (G, c) of ψ and, where it is there, of ψ̄; None where one is not affine
        self.linear = None if any(side.linear is None for side in sides) else [side.linear for side in sides]

    @cached_property
    def rows(self) -> list[list[tuple[int, Fraction]]]:
        """The entries of A."""
        A = self.A
        return [
            [(int(j), Fraction(x)) for j, x in zip(A.indices[low:high], A.data[low:high].tolist(), strict=True) if x]
            for low, high in zip(A.indptr[:-1], A.indptr[1:], strict=True)
        ]

    def obstacles(self, z: Vector) -> list[tuple[Any, Any]]:
        """(ψ_i(z), ψ̄_i(z)), infinite for none; raises what the user's function raises, ValueError for NaN."""
        above = [math.inf] * self.n if self.upper is None else self._value(self.upper, z, math.inf)
        return list(zip(self._value(self.psi, z, -math.inf), above, strict=True))

    def _value(self, psi: Any, z: Vector, none: float) -> list[Any]:
        if psi.linear is None:
            value = np.asarray(psi.value(np.array([float(x) for x in z])))
            if np.isnan(value).any() or (value == -none).any():
                raise ValueError
            return fractions(value)
        G, c = psi.linear[0].tocsr(), fractions(psi.linear[1])
        for i in range(self.n):
            for k in range(G.indptr[i], G.indptr[i + 1]):
                if c[i] != none:
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
        rows = zip(self.obstacles(z), z, self.p(z), strict=True)
        return sum((_natural(p, x, c, d) ** 2 for (c, d), x, p in rows), Fraction(0))

    def crosses(self, z: Any) -> bool:
        """Whether ψ_i(z) > ψ̄_i(z) in some row."""
        return any(c > d for c, d in self.obstacles(fractions(z)))

    def solutions(self) -> tuple[list[Vector], bool] | None:
        """All isolated solutions by all active sets, and whether no other ones are possible, as no set is singular;
        None where there are too many sets, or ψ is not affine."""
        if self.n > _MOST or self.linear is None:
            return None
        tried = [self._on(kinds) for kinds in product(range(1 + len(self.linear)), repeat=self.n)]
        found: list[Vector] = []
        for z in filter(None, tried):
            if z not in found and self.residual_of(z) == 0:
                found.append(z)
        return found, None not in tried

    def nearby(self, z: Any) -> list[Vector]:
        """The solution whose rows are of the kinds that they are of at `z`, if it is one."""
        if self.linear is None or self.n > _MOST_NEARBY or not np.isfinite(z).all():
            return []
        exact = fractions(z)
        rows = zip(self.obstacles(exact), exact, self.p(exact), strict=True)
        found = self._on([_ABOVE if x - d >= p else _BELOW if x - c <= p else _FREE for (c, d), x, p in rows])
        return [found] if found and self.residual_of(found) == 0 else []

    def _on(self, kinds: Sequence[int]) -> Vector | None:
        """z with p_i = 0, z_i = ψ_i or z_i = ψ̄_i as the `kinds` of rows say, empty where one has no such obstacle, None
        where the system is singular."""
        M, right = [], []
        for i, kind in enumerate(kinds):
            if kind == _FREE:
                M.append([dict(self.rows[i]).get(j, Fraction(0)) for j in range(self.n)])
                right.append(-self.q[i])
                continue
            G, c = self._sides[kind - 1]
            if math.isinf(c[i]):
                return []
            M.append([(i == j) - x for j, x in enumerate(G[i])])
            right.append(c[i])
        return solved_system(M, right)

    @cached_property
    def _sides(self) -> list[tuple[Matrix, list[Any]]]:
        """G and c of each obstacle."""
        return [(list(map(fractions, G.toarray())), fractions(c)) for G, c in self.linear or ()]


def _natural(p: Fraction, x: Fraction, c: Any, d: Any) -> Fraction:
    """mid(x − d, p, x − c), infinite c and d for none; the larger of the two in absolute value where c > d."""
    if c > d:
        return max(abs(x - c), abs(x - d))
    least = p if c == -math.inf else min(p, x - c)
    return least if d == math.inf else max(x - d, least)


def optimum(P: Any, q: Any, G: Any, h: Any, equal: int) -> Fraction | None:
    """The least ½xᵀPx + qᵀx with Gx ≤ h, the first `equal` rows as equations; None where no basic set has it."""
    P, q, G, h = ([fractions(row) for row in P], fractions(q), [fractions(row) for row in G], fractions(h))
    for tight in product((False, True), repeat=len(h) - equal):
        active = [*range(equal), *(equal + j for j, on in enumerate(tight) if on)]
        k, zero = len(active), Fraction(0)
        M = [[*P[i], *(G[j][i] for j in active)] for i in range(len(q))] + [[*G[j], *[zero] * k] for j in active]
        found = solved_system(M, [-x for x in q] + [h[j] for j in active])
        if found is None:
            continue
        x, multipliers = found[: len(q)], found[len(q) :]
        feasible = all(_times(row, x) <= right for row, right in zip(G[equal:], h[equal:], strict=True))
        if feasible and all(one >= 0 for one in multipliers[equal:]):
            return objective(P, q, x)
    return None


def objective(P: Any, q: Any, x: Any) -> Fraction:
    """½xᵀPx + qᵀx of fractions."""
    return _times([_times(row, x) for row in P], x) / 2 + _times(q, x)
