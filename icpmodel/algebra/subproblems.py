"""Model no more than the scene needs: problems that are smaller or simpler, and have the same solutions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..numerics.arrays import Mask, Vector, read_only, row_of
from ..problem.affine import Constant
from ..problem.data import ProblemData
from ..problem.two_sided import TwoSidedObstacle
from .affine_lcp import PIVOT_UP_TO

#: so many parts that do not interact get a method each
_PARTS = 32
#: up to so many stages are solved in turn; above `_PARTS`, where their blocks are large
_STAGES = 1000

Rows = NDArray[np.intp]


def with_fixed_obstacle(problem: ProblemData) -> ProblemData:
    """The problem with fixed obstacles that has the same solutions, where `has_fixed_obstacle`: an LCP, or a box.

    The problem itself where ψ is constant, or moves otherwise. Raises MapError where ψ fails.
    """
    if problem.psi.is_constant or not problem.facts.has_fixed_obstacle:
        return problem
    n = problem.n
    above = problem.facts.upper_obstacle
    psi = Constant(problem.facts.obstacle).bind(n)
    # whether they cross is judged with the answer
    return problem.with_psi(psi if above is None else TwoSidedObstacle(psi, Constant(above).bind(n)))


def restricted(problem: ProblemData, rows: Rows, z: Vector) -> ProblemData:
    """The ICP in the unknowns `rows` alone, ascending, where all others are what they are in `z`, shape (n,)."""
    from ..numerics.kernels.graph import cut  # loads numba

    A = problem.A
    psi = problem.psi
    starts, columns, values, q = cut(A.indptr, A.indices, A.data, problem.q, rows, z)
    part = sp.csr_array((values, columns, starts), shape=(rows.size, rows.size))
    return ProblemData.of_checked(part, q, psi.restricted(rows, z), problem.matrix.row_weights[rows])


@dataclass(frozen=True, eq=False, repr=False)
class Blocks:
    """The `free` rows of `problem` in blocks that depend on earlier ones only: the strong components of A and ψ.

    Block k is `rows[starts[k] : starts[k + 1]]`. The blocks in `before` are so small that they are
    solved one after the other. So are those in `after`, once the rest is known. The rest comes in
    `stages`, each of which depends on earlier ones only. A stage has the rows of its parts, which
    do not interact; many parts are joined into one. `between` holds a mask for each stage: the
    small blocks that follow it.

    The other rows are in contact with the fixed obstacle, see `with_contact_rows`. `releases` is how
    often some of them were set free.
    """

    problem: ProblemData
    free: Mask
    rows: Rows
    starts: Rows
    before: Mask
    after: Mask
    stages: tuple[tuple[Rows, ...], ...]
    between: tuple[Mask, ...] = ()
    releases: int = 0

    def __repr__(self) -> str:
        n = self.problem.n
        sizes = np.diff(self.starts)
        small = self.before | self.after
        for blocks_between in self.between:
            small = small | blocks_between
        rest = n - np.count_nonzero(self.free)
        one_by_one = int(small[sizes == 1].sum())
        pivoted = int(sizes[small].sum()) - one_by_one
        blocks = int(small.sum()) - one_by_one
        facts = {
            f"{rest} rest on the obstacle": rest,
            f"others were released ({self.releases} x)": self.releases,
            f"{one_by_one} follow one by one": one_by_one,
            f"{pivoted} in {blocks} small blocks are pivoted": pivoted,
            f"{len(self.parts)} parts do not interact": len(self.parts) > len(self.stages) == 1,
            f"{len(self.parts)} parts in {len(self.stages)} stages follow one another": len(self.stages) > 1,
        }
        return f"n = {n} -> {self.core} rows still free: {', '.join(text for text, holds in facts.items() if holds)}"

    @property
    def pivoted(self) -> float:
        """n³/3, the entries that n pivots change, of the small blocks that have several rows, together."""
        sizes = np.diff(self.starts)[np.logical_or.reduce((self.before, self.after, *self.between))]
        return float((sizes[sizes > 1] ** 3.0).sum() / 3.0)

    @property
    def parts(self) -> tuple[Rows, ...]:
        """The rows of the parts of all stages."""
        return tuple(part for stage in self.stages for part in stage)

    @property
    def core(self) -> int:
        """How many rows are left once blocks and rows at the obstacle are gone."""
        return sum(part.size for part in self.parts)

    def with_core(self, unsolved: Mask) -> Blocks | None:
        """The blocks once the `unsolved` ones, which `forward` cannot do, belong to the core as well."""
        core = np.zeros(self.problem.n, dtype=bool)
        core[self.rows[np.repeat(unsolved, np.diff(self.starts))]] = True
        core[np.concatenate([*self.parts, self.rows[:0]])] = True
        return blocks(self.problem, core)

    def forward(self, z: Vector, wanted: Mask) -> tuple[Vector, Mask]:
        """`z` with the `wanted` blocks solved in turn, and which of them are solved, as far as the kernel knows.

        References
        ----------
        Cottle, Pang and Stone, The Linear Complementarity Problem (1992), section 4.4.
        """
        if not wanted.any():
            return z, wanted
        from .kernels.pivoting import solve_blocks  # loads numba

        A = self.problem.A
        z = z.copy()
        # rows of a best jump are never in a block
        psi = self.problem.psi
        above = None
        G, c = psi.linear or (sp.csr_array(A.shape), np.full(z.size, -np.inf))
        slopes = (G.indptr, G.indices, G.data)
        if psi.upper is not None and psi.upper.linear is not None:
            H, d = psi.upper.linear
            above = (H.indptr, H.indices, H.data), d
        given = read_only((A.indptr, A.indices, A.data, self.problem.q, c, slopes, above))
        return z, solve_blocks(*given, self.rows, self.starts, wanted, z)


def with_contact_rows(problem: ProblemData, free: Mask) -> Blocks:
    """The `free` rows of `problem`, a mask of shape (n,), as one part; the others are at a fixed obstacle."""
    nothing = np.zeros(0, dtype=bool)
    rows = np.flatnonzero(free)
    return Blocks(problem, free, rows[:0], np.zeros(1, dtype=np.intp), nothing, nothing, ((rows,),))


def blocks(problem: ProblemData, core: Mask | None = None, *, most_stages: int = _STAGES) -> Blocks | None:
    """The blocks of `problem`, None where all rows are one, or where it is not known on which unknowns ψ depends.

    Parameters
    ----------
    problem : ProblemData
        The problem.
    core : mask of shape (n,), optional
        Rows that are to be in the core.
    most_stages : int
        Longer chains than this are one stage.

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
    from ..numerics.kernels.graph import linked  # loads numba

    if problem.n > PIVOT_UP_TO and linked(graph.indptr, graph.indices):
        return None
    count, part = connected_components(graph, connection="strong")
    if count == 1 and problem.n > PIVOT_UP_TO:
        return None
    # SciPy numbers the components so that each hangs on those before it only
    simple = with_fixed_obstacle(problem)
    sizes = np.bincount(part, minlength=count)
    heavy = sizes > PIVOT_UP_TO
    heavy[part[_unsuitable(simple, part, sizes)]] = True
    if core is not None:
        heavy[part[core]] = True
    return _arranged(simple, graph, part, np.concatenate([[0], np.cumsum(sizes)]), heavy, most_stages)


def _unsuitable(problem: ProblemData, part: Any, sizes: Any) -> Mask:
    """The rows that `Blocks.forward` does not solve: those alone without one answer, and moving ψ inside a block."""
    psi = problem.psi
    alone = sizes[part] == 1
    wrong: Mask = alone & ~(problem.A.diagonal() > 0)
    if psi.upper is not None:
        if psi.upper.linear is None or psi.linear is None:
            return np.ones(problem.n, dtype=bool)
        wrong |= ~alone | ~(psi.upper.linear[0].diagonal() < 1)
    if psi.linear is not None:
        G = psi.linear[0]
        i = row_of(G)
        j = G.indices
        wrong |= alone & ~(G.diagonal() < 1)
        wrong[i[~alone[i] & (part[i] == part[j])]] = True
    elif psi.links is not None:
        wrong |= np.diff(psi.links.indptr) > 0
        wrong[psi.links.indices] = True
    return wrong


def _arranged(
    simple: ProblemData, graph: sp.csr_array, part: Any, starts: Rows, heavy: Mask, most_stages: int
) -> Blocks:
    """The blocks by what they need of the `heavy` ones."""
    from scipy.sparse.csgraph import connected_components

    rows = np.argsort(part, kind="stable")
    everything = np.ones(simple.n, dtype=bool)
    if not heavy.any():
        return Blocks(simple, everything, rows, starts, ~heavy, heavy, ())
    from ..numerics.kernels.graph import stages  # loads numba

    depth, needed = stages(graph.indptr, graph.indices, part, rows, starts, heavy)
    last = int(depth.max())
    inner = (depth > 0) & needed
    before = depth == 0
    many = last > most_stages or PIVOT_UP_TO * max(last - _PARTS, 0) > np.count_nonzero(heavy[part])
    # where rows are dominant nothing grows along the chain, and one method for all costs less; and jumps must not leave
    # their part
    dominant = simple.matrix.is_dominant and simple.matrix.has_positive_diagonal
    if many or dominant or simple.psi.linear is None:
        depth = inner.astype(np.int64)
        last = 1
        heavy = inner
    of = np.where(heavy, depth, 0)[part]
    i = row_of(graph)
    j = graph.indices
    inside = (of[i] == of[j]) & (of[i] > 0)
    links = sp.csr_array((np.ones(np.count_nonzero(inside)), (i[inside], j[inside])), shape=graph.shape)
    label = connected_components(links, connection="weak")[1]
    order = np.lexsort((np.arange(simple.n), label, of))
    order = order[of[order] > 0]
    found = tuple(_parts(stage, label) for stage in np.split(order, np.flatnonzero(np.diff(of[order])) + 1))
    between = tuple(inner & ~heavy & (depth == stage) for stage in range(1, last)) if last > 1 else ()
    return Blocks(simple, everything, rows, starts, before, ~before & ~needed, found, between)


def _parts(rows: Rows, label: Any) -> tuple[Rows, ...]:
    """The `rows` of one stage, sorted by the `label` of their part; in one where there are many."""
    parts = np.split(rows, np.flatnonzero(np.diff(label[rows])) + 1)
    return tuple(parts) if len(parts) <= _PARTS else (np.sort(rows),)
