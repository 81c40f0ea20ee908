"""Newton's steps through the interior, for proximal problems on which the signs of the modulus wander or creep."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..algebra.equations import derivative
from ..errors import MapError
from ..numerics import work
from ..numerics.arrays import Mask, Vector, inner, norm, row_of
from ..numerics.factorisation import SymmetricPattern, factorise
from ..numerics.fill import Look
from ..problem.affine import zero
from ..problem.data import ProblemData

#: so many steps in a row may reduce neither the residual nor the way to where it is one
_PATIENCE = 20
#: what is less than this share of the least one so far counts as reduced
_REDUCED = 0.9
#: what of W is added to A at first, and where A is not symmetric: entries are then not bounded by those of the
#: diagonal, and the square of what is added has to be above rounding, or pivots may come to 0; and the least that is
#: added where factors have been accurate with more, next to rounding
_STEADY, _STEADY_SKEW, _STEADY_LEAST = 1e-9, 1e-7, 1e-13
#: a tenth is added after a solve that has lost up to √ε of its right-hand side, a hundred times as much, and the solve
#: made again, where it has lost the root of that
_ACCURATE, _ROUGH, _LESS, _MORE = 2.0**-26, 2.0**-13, 0.1, 100.0
#: the share of the way to the boundary that is gone
_NEARLY_ALL = 0.995
#: the least room between two obstacles, as a share of what rows with one have
_LEAST = 1e-12


class Least:
    """The `least` of the values so far, and how many have come since it was last reduced by a tenth: `waited`."""

    def __init__(self, least: float = np.inf) -> None:
        self.least, self.waited = least, 0

    def add(self, value: float) -> int:
        """`waited` with another value."""
        self.waited += 1
        if value < _REDUCED * self.least:
            self.least, self.waited = value, 0
        return self.waited


class Interior:
    """Newton's steps with the modulus rounded off, √(x² + 4ε²) for |x|: then r, s > 0 and rs = ε², and ε falls.

    s comes to p as z does to the solution. r is z − ψ(z) where ψ is fixed, and comes to it, by `gap`, where ψ moves.
    With an obstacle above, r and s have a second column for it, for ψ̄(z) − z, and s₁ − s₂ comes to p. Every row counts,
    but there is no sign pattern to be found; each step is a proximal one with its own z for centre, and creeps where A
    is small against what of W is added: so this falls as far as the factors remain accurate. That they lead on is not
    proved: where they do not, the others go on.
    Parameters: `problem`; W, the `weights` of p/z, shape (n,); the `obstacles` (c, c̄) where it begins, c̄ None where
    there is none; `resting` = (c, Ac + q), with what is nearest to 0 for c in the rows that have no obstacle below;
    for matrices with the `pattern` of A what factorises them repeatedly, or a look at it, None where each is a new one.
    Raises MapError where ψ fails at the first place.
    Reference: Mehrotra, SIAM J. Optim. 2 (1992), for the choice of ε.
    """

    def __init__(
        self,
        problem: ProblemData,
        weights: Vector,
        obstacles: tuple[Vector, Vector | None],
        resting: tuple[Vector, Vector],
        pattern: SymmetricPattern | Look | None,
    ) -> None:
        self.problem, self.weights, self.pattern = problem, weights, pattern
        self.diagonal, self.row = problem.matrix.rows.diag, row_of(problem.A)
        self.steady = self.first_steady = _STEADY if problem.matrix.is_nearly_symmetric else _STEADY_SKEW
        self.least_steady, self.lost = _STEADY_LEAST, 0.0
        self.moves = not problem.facts.has_fixed_obstacle
        (c, p), (below, top) = resting, obstacles
        self.root = root = np.sqrt(weights)
        bounded = ~np.isneginf(below)
        size = float(np.abs((np.minimum(p, 0.0) if top is None else p) / root).max())
        if self.moves:  # where nothing pulls at c, c is no solution as yet
            size = max(size, float(np.max((root * np.abs(problem.r(c)))[bounded], initial=0.0))) or 1.0
        self.residuals, self.ways = Least(), Least()
        self.signs, self.same = np.zeros(0, bool), 0
        self._start(c, size, bounded, top)
        one = self.bounded & (self.bounded.sum(axis=1, keepdims=True) == 1)
        if self.moves or not one.any():
            return
        # so far that the first direction does not lead beyond the boundary, where one obstacle alone leaves the room;
        # obstacles that move are elsewhere then
        dr = self._direction(self._solver(), self.r * self.s)[1]
        share = (dr / self.r)[one]  # that of s is −1 − this
        farther = float(np.maximum(-share, 1.0 + share).max())
        if 1.0 < farther < np.inf:
            self._start(c, farther * size, bounded, top)

    def _start(self, c: Vector, size: float, bounded: Mask, top: Vector | None) -> None:
        """So far from the obstacles, in the units of W, which is where p/W comes to."""
        r, s = size / self.root, size * self.root
        z = c + np.where(bounded, r, 0.0)
        sides = [(bounded, r)]
        if top is not None:
            # in the middle where there is less room; rows that cannot move keep a trace of it
            has = np.isfinite(top)
            r = np.where(bounded & has, np.clip(0.5 * (top - c), _LEAST * r, r), r)
            z = np.where(bounded, c + r, np.where(has, np.minimum(c, top - r), c))
            sides = [(bounded, r), (has, np.maximum(top - z, r))]
        self.bounded = np.column_stack([has for has, _ in sides])
        self.r = np.where(self.bounded, np.column_stack([r for _, r in sides]), 1.0)
        self.s = np.where(self.bounded, s[:, None], 0.0)
        self.sign = np.array([1.0, -1.0])[: len(sides)]
        self.gap, self.slopes = np.zeros_like(self.r), [zero(self.problem.n)] * len(sides)
        self._arrive(z)

    @property
    def z(self) -> Vector:
        """Where it has come to."""
        return self.point[0]

    @property
    def rest(self) -> Vector:
        """How far s is from p."""
        return np.asarray(self.s @ self.sign - self.point[1])

    def leads_on(self, whole: float) -> bool:
        """Whether the residual, now `whole`, or the way of r and s to z − ψ(z) and p has been reduced not long ago."""
        way = norm(self.rest / self.root) + norm((self.root[:, None] * self.gap).ravel())
        return min(self.residuals.add(whole), self.ways.add(way)) < _PATIENCE

    def settled(self) -> bool:
        """Whether the signs of the modulus have been the same for 1, 3, 7, … steps."""
        signs = self.s > self.weights[:, None] * self.r
        self.same = self.same + 1 if np.array_equal(signs, self.signs) else 0
        self.signs = signs
        return self.same > 0 and not self.same & (self.same + 1)

    def advance(self) -> bool:
        """One step, False where it fails."""
        r, s = self.r, self.s
        both = max(int(np.count_nonzero(self.bounded)), 1)
        size = inner(r.ravel(), s.ravel()) / both
        while True:
            solve = self._solver()
            _, dr, ds, longest = self._direction(solve, r * s)
            if self.lost <= _ROUGH or self.steady >= self.first_steady:
                break
            self.steady = self.least_steady = min(_MORE * self.steady, self.first_steady)
        if self.lost <= _ACCURATE:
            self.steady = max(_LESS * self.steady, self.least_steady)
        t = 1.0 / max(longest, 1.0)
        after = inner(np.where(self.bounded, r + t * dr, 0.0).ravel(), (s + t * ds).ravel()) / both
        target = r * s + dr * ds - ((after / size) ** 3 * size if size else 0.0)
        dz, dr, ds, longest = self._direction(solve, target)
        t = min(1.0, _NEARLY_ALL / longest) if longest > 0 else 1.0
        self.r, self.s = np.where(self.bounded, r + t * dr, 1.0), s + t * ds
        try:
            self._arrive(self.z + t * dz)
        except MapError:
            return False
        return bool(np.isfinite(self.point[1]).all() and np.isfinite(self.gap).all())

    def _direction(self, solve: Callable[[Vector], Vector], target: Vector) -> tuple[Vector, Vector, Vector, float]:
        """The ways of z, r and s where rs falls by `target`, and how many times as long as to the boundary they are."""
        r, s = self.r, self.s
        dz = solve(self.rest - np.where(self.bounded, (target + s * self.gap) / r, 0.0) @ self.sign)
        dr = self.sign * np.column_stack([dz - J @ dz if J.nnz else dz for J in self.slopes]) + self.gap
        ds = np.where(self.bounded, -(target + s * dr) / r, 0.0)
        steps = -dr / r, -ds / np.where(self.bounded, s, 1.0)
        return dz, dr, ds, max(float(np.max(x[self.bounded], initial=0.0)) for x in steps)

    def _arrive(self, z: Vector) -> None:
        """z with p, z − ψ(z) and z − ψ̄(z), and how far r is from them, if it can be."""
        problem = self.problem
        self.point = z, problem.p(z), problem.r(z), problem.r_upper(z)
        if self.moves:
            _, _, below, above = self.point
            room = below[:, None] if above is None else np.column_stack([below, -above])
            self.gap = np.where(self.bounded, room - self.r, 0.0)
            self.slopes = [derivative(psi, z) for psi in (problem.psi, problem.upper) if psi is not None]

    def _solver(self) -> Callable[[Vector], Vector]:
        A, slopes = self.problem.A, np.where(self.bounded, self.s / self.r, 0.0)
        data = A.data.copy()
        data[self.diagonal] += slopes.sum(axis=1) + self.steady * self.weights
        M = sp.csr_array((data, A.indices, A.indptr), shape=A.shape)
        if self.moves:
            work.build(A.nnz + sum(J.nnz for J in self.slopes), 1 + len(self.slopes))
            for J, slope in zip(self.slopes, slopes.T, strict=True):
                M = sp.csr_array(M - sp.diags_array(slope) @ J)
        unit = 1.0 / np.sqrt(np.abs(M.diagonal()))
        row = row_of(M) if self.moves else self.row
        M.data *= unit[row]
        M.data *= unit[M.indices]
        factors = self._factors(M)

        def solve(f: Vector) -> Vector:
            if factors is None:
                self.lost = np.inf
                return np.full(f.size, np.nan)
            f = unit * f
            x = factors.solve(f)
            rest = f - M @ x
            self.lost = norm(rest) / (norm(f) or 1.0)
            x += factors.solve(rest)  # without exchanges of rows digits may be lost
            return np.asarray(unit * x)

        return solve

    def _factors(self, M: sp.csr_array) -> Any:
        if isinstance(self.pattern, SymmetricPattern):
            return self.pattern.factors(M.data)
        return factorise(M, definite=True, look=self.pattern or Look(M, lambda: False))  # symmetric at most by chance
