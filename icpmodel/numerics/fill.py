"""What a sparse factorisation will cost, foreseen on the graph of A + Aᵀ, and the order of the rows that it needs."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import OutOfTime
from . import work
from .work import Fill, least_factor_cost

#: a row with more than this times √n neighbours goes last, and counts as one that fills up: Amestoy, Davis and Duff,
#: ACM TOMS 30 (2004)
_DENSE = 10.0


def of_band(n: int, below: int, above: int) -> Fill:
    """The fill of a band of so many diagonals below the main one and above it, without exchanges of rows."""
    return Fill(n, float(n) * (below + above + 2), float(n) * below * (above + 1), True)


def foreseen(A: sp.csr_array, most: float = np.inf) -> Fill:
    """The fill of `A` (CSR, n × n) with pivots on the diagonal, from above where A's pattern is not symmetric.

    Rows of the least approximate degree go first, on a quotient graph. It is not `seen` to the end where it takes more
    than `most` nanoseconds to factorise A, or a hundred times what was spent on looking, by a separator of what
    is left then: matrices that are hopeless cost some tens of products with A, others some hundreds at the most.
    Reference: Amestoy, Davis and Duff, SIAM J. Matrix Anal. Appl. 17 (1996).
    """
    entries, squares, within, _ = _looked(A, work.COSTS.look, np.inf, most - least_factor_cost(A.shape[0], 0))
    return Fill(A.shape[0], 2.0 * (entries + A.shape[0]), entries + squares, within)


def ordered(A: sp.csr_array, most: float, most_cost: float = np.inf) -> tuple[Fill, NDArray[np.int32]]:
    """The fill of `A` and the order of its rows and columns, shape (n,); not `seen` beyond `most` entries, or where
    it costs more than `most_cost` nanoseconds."""
    from .kernels.graph import order

    n = A.shape[0]
    entries, squares, within, path = _looked(A, np.inf, 0.5 * most - n, most_cost - least_factor_cost(n, 0))
    return Fill(n, 2.0 * (entries + n), entries + squares, within), order(*path)


class Look:
    """The fill of `A` (CSR, n × n), as `foreseen`, looked at once, however often it is asked what A costs.

    `seen` are the fill and the order of the rows and columns, shape (n,), once they are seen to the end.
    """

    def __init__(self, A: sp.csr_array) -> None:
        self._A, self._cost = A, 0.0
        self.seen: tuple[Fill, NDArray[np.int32]] | None = None

    def costs_more(self, most: float) -> bool:
        """Whether it is foreseen to take more than so many nanoseconds to factorise A."""
        from .kernels.graph import order

        n, costs = self._A.shape[0], work.COSTS
        if least_factor_cost(n, self._A.nnz) > most:
            return True
        if self.seen is None:
            entries, squares, within, path = _looked(self._A, costs.look, np.inf, most - least_factor_cost(n, 0))
            if not within:
                return True
            self.seen = Fill(n, 2.0 * (entries + n), entries + squares, True), order(*path)
            self._cost = least_factor_cost(n, 0) + 2.0 * costs.factor_entry * entries + costs.factor_flop * squares
            return False
        return self._cost > most


def _looked(
    A: sp.csr_array, a_look: float, most_entries: float, most_cost: float
) -> tuple[float, float, bool, tuple[Any, Any]]:
    """Entries of L off its diagonal, their squares summed by columns, whether within the limits, and the path."""
    from .kernels.elimination import minimum_degree
    from .kernels.graph import both_ways

    work.afford(work.COSTS.look * A.nnz)  # to make the graph costs a look per entry
    graph = both_ways(A.indptr, A.indices, int(_DENSE * A.shape[0] ** 0.5) + 16)
    prices = (2.0 * work.COSTS.factor_entry, work.COSTS.factor_flop, a_look)
    limits = most_entries, most_cost, work.nanoseconds_left() / work.COSTS.look
    entries, squares, looks, within, *path = minimum_degree(*graph, A.nnz, prices, *limits)
    work.add(work.COSTS.call + work.COSTS.look * (looks + A.nnz))
    if looks > limits[2]:
        raise OutOfTime("to foresee what a factorisation costs takes longer than what is left of the time")
    return entries, squares, within, (path[0], path[1])
