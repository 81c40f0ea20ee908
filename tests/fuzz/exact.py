"""What is true of small problems, in fractions: a judge that shares nothing with the package's own."""

import math
from fractions import Fraction
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np

FREE, LOWER, UPPER = 0, 1, 2  #: the equation of a row: p_i = 0, z_i = ψ_i, z_i = ψ̄_i
#: the smallest float: residuals below it, in the units of z, are those of the z that is nearest to a solution
LEAST = Fraction(1, 2**1074)


def fractions(values):
    """Finite floats as fractions, infinite ones as they are."""
    return [Fraction(value) if math.isfinite(value) else value for value in np.asarray(values, np.float64).tolist()]


def rational(array):
    return [fractions(row) for row in np.atleast_2d(array)]


def nearest_floats(z):
    return np.array([float(x) for x in z])


def dot(row, x):
    return sum((a * b for a, b in zip(row, x, strict=True) if a and b), Fraction(0))


def solve_rational(M, b):
    """x with Mx = b, None where M is singular."""
    n = len(b)
    rows = [[*row, right] for row, right in zip(M, b, strict=True)]
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


def exceeds(z, exact, delta):
    """The rows in which |z − z*| > δ."""
    return [i for i in range(len(exact)) if abs(Fraction(float(z[i])) - exact[i]) > Fraction(float(delta[i]))]


def median(p, x, c, d):
    """max(x − d, min(p, x − c)), infinite c and d for none."""
    least = p if c == -math.inf else min(p, x - c)
    return least if d == math.inf else max(x - d, least)


def natural(p, x, c, d):
    """The median of x − d, p and x − c; the larger of |x − c| and |x − d| where c > d."""
    return max(abs(x - c), abs(x - d)) if c > d else median(p, x, c, d)


def root(square):
    """√square to a dozen digits, as a fraction, whatever its size."""
    if square <= 0:
        return Fraction(0)
    shift = (square.numerator.bit_length() - square.denominator.bit_length()) // 2
    return Fraction(math.sqrt(square / Fraction(4) ** shift)) * Fraction(2) ** shift


class Zeros(NamedTuple):
    """The isolated zeros of the natural map: the solutions, and those where the obstacles cross; `complete`: whether
    no active set is singular, so that there are no others."""

    solutions: list
    others: list
    complete: bool


class ExactProblem:
    """An ICP in fractions; ψ = Gz + c exactly, any other ψ by the values that it gives in floats; ψ̄ alike."""

    def __init__(self, problem):
        self.n, self.A, self.q = problem.n, rational(problem.A.toarray()), fractions(problem.q)
        self.upper = problem.upper
        self.psi = problem.psi if self.upper is None else problem.psi.lower

    @property
    def is_affine(self):
        return self.psi.linear is not None and (self.upper is None or self.upper.linear is not None)

    def p(self, z):
        return [dot(row, z) + q for row, q in zip(self.A, self.q, strict=True)]

    def obstacles(self, z):
        """(ψ_i(z), ψ̄_i(z)) for every row. Raises what the user's function raises, ValueError for NaN."""
        above = [math.inf] * self.n if self.upper is None else self._value(self.upper, z, math.inf)
        return list(zip(self._value(self.psi, z, -math.inf), above, strict=True))

    def _value(self, psi, z, none):
        if psi.linear is None:
            with np.errstate(all="ignore"):
                value = np.asarray(psi.value(nearest_floats(z)))
            if np.isnan(value).any() or (value == -none).any():
                raise ValueError
            return fractions(value)
        G, c = psi.linear
        return [x if x == none else x + dot(row, z) for row, x in zip(rational(G.toarray()), fractions(c), strict=True)]

    @cached_property
    def weights(self):
        """1/max_j |a_ij|, the diagonal of D⁻¹, which is at least 2⁻¹⁰²²; that of a row without entries is 2⁻⁵¹¹."""
        least = Fraction(1, 2**1022)
        return [1 / max(least, *map(abs, row)) if any(row) else Fraction(2) ** 511 for row in self.A]

    def paper_residual(self, z):
        """Res(z)²."""
        return self.residual(z, [1] * self.n)

    def scale(self, z, start):
        """What a relative tolerance is a share of: Res_D(0), the smallest term at 0, or the size of `z`, at most that
        of the `start`, None for 0."""
        zero = [Fraction(0)] * self.n
        at_0 = self.residual(zero)
        if at_0 and at_0 > (self.n * LEAST) ** 2:
            return root(at_0)
        if at_0 is not None:
            terms = [abs(w * q) for w, q in zip(self.weights, self.q, strict=True)]
            terms += [abs(x) for pair in self.obstacles(zero) for x in pair]
            if terms := [x for x in terms if LEAST < x < math.inf]:
                return min(terms)
        squares = [sum(x * x for x in fractions(x)) for x in (z, [0.0] if start is None else start)]
        return root(min(squares))

    def residual(self, z, weights=None):
        """Res_D(z)² = ‖mid(z − ψ̄, w·p, z − ψ)‖₂², None where ψ has no value or z is not finite."""
        if not isinstance(z[0], Fraction):
            if not np.isfinite(z).all():
                return None
            z = fractions(z)
        weights = weights or self.weights
        try:
            rows = zip(weights, self.p(z), z, self.obstacles(z), strict=True)
            return sum((natural(w * p, x, c, d) ** 2 for w, p, x, (c, d) in rows), Fraction(0))
        except Exception:
            return None

    def crosses(self, z):
        return any(c > d for c, d in self.obstacles(fractions(z)))

    @cached_property
    def _sides(self):
        """[(I − G, c), (I − H, d)]."""
        found = []
        for psi in (self.psi, self.upper):
            if psi is not None:
                G, c = psi.linear
                rows = [[(i == j) - x for j, x in enumerate(row)] for i, row in enumerate(rational(G.toarray()))]
                found.append((rows, fractions(c)))
        return found

    def on(self, kinds):
        """z with the equations `kinds`, None where they are singular."""
        rows = [self.A[i] if kind == FREE else self._sides[kind - 1][0][i] for i, kind in enumerate(kinds)]
        return solve_rational(
            rows, [-self.q[i] if k == FREE else self._sides[k - 1][1][i] for i, k in enumerate(kinds)]
        )

    def zeros(self):
        """All isolated zeros, by every choice of equations."""
        found, complete = Zeros([], [], True), True
        sides = [c for _, c in self._sides]
        for kinds in product(range(1 + len(sides)), repeat=self.n):
            if any(kind and math.isinf(sides[kind - 1][i]) for i, kind in enumerate(kinds)):
                continue
            z = self.on(kinds)
            complete = complete and z is not None
            if z is None or z in found.solutions or z in found.others:
                continue
            rows = list(zip(self.p(z), z, self.obstacles(z), strict=True))
            crossed = any(c > d for _, _, (c, d) in rows)
            # where they cross a zero is no solution
            if all(median(p, x, c, d) == 0 for p, x, (c, d) in rows):
                (found.others if crossed else found.solutions).append(z)
        return found._replace(complete=complete)

    def nearby(self, z):
        """The solutions, at most one, whose rows have the equations that they are nearest to at `z`."""
        exact = fractions(z)
        rows = zip(self.obstacles(exact), exact, self.p(exact), strict=True)
        z = self.on([UPPER if x - d >= p else LOWER if x - c <= p else FREE for (c, d), x, p in rows])
        return [z] if z is not None and self.residual(z) == 0 else []


def solutions(problem):
    """All isolated solutions of an ICP with affine obstacles, as lists of fractions."""
    return ExactProblem(problem).zeros().solutions


def pieces(problem):
    """All isolated zeros of an ICP with affine obstacles."""
    return ExactProblem(problem).zeros()


class Optimum(NamedTuple):
    """Of min ½xᵀPx + qᵀx: the least `value`, None where no choice of tight rows has it, and whether every choice was
    decided, so that None means infeasible or unbounded."""

    value: Fraction | None
    complete: bool


def optimum(P, q, G, h, equal):
    """The least ½xᵀPx + qᵀx with Gx ≤ h, the first `equal` rows as equations, by every choice of tight rows."""
    P, q, G, h = rational(P), fractions(q), rational(G), fractions(h)
    complete = True
    for tight in product((False, True), repeat=len(h) - equal):
        active = [*range(equal), *(equal + j for j, on in enumerate(tight) if on)]
        M = [[*P[i], *(G[j][i] for j in active)] for i in range(len(q))]
        M += [[*G[j], *[Fraction(0)] * len(active)] for j in active]
        found = solve_rational(M, [-x for x in q] + [h[j] for j in active])
        complete = complete and found is not None
        if found is None:
            continue
        x, multipliers = found[: len(q)], found[len(q) :]
        feasible = all(dot(row, x) <= right for row, right in zip(G[equal:], h[equal:], strict=True))
        if feasible and all(one >= 0 for one in multipliers[equal:]):
            return Optimum(objective(P, q, x), True)
    return Optimum(None, complete)


def objective(P, q, x):
    """½xᵀPx + qᵀx of fractions."""
    return dot([dot(row, x) for row in P], x) / 2 + dot(q, x)
