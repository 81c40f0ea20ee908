"""The multipliers of equations that stand beside conditions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...numerics.arrays import Vector, row_of

#: what rounding may have changed in a coefficient, as a share of the largest one of its row
_ROUNDING = 1e-12


class Multipliers(NamedTuple):
    """The λ of the equations h(z) = 0 in p = … + (∂h/∂z)ᵀλ, over those z that conditions own.

    λ_i is the sum of `factor` · z_j over the pairs (`equation` i, `entry` j). In a pair the column of z_j in p is a
    multiple of the row of the equation, which does not contain z_j, as in the conditions of an optimum. `equations` is
    their number.
    """

    equations: int
    equation: NDArray[np.intp]
    entry: NDArray[np.intp]
    factor: Vector

    @classmethod
    def of(cls, equations: sp.csr_array, p: sp.csr_array, own: NDArray[np.intp]) -> Multipliers:
        """From the coefficients of the `equations` and of `p`, of which row k belongs to the entry own[k] of z."""
        m, n = equations.shape
        free = np.setdiff1d(np.arange(n), own)
        equation, factor = multiples(sp.csr_array(equations[:, own]), sp.csr_array(p[:, free].T))
        inside = np.isin(equation * n + free, row_of(equations) * n + equations.indices)
        found = np.flatnonzero((equation >= 0) & ~inside)
        return cls(m, equation[found], free[found], factor[found])

    def at(self, z: Vector) -> Vector:
        """λ, NaN where an equation has none."""
        known = np.bincount(self.equation, minlength=self.equations) > 0
        sums = np.bincount(self.equation, self.factor * z[self.entry], minlength=self.equations)
        return np.where(known, sums, np.nan)


def multiples(E: sp.csr_array, B: sp.csr_array) -> tuple[NDArray[np.intp], Vector]:
    """For each row of `B` a row of `E` of which it is a multiple, −1 where there is none, and the factor. Multiples
    have the same quotient of two random sums, so that only neighbours in that are compared."""
    of = np.full(B.shape[0], -1, dtype=np.intp)
    factor = np.zeros(B.shape[0])
    if not E.shape[0] or not E.shape[1]:
        return of, factor
    weights = np.random.default_rng(0).normal(size=(E.shape[1], 2))
    with np.errstate(all="ignore"):
        e = E @ weights
        b = B @ weights
        quotients = e[:, 0] / e[:, 1]
        wanted = b[:, 0] / b[:, 1]
        order = np.argsort(quotients)
        after = np.searchsorted(quotients[order], wanted)
        for place in (after - 1, after):
            row = order[np.clip(place, 0, E.shape[0] - 1)]
            times = b[:, 1] / e[row, 1]
            apart = abs(B - sp.diags_array(times) @ E[row]).max(axis=1).toarray()
            largest = abs(B).max(axis=1).toarray()
            same = (largest > 0) & (apart <= _ROUNDING * largest)
            of = np.where(same, row, of)
            factor = np.where(same, times, factor)
    return of, factor
