"""Symbolic analysis: what a factorisation costs, as a dense matrix, a band or a sparse one."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from . import work
from .arrays import Vector, read_only, row_of
from .processes import run_script
from .sparse_structure import ROUNDING_RTOL, bandwidths, is_symmetric
from .work import COSTS

#: nanoseconds of a symbolic analysis: for any size, per entry, and per squared number of entries of a column; 10⁵ rows
#: coupled to one of 10⁴, 3·10⁴ and 6·10⁴ others took 1.1 to 2 times that
_ANALYSIS_COST = 100_000.0
_ANALYSIS_COST_PER_ENTRY = 150.0
_ANALYSIS_COST_PER_SQUARE = 1.0
#: the most nanoseconds of an analysis, divided by n and by the number of entries: random graphs with 4 to 30 entries in
#: a row, which fill up, took .3 to 1.6, grids .01 to .06 (n = 1500 to 10⁴)
_MAX_COST_FACTOR = 1.6
#: a graph with more rows than the first number, and more entries in the mean row than the second, is not analysed where
#: a breadth-first layer has more than the third as a share of the rows
_SMALL_GRAPH = 2000
_THIN_DEGREE = 5
_WIDE_LAYER = 0.125
#: of n rows, those with more than this multiple of √n entries are eliminated last
_THIN_FACTOR = 10.0
#: an analysis has its own process if its worst case takes this many times as long as a process: graphs that fill up
#: take .05 of the worst case or more
_LONG = 100.0
#: the most that grids take of the worst case
_GRID_SHARE = 0.06
#: script: the place of each row in SuperLU's order, for a matrix and the options of `spilu`
_ORDER = """
import pickle, sys
from scipy.sparse.linalg import spilu
matrix, options = pickle.load(sys.stdin.buffer)
pickle.dump(spilu(matrix, **options).perm_c, sys.stdout.buffer)
"""


class Fill(NamedTuple):
    """The `entries` of L + U with this number of `rows`, and the `flops` (multiplications) that make them.

    Both are estimates unless `is_exact`. A `band` is stored and factorised as if it were full. Of
    factors that are `symmetric`, up to the signs of rows, only a half is stored and computed.
    """

    rows: int
    entries: float
    flops: float
    is_exact: bool
    band: bool = False
    symmetric: bool = False


def factor_cost(fill: Fill) -> float:
    """The cost of a factorisation with this fill; that of a sparse one includes the ordering."""
    if fill.band:
        return COSTS.band + COSTS.band_entry * fill.entries + COSTS.band_flop * fill.flops
    if fill.symmetric:
        return COSTS.symmetric_row * fill.rows + refactor_cost(fill)
    without_fill = COSTS.call + COSTS.factor_row * fill.rows
    return without_fill + COSTS.factor_entry * fill.entries + COSTS.factor_flop * fill.flops


def refactor_cost(fill: Fill) -> float:
    """The cost of a symmetric factorisation with this fill, if the pattern was analysed before."""
    return COSTS.call + COSTS.symmetric_entry * fill.entries + COSTS.symmetric_flop * fill.flops


def least_factor_cost(n: int, nnz: int, symmetric: bool = True) -> float:
    """The cost of a sparse factorisation without fill."""
    return factor_cost(Fill(n, nnz, 0.0, True, symmetric=symmetric))


def solve_cost(fill: Fill) -> float:
    """The cost of a solve with the factors."""
    return COSTS.call + COSTS.solve_entry * fill.entries


def dense_cost(n: int, symmetric: bool = False) -> float:
    """The cost of a dense LU factorisation of a sparse matrix, or of Cholesky's if it is `symmetric`."""
    cost = COSTS.dense_entry * n**2 + COSTS.dense_flop * n**3 / 3.0
    return COSTS.call + (0.5 * cost if symmetric else cost)


def part_fill(fill: Fill, rows: int) -> Fill:
    """The estimated fill of a principal submatrix with `rows` rows: that of all, times the square of their share."""
    share = (rows / fill.rows) ** 2
    return fill._replace(rows=rows, entries=share * fill.entries, flops=share * fill.flops)


def band_fill(n: int, below: int, above: int, symmetric: bool = False) -> Fill:
    """The fill of a band with `below` diagonals below the main one and `above` above it.

    It has room for exchanges of rows. For a `symmetric` band it is the fill of Cholesky's factor,
    which needs no exchanges.
    """
    entries, flops = (below + 1, 0.5 * below) if symmetric else (2 * below + above + 1, float(below + above))
    return Fill(n, float(n) * entries, 2.0 * n * below * flops, True, True)


def fill_and_order(A: sp.csr_array, symmetric: bool = False) -> tuple[Fill, NDArray[np.integer]]:
    """The fill of a sparse factorisation of `A` (CSR, n × n), and the order of the rows, shape (n,).

    Raises
    ------
    OutOfTime
        Where the analysis itself takes longer than what is left.

    Notes
    -----
    SuperLU orders the graph of A + Aᵀ by minimum degree. It does so for an incomplete factorisation
    that drops all entries off the diagonal, which costs as much as some tens of products. Rows that
    are not `thin_rows` come last. The elimination tree then gives the entries of each column.

    References
    ----------
    Li, ACM TOMS 31 (2005). Liu, SIAM J. Matrix Anal. Appl. 11 (1990).
    """
    from .kernels.graph import column_counts

    n = A.shape[0]
    work.charge(_analysis_cost(A))
    sizes = np.where(A.indices == row_of(A), float(n), 1.0)  # so that the diagonal dominates
    graph = sp.csc_array((sizes, A.indices, A.indptr), shape=A.shape)
    if not symmetric:
        graph = graph + graph.T
    if not graph.diagonal().all():
        graph = graph + sp.diags_array(np.full(n, float(n)))
    graph = sp.csc_array(graph)
    is_thin = thin_rows(graph)
    order = np.concatenate([np.flatnonzero(is_thin), np.flatnonzero(~is_thin)])
    count = int(np.count_nonzero(is_thin))
    if count:
        order[:count] = order[_minimum_degree(graph if count == n else graph[is_thin][:, is_thin])]
    place = np.empty_like(order)
    place[order] = np.arange(n)
    entries, squares = column_counts(*read_only((graph.indptr, graph.indices, place)))
    fill = Fill(n, 2.0 * (entries + n), entries + squares, True)
    return min(fill, fill._replace(symmetric=symmetric), key=factor_cost), order


def _minimum_degree(graph: sp.csc_array) -> NDArray[np.integer]:
    """The rows in SuperLU's order of minimum degree; where that may take long, by a process that can be ended.

    SuperLU holds the interpreter's lock meanwhile.
    """
    from scipy.sparse.linalg import spilu

    options = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    options |= {"drop_tol": 0.5, "fill_factor": 1.0}
    most = _most_expensive_analysis(graph)
    limit = min(work.nanoseconds_left(), _LONG * COSTS.process)
    if most > limit and (_widest_layer(graph) > _WIDE_LAYER * graph.shape[0] or _GRID_SHARE * most > limit):
        with suppress(OSError):
            return np.argsort(run_script(_ORDER, (graph, options)))
    return np.argsort(spilu(graph, **options).perm_c)


def _most_expensive_analysis(A: Any) -> float:
    return _MAX_COST_FACTOR * float(A.shape[0]) * A.nnz


def _widest_layer(A: Any) -> float:
    """The most rows of a breadth-first layer; the search starts far from the row with the most entries."""
    from .kernels.graph import breadth_first_layers  # loads numba

    n = A.shape[0]
    last = np.argmax(np.diff(A.indptr))  # a row with few entries may be isolated
    for _ in range(2):  # the second time from the far end
        layer, order = breadth_first_layers(*read_only((A.indptr, A.indices, np.ones(A.nnz))), np.arange(n) == last)
        last = order[-1]
    return float(np.bincount(layer[order]).max())


def thin_rows(A: Any) -> NDArray[np.bool_]:
    """A mask of the rows i with at most 10√n entries in row i and in column i of a sparse matrix, as in AMD.

    The others are eliminated last: Amestoy, Davis and Duff, ACM TOMS 30 (2004).
    """
    n = A.shape[0]
    in_columns = np.bincount(A.indices, minlength=n)
    return np.maximum(in_columns, np.diff(A.indptr)) <= _THIN_FACTOR * math.sqrt(n)


def _analysis_cost(A: sp.csr_array) -> float:
    columns = np.bincount(A.indices, minlength=A.shape[0]).astype(np.float64)[thin_rows(A)]
    by_entries = _ANALYSIS_COST + _ANALYSIS_COST_PER_ENTRY * A.nnz
    return by_entries + _ANALYSIS_COST_PER_SQUARE * float(columns @ columns)


class SymbolicAnalysis:
    """The predicted cost of factors of `A`: dense, band or sparse; computed once.

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
        self._order: NDArray[np.integer] | None = None

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
        """Signs ±1 of the rows that make A symmetric up to rounding; None where there are none."""
        return signs_of_symmetry(self.matrix)

    @cached_property
    def band(self) -> Fill:
        """The fill as a band."""
        below, above = self.reach
        return band_fill(self.matrix.shape[0], below, above, below == above and self.is_symmetric)

    @cached_property
    def is_dense(self) -> bool:
        """Whether a dense factorisation costs less than any other, and fits into memory."""
        n = self.matrix.shape[0]
        return self.costs_more(dense_cost(n, self.is_symmetric)) and work.memory_suffices(16.0 * n**2)

    @cached_property
    def is_band(self) -> bool:
        """Whether factors of the band are preferred to sparse ones.

        They are where they cost at most twice what sparse ones would without fill, or less than sparse ones.
        """
        narrow = not self.band_costs_more(2.0 * self._least)
        return narrow or (not self._is_full and self._sparse_costs_more(factor_cost(self.band)))

    @property
    def fill(self) -> Fill:
        """The fill as a band or a sparse matrix, or of a full A; an estimate where a full analysis does not pay."""
        if self._is_full:
            n = self.matrix.shape[0]
            return Fill(n, float(n) ** 2, float(n) ** 3 / 3.0, True)
        return self.band if self.is_band or self._sparse is None else self._sparse

    @cached_property
    def complete(self) -> Fill:
        """The exact fill of a sparse factorisation, whatever `fill` estimates."""
        if self._sparse is not None:
            if self._sparse.is_exact:
                return self._sparse
            if work.seconds_left() == math.inf:  # no clock ends an analysis that exceeds a limit of counted work
                work.check_budget(_most_expensive_analysis(self.matrix))
        return self._analysed()

    @property
    def order(self) -> NDArray[np.integer]:
        """The order of the rows in a sparse factorisation, shape (n,)."""
        if self._order is None:
            self._analysed()
        assert self._order is not None
        return self._order

    def _analysed(self) -> Fill:
        fill, self._order = fill_and_order(self.matrix, self.signs is not None)
        return fill

    def exact(self) -> SymbolicAnalysis:
        """This analysis if its fill is exact, else another one whose fill is."""
        if self.fill.is_exact:
            return self
        analysis = SymbolicAnalysis(self.matrix, self._known_symmetry)
        analysis._sparse = self.complete
        analysis._order = self._order
        return analysis

    def of_similar(self, M: sp.csr_array) -> SymbolicAnalysis:
        """An analysis of an unsymmetric `M` with about the pattern of A; if that is sparse, with its fill and order."""
        analysis = SymbolicAnalysis(M, lambda: False)
        if not (self._is_full or self.is_dense or self.is_band):
            analysis._sparse = self.complete._replace(symmetric=False)
            analysis._order = self.order
        return analysis

    def band_costs_more(self, limit: float) -> bool:
        """Whether factors of the band cost more than `limit` nanoseconds."""
        below, above = self.reach
        if factor_cost(band_fill(self.matrix.shape[0], below, above, below == above)) > limit:
            return True  # the test whether A is symmetric takes as long as some products
        return factor_cost(self.band) > limit

    def costs_more(self, limit: float) -> bool:
        """Whether factors of A are expected to cost more than `limit` nanoseconds."""
        return self.band_costs_more(limit) and self._sparse_costs_more(limit)

    def _sparse_costs_more(self, limit: float) -> bool:
        if self._is_full:
            return factor_cost(self.fill) > limit
        if self._least + _analysis_cost(self.matrix) > limit:
            return True
        if self._sparse is None:
            self._sparse = self._expander_fill() or self._analysed()
        return factor_cost(self._sparse) > limit

    def _expander_fill(self) -> Fill | None:
        """An estimated fill if one breadth-first layer has many of the `thin_rows`, as in an expander; else None."""
        is_thin = thin_rows(self.matrix)
        A = self.matrix if is_thin.all() else self.matrix[is_thin][:, is_thin]
        n = A.shape[0]
        if n <= _SMALL_GRAPH or A.nnz <= _THIN_DEGREE * n:
            return None
        work.charge(4.0 * work.product_cost(n, A.nnz))
        widest = _widest_layer(A)
        front = widest + np.count_nonzero(~is_thin)
        rough = Fill(is_thin.size, front**2, front**3 / 3.0, False, symmetric=self.signs is not None)
        return rough if widest > _WIDE_LAYER * n else None


def signs_of_symmetry(A: sp.csr_array) -> Vector | None:
    """σ, ±1 for each row, with σ_i a_ij = σ_j a_ji up to rounding.

    None where there are no such signs, where one of the two entries is not stored, or where A is not canonical.
    """
    from .kernels.graph import symmetrising_signs  # loads numba

    sigma = (
        symmetrising_signs(*read_only((A.indptr, A.indices, A.data)), ROUNDING_RTOL)
        if A.has_canonical_format
        else np.empty(0)
    )
    return sigma if sigma.size else None
