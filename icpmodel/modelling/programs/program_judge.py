"""The violation of the conditions of a program, relative to their terms, so that units have no influence."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ...numerics import work
from ...numerics.arrays import Mask, Vector, inner, row_of
from ...numerics.rounding import UNIT_ROUNDOFF, gamma
from ...problem.data import ProblemData

#: an unknown may be a rounding error if it is at most this share of the largest of its group, or of q
_NOISE_OF_X = 1e-13
#: an error of the gradient may be rounding if it is at most this share of the largest entry of g in its group, and of
#: the terms of its row
_NOISE_OF_GRADIENT = 1e-3
#: the cost of judging an iterate, in products with A, measured for a membrane with n = 22 500
_PRODUCTS = 10.0


class Violation(NamedTuple):
    """The largest violation of a condition, as a share of its terms, with three allowances for rounding.

    `rounded` allows for the rounding errors of a sum of the largest unknowns, `strict` only for those of the row's own
    sum. `significant` is `strict` without rows whose terms are rounding errors of the largest unknowns.
    """

    rounded: float = np.inf
    strict: float = np.inf
    significant: float = np.inf


class Judge:
    """Judge iterates of conditions with the matrix [[H, Eᵀ, Gᵀ], [−E, 0, 0], [−G, 0, 0]]; `is_x` marks the rows of H.

    The error of row i is 0 if z_i is on the obstacle onto which p_i presses it, else |p_i|. It is a share of the sum of
    the |terms| of p_i. Rounding errors are subtracted, as large as if every unknown were the largest of its `group`.

    The gap is the second criterion, so that large entries of H do not hide g. If y = x + Δ is in C,
    (Hx + g)ᵀ(y − x) is at least −Σ|p_i|d_i. Here d_i is the distance to the obstacle or, if less, |z_i|. For x with
    h_ii > 0, |z_i| is replaced by (|H||x|)_i/h_ii, the step that changes row i by the sum of its |terms|. The gap is
    measured as a share of its own terms.
    """

    def __init__(self, problem: ProblemData, is_x: Mask) -> None:
        work.charge_matrices(problem.A.nnz, 6)
        self.A = problem.A
        self.size = problem.matrix.absolute
        self.diagonal = problem.matrix.rows.diagonal
        self.is_x = is_x
        self.cost = _PRODUCTS * problem.matrix.product_cost
        #: `work.counter()` when `is_due` was last True
        self.counted = 0.0
        self.loss = float(gamma(3 + np.diff(self.size.indptr).max(initial=0)))
        i = row_of(self.size)
        j = self.size.indices
        largest = problem.matrix.rows.largest
        strong = (i == j) | (self.size.data > _NOISE_OF_X * np.maximum(largest[i], largest[j]))
        links = self.size
        if not strong.all():
            links = sp.coo_array((strong[strong], (i[strong], j[strong])), self.size.shape)
        #: the group of each unknown: entries of x, or multipliers, that share rounding errors through entries of A
        _, self.group = np.unique(2 * connected_components(links)[1] + is_x, return_inverse=True)

    def is_due(self) -> bool:
        """Whether the work since the last True has cost as much as judging an iterate. True starts the next count."""
        # the difference is negative if the last True was in another thread
        is_due = not 0 <= work.counter() - self.counted < self.cost
        if is_due:
            self.counted = work.counter()
        return is_due

    @np.errstate(all="ignore")
    def violation(self, q: Vector, z: Vector, p: Vector, room: Vector) -> Violation:
        """The largest violations at `z`; inf if they are NaN.

        `p` is p(z), and `room` the distance of z to the obstacle onto which p presses it, all of shape (n,).
        """
        terms, largest_terms = self.terms(q, z)
        wrong = np.where(room > 0, np.abs(p), 0.0)
        if np.isnan(p).any() or not (wrong + terms)[wrong > 0].max(initial=0.0) < np.inf:
            return Violation()
        own = self.loss * terms
        size_q = np.abs(q)
        largest_q = self.largest(size_q)
        least = np.where(self.is_x & (largest_q > 0), _NOISE_OF_GRADIENT * np.minimum(largest_q, terms), np.inf)
        noise = np.maximum(own, np.minimum(self.loss * largest_terms, least))
        x = np.where(self.is_x, z, 0.0)
        reach = np.where(self.diagonal > 0, self.size @ np.abs(x) / self.diagonal, np.abs(z))
        strict = np.maximum(wrong - np.minimum(own, least), 0.0)
        gap = np.where(strict > 0, strict * np.minimum(room, reach), 0.0).sum()
        if gap > 0:
            sides = np.where(self.is_x, np.where(room > 0, 0.0, -z * p), z * q).sum()
            gap /= max(inner(x, self.A @ x), 0.0) + inner(np.abs(x), size_q + noise) + abs(sides)
        gap = np.nan_to_num(gap, nan=np.inf)
        shares = (wrong - own) / terms
        significant = shares[terms > UNIT_ROUNDOFF * largest_terms]
        every = ((wrong - noise) / terms, shares, significant)
        return Violation(*(float(np.fmax.reduce(one, initial=gap)) for one in every))

    def terms(self, q: Vector, z: Vector) -> tuple[Vector, Vector]:
        """The sums of |terms| in rows of Az + q; and those of Az with every unknown as large as its group's largest."""
        return np.asarray(self.size @ np.abs(z) + np.abs(q)), np.asarray(self.size @ self.largest(z))

    def largest(self, z: Vector) -> Vector:
        """For each entry of `z`, the largest |entry| of its group; they are comparable, as entries of A are about 1."""
        largest = np.zeros(z.size)
        np.maximum.at(largest, self.group, np.abs(z))
        return largest[self.group]

    def without_noise(self, q: Vector, z: Vector) -> Vector:
        """`z` with 0 in place of entries that may be rounding errors beside the largest of their group, or beside q."""
        return np.where(np.abs(z) <= _NOISE_OF_X * np.maximum(self.largest(z), np.abs(q).max()), 0.0, z)
