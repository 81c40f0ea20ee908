"""Newton's method on the modulus equation of a quadratic program, with the modulus rounded off: √(x² + 4ε²) for |x|.

Then every λ_i and its slack s_i are positive and λ_i s_i = ε², and ε falls. Each step is a proximal one with the
iterate itself for centre (ρ and δ in `kkt`), so that its system has a solution whatever P and A are. As soon as the
signs of λ − s stand still they are taken at their word: with the modulus itself, these rows being equations and the
others left out, the next iterate is exact up to rounding. The judge says whether it is the answer.
Reference: Mehrotra, SIAM J. Optim. 2 (1992), for the choice of ε; Friedlander and Orban, Math. Program. Comput. 4
(2012), for the proximal terms.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from ...numerics.arrays import Mask, Vector
from .kkt import Solve
from .reduction import ProgramLcp

#: the share of the way to the boundary that a step goes
_NEARLY_ALL = 0.995
#: the share of its terms up to which a row counts as an equation
_TIGHT = 1e-6
#: negative multipliers and slacks that are no rounding
_PLAINLY = 1e-4
#: how an inequality that counts as an equation weighs, and how often its system is solved
_STIFF, _REFINED, _HALF = 1e8, 20, 0.5
#: the signs may stand still once the conditions hold to so much
_NEAR = 1e-3


class CentralPath:
    """Where the run is: x, ν, λ and slack s of the inequalities Cx ≤ d, which are Ex ≤ g, −x ≤ −l and x ≤ u."""

    def __init__(self, lcp: ProgramLcp) -> None:
        self.lcp, self.frame = lcp, lcp.frame
        n, m = self.frame.n, self.frame.m
        self.lower, self.upper = np.flatnonzero(lcp.low > -np.inf), np.flatnonzero(lcp.high < np.inf)
        self.q, self.b = lcp.q[:n], lcp.q[n + m :]
        self.d = np.concatenate([lcp.q[n : n + m], -lcp.low[self.lower], lcp.high[self.upper]])
        self.systems = self.frame.systems
        self.steps, self.least = 0, np.inf
        self.x, self.nu = np.zeros(n), np.zeros(self.b.size)
        self.slack = self.multiplier = np.ones(self.d.size)
        self._look()

    def rows(self, x: Vector) -> Vector:
        """Cx."""
        if self.lower.size + self.upper.size == 0:
            return np.asarray(self.frame.E @ x)
        return np.concatenate([self.frame.E @ x, -x[self.lower], x[self.upper]])

    def columns(self, v: Vector) -> Vector:
        """Cᵀv."""
        m = self.frame.m
        of_x = self.frame.E.T @ v[:m]
        if self.lower.size + self.upper.size:
            of_x[self.lower] -= v[m : m + self.lower.size]
            of_x[self.upper] += v[m + self.lower.size :]
        return np.asarray(of_x)

    def solver(self, w: Vector) -> Solve | None:
        """Of (P + ρ)dx + Cᵀdλ + Aᵀdν = f, Cdx − W⁻¹dλ = e, Adx − δdν = a, for all rows of C."""
        m, n_lower = self.frame.m, self.lower.size
        of_x = np.zeros(self.x.size)
        of_x[self.lower] += w[m : m + n_lower]
        of_x[self.upper] += w[m + n_lower :]
        inner = self.systems.factorised(w[:m], of_x)
        if inner is None:
            return None

        def solve(f: Vector, e: Vector, a: Vector) -> tuple[Vector, Vector, Vector]:
            if w.size > m:
                weighted = w * e
                weighted[:m] = 0.0
                f = f + self.columns(weighted)
            dx, of_rows, dnu = inner(f, e[:m], a)
            if w.size == m:
                return dx, of_rows, dnu
            multiplier = w * (self.rows(dx) - e)
            multiplier[:m] = of_rows
            return dx, multiplier, dnu

        return solve

    def residuals(self) -> tuple[Vector, Vector, Vector]:
        """What is wrong with Px + q + Cᵀλ + Aᵀν = 0, Cx + s = d and Ax = b."""
        A = self.frame.A
        of_x = self.frame.P @ self.x + self.q + self.columns(self.multiplier)
        if self.b.size:
            of_x = of_x + A.T @ self.nu
        return of_x, self.d - self.rows(self.x) - self.slack, self.b - A @ self.x

    def begin(self) -> bool:
        """The first iterate: with s = −λ, and then both made positive; False where that fails."""
        solve = self.solver(np.ones(self.d.size))
        if solve is None:
            return False
        self.x, multiplier, self.nu = solve(-self.q, self.d, self.b)
        self.multiplier, self.slack = _positive(multiplier), _positive(-multiplier)
        return self._look()

    def advance(self) -> bool:
        """One step, False where rounding forbids it."""
        self.steps += 1
        x, s, multiplier = self.x, self.slack, self.multiplier
        of_x, of_rows, of_equations = self.left
        solve = self.solver(multiplier / s)
        if solve is None:
            return False
        product, count = s * multiplier, max(s.size, 1)
        size = product.sum() / count

        def direction(less: Vector) -> tuple[Vector, Vector, Vector, Vector, float]:
            dx, d_multiplier, dnu = solve(-of_x, of_rows + less / multiplier, of_equations)
            ds = -(less + s * d_multiplier) / multiplier
            longest = -min((ds / s).min(initial=0.0), (d_multiplier / multiplier).min(initial=0.0))
            return dx, ds, d_multiplier, dnu, float(longest)

        dx, ds, d_multiplier, dnu, longest = direction(product)
        if s.size:
            t = 1.0 / max(longest, 1.0)
            after = ((s + t * ds) @ (multiplier + t * d_multiplier)) / count
            aim = (after / size) ** 3 * size if size else 0.0
            dx, ds, d_multiplier, dnu, longest = direction(product + ds * d_multiplier - aim)
        t = min(1.0, _NEARLY_ALL / longest) if longest > 0 else 1.0
        self.x, self.nu = x + t * dx, self.nu + t * dnu
        self.slack, self.multiplier = s + t * ds, multiplier + t * d_multiplier
        return self._look()

    def _look(self) -> bool:
        """Sets what is `left` of the conditions, `error`, the largest of it and of the mean of λ_i s_i, and `best`, the
        iterate with the least one and what looks active there; whether the error is a number."""
        self.left = self.residuals()
        mean = self.slack @ self.multiplier / max(self.slack.size, 1)
        sizes = [float(mean), *(float(np.abs(one).max()) for one in self.left if one.size)]
        self.error = max(sizes)
        finite = math.isfinite(sum(sizes))  # max would lose a NaN
        if finite and self.error < self.least:
            self.least, self.best = self.error, (self.y, self.active)
        return finite

    @property
    def active(self) -> Mask:
        """Which inequalities look like equations."""
        return self.multiplier > self.slack

    def y_of(self, x: Vector, multiplier: Vector, nu: Vector) -> Vector:
        """These as an iterate of the LCP."""
        return np.concatenate([x, multiplier[: self.frame.m], nu])

    @property
    def y(self) -> Vector:
        """The iterate as one of the LCP."""
        return self.y_of(self.x, self.multiplier, self.nu)

    @property
    def share(self) -> float:
        """Of the iterate as a proof that there is no solution: what is wrong with it beside what it shows."""
        P, A, share = self.frame.P, self.frame.A, np.inf
        shows = -float(self.d @ self.multiplier + self.b @ self.nu)
        if shows > 0:
            share = np.abs(self.columns(self.multiplier) + A.T @ self.nu).max() / shows
        shows = -float(self.q @ self.x)
        if shows > 0:
            wrong = max(np.abs(P @ self.x).max(), np.abs(A @ self.x).max(initial=0), self.rows(self.x).max(initial=0))
            share = min(share, wrong / shows)
        return float(share)

    def rays(self, found: tuple[Vector, Vector, Vector], active: Mask) -> Iterator[Vector]:
        """Directions in the LCP that may be proofs that there is no solution: where the iterate leads, and what is left
        of the equations of `exact`, which then contradict each other, or the step to which it has come."""
        x, multiplier, nu = found
        zero = np.zeros_like
        yield self.y_of(zero(x), self.multiplier, zero(nu) + self.nu)
        left = np.where(active, np.maximum(self.rows(x) - self.d, 0.0), 0.0)
        yield self.y_of(zero(x), left, self.frame.A @ x - self.b)
        for direction in (self.x, x - self.x):
            yield self.y_of(direction, zero(multiplier), zero(nu))

    def tight(self, x: Vector) -> Mask:
        """Which inequalities are equations at this x, in the units of the program, to about six digits."""
        x = self.frame.sign * x / self.lcp.unit[: x.size]
        size = np.abs(self.d) + np.abs(self.d - self.rows(x)) + np.abs(self.rows(np.abs(x)))
        return np.asarray(np.abs(self.d - self.rows(x)) <= _TIGHT * size)

    def exact(
        self, active: Mask, x: Vector, multiplier: Vector, nu: Vector, anyway: bool = False
    ) -> tuple[Vector, Vector, Vector] | None:
        """x, λ and ν with these inequalities as equations and without the others, from those given; to the last digit
        where signs are right, or `anyway`."""
        solve = self.solver(np.where(active, _STIFF, 0.0))
        if solve is None:
            return None
        multiplier = np.where(active, multiplier, 0.0)
        least = np.inf
        for _ in range(_REFINED):
            of_x = self.frame.P @ x + self.q + self.columns(multiplier) + self.frame.A.T @ nu
            of_rows, of_equations = self.d - self.rows(x), self.b - self.frame.A @ x
            wrong = np.concatenate([of_x, of_rows[active], of_equations])
            size = np.abs(wrong).max()
            if not size < _HALF * least:
                break
            least = size
            dx, change, dnu = solve(-of_x, of_rows, of_equations)
            x, multiplier, nu = x + dx, multiplier + change, nu + dnu
            if not anyway and self.wrong(active, x, multiplier) > _PLAINLY:
                break
        m, n_lower = self.frame.m, self.lower.size
        x = x.copy()
        for columns, bound, at in (
            (self.lower, self.lcp.low, active[m : m + n_lower]),
            (self.upper, self.lcp.high, active[m + n_lower :]),
        ):
            x[columns[at]] = bound[columns[at]]
        return x, multiplier, nu

    def wrong(self, active: Mask, x: Vector, multiplier: Vector) -> float:
        """How much of the multipliers and slacks, those of `exact`, is negative."""
        return float(-np.minimum(np.where(active, multiplier, self.d - self.rows(x)), 0.0).sum())


def _positive(v: Vector) -> Vector:
    least = v.min(initial=np.inf)
    return v if least > 0 else v + (1.0 - least)
