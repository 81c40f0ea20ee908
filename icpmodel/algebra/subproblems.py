"""Problems that are smaller or simpler than a given one, and whose solutions solve it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..numerics.arrays import Mask, Vector, read_only, row_of, with_entries
from ..numerics.rounding import UNIT_ROUNDOFF
from ..problem.affine import Constant
from ..problem.data import ProblemData
from ..problem.map import Map
from ..problem.two_sided import TwoSidedObstacle, sides_of
from .affine_lcp import MAX_PIVOTS_PER_ROW, PIVOT_UP_TO
from .equations import restricted_data

#: the largest number of independent parts that are solved separately
_MAX_PARTS = 32
#: obstacles that cross by at most this share of their sizes cross by rounding only
MAX_CROSSING = 4.0 * UNIT_ROUNDOFF

Rows = NDArray[np.intp]


def with_fixed_obstacle(problem: ProblemData) -> ProblemData:
    """The equivalent problem with fixed obstacles, where `has_fixed_obstacle`: an LCP, or one with two bounds.

    Otherwise, and where ψ is constant, `problem` itself. Raises MapError where ψ fails.
    """
    if problem.psi.is_constant or not problem.facts.has_fixed_obstacle:
        return problem
    # whether they cross is checked with the solution
    return problem.with_psi(_fixed(problem.facts.obstacle, problem.facts.upper_obstacle))


def _fixed(low: Vector, high: Vector | None) -> Map:
    """The obstacle `low`, with the upper one `high` if there is one; both of shape (n,)."""
    psi = Constant(low).bind(low.size)
    return psi if high is None else TwoSidedObstacle(psi, Constant(high).bind(low.size))


def without_redundant_rows(problem: ProblemData) -> ProblemData:
    """A problem of the same size without redundant rows; each of its solutions is one of `problem`.

    It has a solution if and only if `problem` has one.

    Notes
    -----
    It is `problem` itself where ψ is not constant, nothing is redundant, or q overflows. Otherwise
    the redundant rows are replaced by equations z_i = c_i without an obstacle:

    - ψ_i = ψ̄_i, or they cross by rounding only: c_i = ψ_i, whatever p_i is.
    - Row i of A is empty: c_i = ψ_i where q_i > 0, ψ̄_i where q_i < 0. Where q_i = 0 and column i
      is empty as well, c_i is the number between them nearest to 0.
    """
    c = redundant_values(problem)
    known = np.isfinite(c)
    if not known.any():
        return problem
    A = problem.A
    c = np.where(known, c, 0.0)
    data = np.where(known[row_of(A)] | known[A.indices], 0.0, A.data)
    reduced = with_entries(A, data) + sp.diags_array(known.astype(np.float64))
    with np.errstate(over="ignore", invalid="ignore"):
        q = np.where(known, -c, problem.q + problem.product(c))
    if not np.isfinite(q).all():
        return problem
    facts = problem.facts
    high = None
    if facts.upper_obstacle is not None and np.isfinite(facts.upper_obstacle[~known]).any():
        high = np.where(known, np.inf, facts.upper_obstacle)
    return ProblemData(sp.csr_array(reduced), q, _fixed(np.where(known, -np.inf, facts.obstacle), high))


def redundant_values(problem: ProblemData) -> Vector:
    """c_i in the rows that `without_redundant_rows` makes equations z_i = c_i, and NaN in the others; shape (n,)."""
    n = problem.n
    if not problem.psi.is_constant:
        return np.full(n, np.nan)
    A = problem.A
    q = problem.q
    low = problem.facts.obstacle
    high = np.full(n, np.inf) if problem.facts.upper_obstacle is None else problem.facts.upper_obstacle
    with np.errstate(invalid="ignore"):
        is_fixed = (low >= high) & (low - high <= MAX_CROSSING * (np.abs(low) + np.abs(high)))
    value = np.where(q > 0, low, np.where(q < 0, high, np.minimum(np.maximum(0.0, low), high)))
    is_redundant = problem.matrix.empty_rows & np.isfinite(value)
    if is_redundant.any():
        is_redundant &= (q != 0) | (np.bincount(A.indices[A.data != 0], minlength=n) == 0)
    return np.where(is_fixed, low, np.where(is_redundant, value, np.nan))


def restricted(problem: ProblemData, rows: Rows, z: Vector) -> ProblemData:
    """The ICP in the unknowns `rows`, ascending, with the values of `z`, shape (n,), for all others."""
    part, q = restricted_data(problem, rows, z)
    return ProblemData.of_checked(part, q, problem.psi.restricted(rows, z), problem.matrix.row_weights[rows])


@dataclass(frozen=True, eq=False, repr=False)
class Blocks:
    """The rows of `problem` in blocks that depend on earlier blocks only: the strong components of A and ψ.

    Block k is `rows[starts[k] : starts[k + 1]]`. The masks `before_core` and `after_core` select small
    blocks, which are solved one after the other before the core and after it. The core is all other
    blocks; its `parts` do not interact. More than 32 parts are joined into one.
    """

    problem: ProblemData
    rows: Rows
    starts: Rows
    before_core: Mask
    after_core: Mask
    parts: tuple[Rows, ...]

    def __repr__(self) -> str:
        small = np.diff(self.starts)[self.before_core | self.after_core]
        single = np.count_nonzero(small == 1)
        facts = {
            f"{single} follow one by one": single,
            f"{small.sum() - single} in {small.size - single} small blocks are pivoted": small.size > single,
            f"{len(self.parts)} parts do not interact": len(self.parts) > 1,
        }
        return f"n = {self.problem.n} -> {self.core} rows: {', '.join(text for text, holds in facts.items() if holds)}"

    @property
    def is_pivoted(self) -> bool:
        """Whether a block outside the core has several rows."""
        return bool((np.diff(self.starts)[self.before_core | self.after_core] > 1).any())

    @property
    def largest(self) -> int:
        """The number of rows of the largest part."""
        return max((part.size for part in self.parts), default=0)

    @property
    def core(self) -> int:
        """The number of rows in the core."""
        return sum(part.size for part in self.parts)

    def with_core(self, unsolved: Mask) -> Blocks | None:
        """New blocks with the `unsolved` ones, which `substitute` did not solve, added to the core."""
        core = np.zeros(self.problem.n, dtype=bool)
        core[self.rows[np.repeat(unsolved, np.diff(self.starts))]] = True
        core[np.concatenate([*self.parts, self.rows[:0]])] = True
        return blocks(self.problem, core)

    def substitute(self, z: Vector, selected: Mask) -> tuple[Vector, Mask]:
        """`z` with the `selected` blocks solved in turn, in a copy, and the mask of those that `solve_blocks` solved.

        References
        ----------
        Cottle, Pang and Stone, The Linear Complementarity Problem (1992), section 4.4.
        """
        if not selected.any():
            return z, selected
        from .kernels.blocks import solve_blocks  # loads numba

        A = self.problem.A
        z = z.copy()
        # rows whose ψ is not affine are never selected
        psi = self.problem.psi
        upper = None
        G, c = psi.linear or (sp.csr_array(A.shape), np.full(z.size, -np.inf))
        slopes = (G.indptr, G.indices, G.data)
        if psi.upper is not None and psi.upper.linear is not None:
            H, d = psi.upper.linear
            upper = (H.indptr, H.indices, H.data), d
        arrays = read_only((A.indptr, A.indices, A.data, self.problem.q, c, slopes, upper))
        return z, solve_blocks(*arrays, self.rows, self.starts, selected, MAX_PIVOTS_PER_ROW, z)


def blocks(problem: ProblemData, core: Mask | None = None) -> Blocks | None:
    """The blocks of `problem`; None where all rows are one large block, or the dependence of ψ is not known.

    Parameters
    ----------
    problem : ProblemData
        The problem.
    core : mask of shape (n,), optional
        Rows that must be in the core.

    References
    ----------
    Tarjan, SIAM J. Comput. 1 (1972), for strong components.
    """
    from scipy.sparse.csgraph import connected_components

    graph = problem.A  # where row i depends on unknown j, be it through A or ψ
    if not problem.facts.has_fixed_obstacle:
        links = problem.psi.links
        if links is None:
            return None
        graph = sp.csr_array(problem.matrix.absolute + links)
    count, part = connected_components(graph, connection="strong")
    if count == 1 and problem.n > PIVOT_UP_TO:
        return None
    # SciPy numbers the components so that each depends only on those before it
    fixed = with_fixed_obstacle(problem)
    sizes = np.bincount(part, minlength=count)
    needs_method = sizes > PIVOT_UP_TO
    needs_method[part[_unsuitable(fixed, part, sizes)]] = True
    if core is not None:
        needs_method[part[core]] = True
    rows = np.argsort(part, kind="stable")
    starts = np.concatenate([[0], np.cumsum(sizes)])
    from ..numerics.kernels.graph import dependence  # loads numba

    follows, needed = dependence(graph.indptr, graph.indices, part, rows, starts, needs_method)
    parts = _parts(graph, np.flatnonzero((follows & needed)[part]))
    return Blocks(fixed, rows, starts, ~follows, follows & ~needed, parts)


def _unsuitable(problem: ProblemData, part: Any, sizes: Any) -> Mask:
    """Rows that `Blocks.substitute` cannot solve: without a unique solution, or with a moving ψ inside a block."""
    psi = problem.psi
    single = sizes[part] == 1
    unsuitable: Mask = single & ~(problem.A.diagonal() > 0)
    if psi.upper is not None and (psi.linear is None or psi.upper.linear is None):
        return np.ones(problem.n, dtype=bool)
    for one in sides_of(psi):
        if one.linear is not None:
            G = one.linear[0]
            i = row_of(G)
            j = G.indices
            unsuitable |= single & ~(G.diagonal() < 1)
            unsuitable[i[~single[i] & (part[i] == part[j])]] = True
        elif one.links is not None:
            unsuitable |= np.diff(one.links.indptr) > 0
            unsuitable[one.links.indices] = True
    return unsuitable


def _parts(graph: sp.csr_array, core: Rows) -> tuple[Rows, ...]:
    """The rows of the `core` in parts that do not interact; as one part if there are too many."""
    from scipy.sparse.csgraph import connected_components

    if not core.size:
        return ()
    label = connected_components(graph[core][:, core], connection="weak")[1]
    order = np.argsort(label, kind="stable")
    parts = np.split(core[order], np.flatnonzero(np.diff(label[order])) + 1)
    return tuple(parts) if len(parts) <= _MAX_PARTS else (core,)
