"""What a sparse factorisation will cost, foreseen on the graph of A + Aᵀ, and the order of the rows that it needs."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import OutOfTime
from . import work
from .arrays import Vector, bandwidths, is_symmetric
from .work import Fill, dense_cost, factor_cost, least_factor_cost

#: a row with more than this times √n neighbours goes last, and counts as one that fills up: Amestoy, Davis and Duff,
#: ACM TOMS 30 (2004)
_DENSE = 10.0
#: entries that differ by a smaller share are the same up to rounding
_SAME = 1e-13
#: a fill and the order of the rows and columns, shape (n,)
Seen = tuple[Fill, NDArray[np.int32]]


def of_band(n: int, below: int, above: int, symmetric: bool = False) -> Fill:
    """The fill of a band with so many diagonals below the main one and above it.

    There is room for exchanges of rows. For a `symmetric` band it is the fill of Cholesky's factor,
    which needs none.
    """
    entries, flops = (below + 1, 0.5 * below) if symmetric else (2 * below + above + 1, float(below + above))
    return Fill(n, float(n) * entries, 2.0 * n * below * flops, True, True)


def ordered(A: sp.csr_array, most: float, most_cost: float = np.inf, symmetric: bool = False) -> Seen:
    """The fill of `A` and the order of its rows and columns; not `seen` beyond `most` entries, or where it costs more
    than `most_cost` nanoseconds."""
    from .kernels.graph import order

    fill, _, path = _looked(A, symmetric, np.inf, 0.5 * most - A.shape[0], most_cost)
    return fill, order(*path)


class Look:
    """Symbolic analysis of `A`: what it takes to factorise it, computed once.

    It covers a dense matrix, a band, and an order for the pattern with pivots on the diagonal.
    Where the pattern is not symmetric the fill is an upper bound.

    Parameters
    ----------
    A : CSR array of shape (n, n)
        The matrix.
    is_symmetric : callable, optional
        Returns whether A is symmetric, where that is known elsewhere.
    seen : Seen, optional
        The complete fill and the order of the rows and columns, where they are known.

    Notes
    -----
    Rows of the least approximate degree go first, on a quotient graph. The analysis ends early
    where a factorisation takes longer than was asked about. It also ends where it takes 300 times
    the time spent on the analysis. That is predicted by a separator of the remaining rows, once no
    row has fewer neighbours than there were on the average. So a hopeless matrix costs some tens of
    products with A, or some hundreds.

    References
    ----------
    Amestoy, Davis and Duff, SIAM J. Matrix Anal. Appl. 17 (1996).
    """

    def __init__(
        self, A: sp.csr_array, is_symmetric: Callable[[], bool] | None = None, seen: Seen | None = None
    ) -> None:
        self.matrix, self._told, self.seen = A, is_symmetric, seen
        self._least, self._is_full = least_factor_cost(A.shape[0], A.nnz), A.nnz == A.shape[0] ** 2
        self._fill: Fill | None = seen[0] if seen else None  # in an order for the pattern
        self._cost = factor_cost(seen[0]) if seen else 0.0

    @cached_property
    def reach(self) -> tuple[int, int]:
        """How far the entries reach below the diagonal, and above it."""
        return bandwidths(self.matrix)

    @cached_property
    def is_symmetric(self) -> bool:
        """Whether A = Aᵀ."""
        return self._told() if self._told else is_symmetric(self.matrix)

    @cached_property
    def signs(self) -> Vector | None:
        """±1 for each row, which make A symmetric up to rounding; None where no signs do."""
        return signs_of_symmetry(self.matrix)

    @cached_property
    def band(self) -> Fill:
        """The fill as a band."""
        below, above = self.reach
        return of_band(self.matrix.shape[0], below, above, below == above and self.is_symmetric)

    @cached_property
    def is_narrow(self) -> bool:
        """Whether factors of the band cost less than twice what others would if they did not fill up at all: to look
        how far they do costs about as much as these."""
        return not self.band_costs_more(2.0 * self._least)

    @cached_property
    def is_dense(self) -> bool:
        """Whether a dense factorisation costs less than any other, and fits into memory."""
        n = self.matrix.shape[0]
        return self.costs_more(dense_cost(n, self.is_symmetric)) and work.fits(16.0 * n**2)

    @cached_property
    def is_band(self) -> bool:
        """Whether factors of the band cost no more than those in an order for the pattern."""
        return self.is_narrow or (not self._is_full and self._fills_more(factor_cost(self.band)))

    @property
    def fill(self) -> Fill:
        """What costs less; rough where it is not worth a closer look."""
        if self._is_full:
            n = self.matrix.shape[0]
            return Fill(n, float(n) ** 2, float(n) ** 3 / 3.0, True)
        return self.band if self.is_band or self._fill is None else self._fill

    def to_the_end(self) -> Look:
        """This one where it has seen all, or another one that has; this one is left as it is."""
        if self.fill.seen:
            return self
        return Look(self.matrix, self._told, ordered(self.matrix, np.inf, symmetric=self.signs is not None))

    def band_costs_more(self, most: float) -> bool:
        """Whether it takes more than so many nanoseconds to factorise the band."""
        below, above = self.reach
        if factor_cost(of_band(self.matrix.shape[0], below, above, below == above)) > most:
            return True  # to ask whether A is symmetric takes as long as some products
        return factor_cost(self.band) > most

    def costs_more(self, most: float) -> bool:
        """Whether it is foreseen to take more than so many nanoseconds to factorise A."""
        return self.band_costs_more(most) and self._fills_more(most)

    def _fills_more(self, most: float) -> bool:
        """The same in an order for the pattern."""
        from .kernels.graph import order

        if self._is_full:
            return factor_cost(self.fill) > most
        if self._least > most:
            return True
        if self._fill is None:
            fill, self._cost, path = _looked(self.matrix, self.signs is not None, work.COSTS.look, np.inf, most)
            if not fill.seen and self._cost > most:
                return True  # and for a larger limit it is looked at again
            self._fill = fill
            if fill.seen:
                self.seen = fill, order(*path)
        return self._cost > most


def signs_of_symmetry(A: sp.csr_array) -> Vector | None:
    """σ, ±1 for each row, with σ_i a_ij = σ_j a_ji up to rounding.

    None where there are no such signs, or where one of the two entries is not stored.
    """
    from .kernels.graph import signs  # loads numba

    found = signs(A.indptr, A.indices, A.data, _SAME) if A.has_canonical_format else np.empty(0)
    return found if found.size else None


def _looked(
    A: sp.csr_array, symmetric: bool, a_look: float, most_entries: float, most_cost: float
) -> tuple[Fill, float, tuple[Any, Any]]:
    """The fill, `seen` where it is within the limits, the cost that was held against them, and the path to an order."""
    from .kernels.elimination import minimum_degree
    from .kernels.graph import both_ways

    work.afford(work.COSTS.look * A.nnz)  # to make the graph costs a look per entry
    graph = both_ways(A.indptr, A.indices, int(_DENSE * A.shape[0] ** 0.5) + 16)
    n = A.shape[0]
    least = least_factor_cost(n, 0, symmetric)
    costs = work.COSTS
    an_entry = costs.symmetric_entry if symmetric else costs.factor_entry
    prices = (2.0 * an_entry, costs.factor_flop, a_look)
    limits = most_entries, most_cost - least, work.nanoseconds_left() / costs.look
    entries, squares, looks, within, *path = minimum_degree(*graph, A.nnz, prices, *limits)
    work.add(costs.call + costs.look * (looks + A.nnz))
    if looks > limits[2]:
        raise OutOfTime("to foresee what a factorisation costs takes longer than what is left of the time")
    fill = Fill(n, 2.0 * (entries + n), entries + squares, within)
    if symmetric:
        fill = min(fill, fill._replace(symmetric=True), key=factor_cost)
    return fill, factor_cost(fill), (path[0], path[1])
