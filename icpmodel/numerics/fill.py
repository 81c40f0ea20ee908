"""What a sparse factorisation will cost, foreseen on the graph of A + Aᵀ."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import OutOfTime
from . import work
from .arrays import Vector, bandwidths, is_symmetric, read_only
from .work import Fill, dense_cost, factor_cost, least_factor_cost

#: a row with more than this times √n neighbours goes last, and counts as one that fills up: Amestoy, Davis and Duff,
#: ACM TOMS 30 (2004)
_DENSE = 10.0
#: entries that differ by a smaller share are the same up to rounding
_SAME = 1e-13


def of_band(n: int, below: int, above: int, symmetric: bool = False) -> Fill:
    """The fill of a band with so many diagonals below the main one and above it.

    There is room for exchanges of rows. For a `symmetric` band it is the fill of Cholesky's factor,
    which needs none.
    """
    entries, flops = (below + 1, 0.5 * below) if symmetric else (2 * below + above + 1, float(below + above))
    return Fill(n, float(n) * entries, 2.0 * n * below * flops, True, True)


def predicted_fill(
    A: sp.csr_array,
    most_entries: float = np.inf,
    most_cost: float = np.inf,
    symmetric: bool = False,
    patient: bool = True,
) -> Fill:
    """The fill of a sparse factorisation of `A`, by minimum degree on the graph of A + Aᵀ.

    Parameters
    ----------
    A : CSR array of shape (n, n)
        The matrix.
    most_entries, most_cost : float, optional
        The analysis ends where L + U have more entries, or cost more nanoseconds. Then the fill is
        rough, and not `seen`.
    symmetric : bool, default False
        Whether signs of the rows make A symmetric.
    patient : bool, default True
        Whether the analysis goes on where a factorisation would take 300 times as long as it has
        taken.

    Raises
    ------
    OutOfTime
        Where the analysis itself takes longer than what is left.

    Notes
    -----
    Rows of the least approximate degree go first, on a quotient graph. What a factorisation takes
    at the least is predicted by a separator of the remaining rows, once no row has fewer neighbours
    than there were on the average. So a hopeless matrix costs some tens of products with A, or some
    hundreds. No library predicts the fill without a factorisation: SciPy has none, QDLDL and
    SuperLU order and factorise in one call.

    References
    ----------
    Amestoy, Davis and Duff, SIAM J. Matrix Anal. Appl. 17 (1996).
    """
    return _by_minimum_degree(A, most_entries, most_cost, symmetric, patient)[0]


def ordered(A: sp.csr_array) -> tuple[Fill, NDArray[np.intp]]:
    """The fill of `A` and the order of its rows, shape (n,), that minimum degree finds."""
    fill, into, turn = _by_minimum_degree(A)
    root = np.where(into < 0, np.arange(into.size), into)
    while not np.array_equal(further := root[root], root):
        root = further
    return fill, np.argsort(turn[root], kind="stable")


def _by_minimum_degree(
    A: sp.csr_array,
    most_entries: float = np.inf,
    most_cost: float = np.inf,
    symmetric: bool = False,
    patient: bool = True,
) -> tuple[Fill, NDArray[np.int64], NDArray[np.int64]]:
    """The fill, for each row the one that it goes with, or -1, and when that was eliminated."""
    from .kernels.elimination import minimum_degree
    from .kernels.graph import both_ways

    n = A.shape[0]
    costs = work.COSTS
    work.check_budget(costs.look * A.nnz)  # to make the graph costs a look per entry
    graph = both_ways(*read_only((A.indptr, A.indices)), int(_DENSE * n**0.5) + 16)
    # the least that either library takes
    prices = (
        2.0 * (costs.symmetric_entry if symmetric else costs.factor_entry),
        costs.factor_flop,
        np.inf if patient else costs.look,
    )
    most_looks = work.nanoseconds_left() / costs.look
    limits = 0.5 * most_entries - n, most_cost - least_factor_cost(n, 0, symmetric), most_looks
    entries, squares, looks, within, into, turn = minimum_degree(*graph, A.nnz, prices, *limits)
    work.count(costs.call + costs.look * (looks + A.nnz))
    if looks > most_looks:
        raise OutOfTime("to foresee what a factorisation costs takes longer than what is left of the time")
    fill = Fill(n, 2.0 * (entries + n), entries + squares, within)
    return min(fill, fill._replace(symmetric=symmetric), key=factor_cost), into, turn


class SymbolicAnalysis:
    """What it takes to factorise `A`, as a dense matrix, a band or a sparse one, computed once.

    Where the pattern is not symmetric the fill is an upper bound.

    Parameters
    ----------
    A : CSR array of shape (n, n)
        The matrix.
    is_symmetric : callable, optional
        Returns whether A is symmetric, where that is known elsewhere.
    """

    def __init__(self, A: sp.csr_array, is_symmetric: Callable[[], bool] | None = None) -> None:
        self.matrix = A
        self._known_symmetry = is_symmetric
        self._least = least_factor_cost(A.shape[0], A.nnz)
        self._is_full = A.nnz == A.shape[0] ** 2
        self._sparse: Fill | None = None

    @cached_property
    def reach(self) -> tuple[int, int]:
        """How far the entries reach below the diagonal, and above it."""
        return bandwidths(self.matrix)

    @cached_property
    def is_symmetric(self) -> bool:
        """Whether A = Aᵀ."""
        return self._known_symmetry() if self._known_symmetry else is_symmetric(self.matrix)

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
    def is_dense(self) -> bool:
        """Whether a dense factorisation costs less than any other, and fits into memory."""
        n = self.matrix.shape[0]
        return self.costs_more(dense_cost(n, self.is_symmetric)) and work.fits(16.0 * n**2)

    @cached_property
    def is_band(self) -> bool:
        """Whether factors of the band cost no more than sparse ones.

        That is so where they cost less than twice what sparse ones would without any fill.
        """
        narrow = not self.band_costs_more(2.0 * self._least)
        return narrow or (not self._is_full and self._sparse_costs_more(factor_cost(self.band)))

    @property
    def fill(self) -> Fill:
        """What costs less; rough where it is not worth a closer look."""
        if self._is_full:
            n = self.matrix.shape[0]
            return Fill(n, float(n) ** 2, float(n) ** 3 / 3.0, True)
        return self.band if self.is_band or self._sparse is None else self._sparse

    @property
    def complete(self) -> Fill | None:
        """The fill of a sparse factorisation, None where it has not been seen to the end."""
        return self._sparse if self._sparse is not None and self._sparse.seen else None

    def to_the_end(self) -> SymbolicAnalysis:
        """This one where it has seen all, or another one that has; this one is left as it is."""
        if self.fill.seen:
            return self
        whole = SymbolicAnalysis(self.matrix, self._known_symmetry)
        whole._sparse = predicted_fill(self.matrix, symmetric=self.signs is not None)
        return whole

    def band_costs_more(self, most: float) -> bool:
        """Whether it takes more than so many nanoseconds to factorise the band."""
        below, above = self.reach
        if factor_cost(of_band(self.matrix.shape[0], below, above, below == above)) > most:
            return True  # to ask whether A is symmetric takes as long as some products
        return factor_cost(self.band) > most

    def costs_more(self, most: float) -> bool:
        """Whether it is foreseen to take more than so many nanoseconds to factorise A."""
        return self.band_costs_more(most) and self._sparse_costs_more(most)

    def _sparse_costs_more(self, most: float) -> bool:
        if self._is_full:
            return factor_cost(self.fill) > most
        if self._least > most:
            return True
        if self._sparse is None:
            fill = predicted_fill(self.matrix, np.inf, most, self.signs is not None, patient=False)
            if not fill.seen and factor_cost(fill) > most:
                return True  # and for a larger limit it is computed again
            self._sparse = fill
        return factor_cost(self._sparse) > most


def signs_of_symmetry(A: sp.csr_array) -> Vector | None:
    """σ, ±1 for each row, with σ_i a_ij = σ_j a_ji up to rounding.

    None where there are no such signs, or where one of the two entries is not stored.
    """
    from .kernels.graph import signs  # loads numba

    found = signs(*read_only((A.indptr, A.indices, A.data)), _SAME) if A.has_canonical_format else np.empty(0)
    return found if found.size else None
