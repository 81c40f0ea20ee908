"""The error of an answer to a program, in shares on which units have no influence."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ...numerics import work
from ...numerics.arrays import Mask, Vector, inner, row_of
from ...numerics.rounding import UNIT_ROUNDOFF, gamma
from ...problem.data import ProblemData

#: the share of the largest unknown of its group, or of q, up to which an unknown may be rounding
_NOISE_OF_X = 1e-13
#: the share of the largest entry of g in its group, and of the terms of its row, up to which what is wrong with the
#: gradient may be rounding
_NOISE_OF_GRADIENT = 1e-3
#: products with A that cost as much as to judge an iterate, measured for a membrane with n = 22 500
_PRODUCTS = 10.0


class Violation(NamedTuple):
    """The largest share that is wrong: up to rounding, strictly, and strictly in rows whose terms are not rounding."""

    rounded: float = np.inf
    strict: float = np.inf
    significant: float = np.inf


class Judge:
    """The judge of conditions with the matrix [[H, Eᵀ, Gᵀ], [−E, 0, 0], [−G, 0, 0]], x standing in the rows `is_x`.

    Where z_i is on an obstacle to which p_i presses it, nothing is wrong in row i. Elsewhere |p_i| is, as a share of
    the sum of the |terms| of p_i. What sums of the largest unknowns lose by rounding is left out, of those that a chain
    of rows connects with row i, by entries that are not rounding beside the others.

    The gap is the second criterion, so that large entries of H do not hide g. Where y = x + Δ is in C,
    (Hx + g)ᵀ(y − x) is at least −Σ|p_i|d_i. Here d_i is the distance to the obstacle or, if less, |z_i|. For x
    (|H||x|)_i/h_ii stands for that, which moves row i by as much as is in it. The gap is a share of its own terms.
    """

    def __init__(self, problem: ProblemData, is_x: Mask) -> None:
        work.charge_matrices(problem.A.nnz, 6)
        self.A = problem.A
        self.size = problem.matrix.absolute
        self.diagonal = problem.matrix.rows.diagonal
        self.is_x = is_x
        self.cost = _PRODUCTS * problem.matrix.product_cost
        #: the work that had been counted when it was due the last time
        self.counted = 0.0
        self.loss = float(gamma(3 + np.diff(self.size.indptr).max(initial=0)))
        i = row_of(self.size)
        j = self.size.indices
        largest = problem.matrix.rows.largest
        strong = (i == j) | (self.size.data > _NOISE_OF_X * np.maximum(largest[i], largest[j]))
        links = self.size
        if not strong.all():
            links = sp.coo_array((strong[strong], (i[strong], j[strong])), self.size.shape)
        #: the group of each unknown: x, or multipliers, that a chain of rows connects, so that they share rounding
        _, self.group = np.unique(2 * connected_components(links)[1] + is_x, return_inverse=True)

    def is_due(self) -> bool:
        """Whether the steps since it was due the last time have cost as much as to judge an iterate."""
        # less than 0 where that was in another thread
        is_due = not 0 <= work.counter() - self.counted < self.cost
        if is_due:
            self.counted = work.counter()
        return is_due

    @np.errstate(all="ignore")
    def violation(self, q: Vector, z: Vector, p: Vector, room: Vector) -> Violation:
        """The largest shares that are wrong at `z`; inf where they are NaN.

        `p` is p(z), and `room` the distance of z to the obstacle to which p presses it, all of shape (n,).
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
        """The sum of the |terms| of each row, and what Az adds to it where all unknowns of a group are its largest."""
        return np.asarray(self.size @ np.abs(z) + np.abs(q)), np.asarray(self.size @ self.largest(z))

    def largest(self, z: Vector) -> Vector:
        """The largest |entry| of each group, at its entries; those of A are about 1."""
        largest = np.zeros(z.size)
        np.maximum.at(largest, self.group, np.abs(z))
        return largest[self.group]

    def without_noise(self, q: Vector, z: Vector) -> Vector:
        """z with 0 for what may be rounding beside the largest of its group, or beside q."""
        return np.where(np.abs(z) <= _NOISE_OF_X * np.maximum(self.largest(z), np.abs(q).max()), 0.0, z)
