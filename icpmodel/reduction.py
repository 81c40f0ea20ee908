"""Model no more than the scene needs: problems that are smaller or simpler, and have the same solutions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .arrays import Vector, row_of
from .errors import MapError
from .intervention import Intervention
from .maps import Affine, Constant, Elementwise, Map
from .problem import ICP, SMALLEST, UNIT_ROUNDOFF

#: evaluations of ψ at the most; with a derivative five are the rule
_EVALUATIONS = 100
#: a block of at most so many rows is pivoted
PIVOT_UP_TO = 64
#: so many parts that do not interact get a method each
_PARTS = 32
#: up to so many stages are solved in turn; above `_PARTS`, where their blocks are large
_STAGES = 1000

Rows = NDArray[np.intp]
Mask = NDArray[np.bool_]


def has_fixed_obstacle(problem: ICP) -> bool:
    """Whether every ψ_i is known to move with its own z_i alone, and by less than it: `with_fixed_obstacle` applies.

    >>> from icpmodel import Affine
    >>> has_fixed_obstacle(ICP([[2.0]], [1.0], Affine([[0.5]]))), has_fixed_obstacle(ICP([[2.0]], [1.0], np.sin))
    (True, False)
    """
    G = problem.psi.lipschitz
    if problem.is_lcp or G is None:
        return problem.is_lcp

    def look() -> bool:
        slope = G.diagonal()
        return bool(np.count_nonzero(G.data) == np.count_nonzero(slope) and (slope < 1).all())

    found: bool = problem.remembered("fixed obstacle", look)
    return found


def with_fixed_obstacle(problem: ICP) -> ICP:
    """The LCP with the same solutions, where `has_fixed_obstacle`.

    r_i(z) = z_i − ψ_i(z_i) then grows with z_i, so that r_i ≥ 0 says z_i ≥ c_i with r_i(c_i) = 0: a fixed obstacle. The
    n equations are solved at once by Newton's method, kept in the bracket that the Lipschitz constant ℓ_i < 1 gives,
    −r/(1 − ℓ) ≤ c − z ≤ −r/(1 + ℓ) for r > 0, and by halving it where ψ has no derivative.

    Returns the problem itself where ψ is constant. Raises MapError where ψ fails.

    >>> from icpmodel import Elementwise
    >>> with_fixed_obstacle(ICP([[2.0]], [1.0], Elementwise(lambda z: 0.5 * z + 1.0, lipschitz=0.5))).psi
    Constant(2)
    """
    if isinstance(problem.psi, Constant):
        return problem
    G = problem.psi.lipschitz
    assert G is not None, "ask has_fixed_obstacle first"
    return problem.with_psi(_roots(problem.psi, G.diagonal()))


def _roots(psi: Map, slope: Vector) -> Vector:
    """c with c_i = ψ_i(c_i), to rounding or until nothing moves; −inf where ψ_i is."""
    from .kernels.roots import improve, settled  # loads numba

    c, value, nothing = np.zeros(slope.size), psi.value(np.zeros(slope.size)), np.zeros(0)
    low, high = np.full(c.size, -np.inf), np.full(c.size, np.inf)
    for _ in range(_EVALUATIONS):
        if settled(c, value, 2 * UNIT_ROUNDOFF):
            break
        own, following = _own_slopes(psi, c), np.empty(c.size)
        if not improve(c, value, slope, nothing if own is None else own, low, high, following):
            break
        c = following
        value = psi.value(c)
    c = np.where(np.isneginf(value), -np.inf, c)
    if not (c < np.inf).all():  # nor NaN
        i = int(np.argmin(c < np.inf))
        raise MapError(f"psi_{i} leads to {c[i]} where z_{i} = psi_{i}(z_{i}) is sought; a finite number was expected")
    return c


def _own_slopes(psi: Map, z: Vector) -> Vector | None:
    """∂ψ_i/∂z_i, None where it is not known."""
    if isinstance(psi, Elementwise):  # without the matrix, which costs more than its entries
        return psi.slopes(z)
    J = psi.jacobian(z)
    return None if J is None else J.diagonal()


def restricted(problem: ICP, rows: Rows, z: Vector) -> ICP:
    """The ICP in the unknowns `rows` alone, ascending, where all others are what they are in `z`, shape (n,).

    ψ must be constant, affine, or a best jump that neither leaves nor enters those rows.

    >>> part = restricted(ICP([[2.0, -1.0], [-1.0, 2.0]], [-1.0, 3.0]), np.array([0]), np.array([9.0, 4.0]))
    >>> part.A.toarray(), part.q
    (array([[2.]]), array([-5.]))
    """
    from .kernels.parts import cut  # loads numba

    A, psi = problem.A, problem.psi
    starts, columns, values, q = cut(A.indptr, A.indices, A.data, problem.q, rows, z)
    inside: Any
    if isinstance(psi, Constant):
        inside = psi.c[rows]
    elif isinstance(psi, Affine):
        G, known = psi.G[rows], z.copy()
        known[rows] = 0.0
        inside = Affine(G[:, rows], G @ known + psi.c[rows])
    else:
        assert isinstance(psi, Intervention)
        assert psi.jumps is not None
        inside = Intervention(psi.jumps[rows][:, rows], psi.best)
    return ICP._made(sp.csr_array((values, columns, starts), shape=(rows.size, rows.size)), q, inside)


@dataclass(frozen=True, eq=False, repr=False)
class Blocks:
    """The `open` rows of `problem` in blocks that hang on earlier ones only: the strong components of A and ψ.

    Block k is `rows[starts[k] : starts[k + 1]]`. The blocks in `before` are so small that they are solved one after the
    other, those in `after` as well, once the rest is known. The rest comes in `stages`, each of which hangs on earlier
    ones only and has the rows of its parts, which do not interact (all in one where they are many); the small blocks
    `between` two stages, a mask for each stage, come after it. Rows that are not open rest on the fixed obstacle, see
    `without`; `opened` is how often some of them had to be opened, `radius` the estimated Jacobi radius of what was
    open before, `certain` whether it is proved that they rest there.

    >>> chain = blocks(ICP([[1.0, 0.0], [-1.0, 1.0]], [-1.0, -1.0]))
    >>> chain.rows, chain.core, chain.forward(np.zeros(2), chain.before)
    (array([0, 1]), 0, (array([1., 2.]), array([ True,  True])))
    """

    problem: ICP
    open: Mask
    rows: Rows
    starts: Rows
    before: Mask
    after: Mask
    stages: tuple[tuple[Rows, ...], ...]
    between: tuple[Mask, ...] = ()
    opened: int = 0
    radius: float | None = None
    certain: bool = False

    def __repr__(self) -> str:
        n, sizes, small = self.problem.n, np.diff(self.starts), self.before | self.after
        for blocks_between in self.between:
            small = small | blocks_between
        rest, one_by_one = n - np.count_nonzero(self.open), int(small[sizes == 1].sum())
        pivoted, blocks = int(sizes[small].sum()) - one_by_one, int(small.sum()) - one_by_one
        told = {
            f"{rest} {'are certain to touch' if self.certain else 'rest on'} the obstacle": rest,
            f"others had to be opened ({self.opened} x)": self.opened,
            f"{one_by_one} follow one by one": one_by_one,
            f"{pivoted} in {blocks} small blocks are pivoted": pivoted,
            f"{len(self.parts)} parts do not interact": len(self.parts) > len(self.stages) == 1,
            f"{len(self.parts)} parts in {len(self.stages)} stages follow one another": len(self.stages) > 1,
        }
        return f"n = {n} -> {self.core} rows still open: {', '.join(text for text, holds in told.items() if holds)}"

    @property
    def parts(self) -> tuple[Rows, ...]:
        """The rows of the parts of all stages.

        >>> without(ICP(np.eye(2), [-1.0, 1.0]), np.array([True, False])).parts
        (array([0]),)
        """
        return tuple(part for stage in self.stages for part in stage)

    @property
    def core(self) -> int:
        """How many rows are left once blocks and rows at the obstacle are gone.

        >>> blocks(ICP([[1.0, 0.0], [-1.0, 1.0]], [-1.0, -1.0])).core
        0
        """
        return sum(part.size for part in self.parts)

    def with_core(self, unsolved: Mask) -> Blocks | None:
        """The blocks once the `unsolved` ones, which `forward` cannot do, belong to the core as well.

        >>> chain = blocks(ICP([[1.0, 0.0], [-1.0, 1.0]], [-1.0, -1.0]))
        >>> chain.with_core(np.array([True, False]))
        n = 2 -> 1 rows still open: 1 follow one by one
        """
        core = np.zeros(self.problem.n, dtype=bool)
        core[self.rows[np.repeat(unsolved, np.diff(self.starts))]] = True
        core[np.concatenate([*self.parts, self.rows[:0]])] = True
        return blocks(self.problem, core)

    def forward(self, z: Vector, wanted: Mask) -> tuple[Vector, Mask]:
        """`z` with the `wanted` blocks solved in turn, and which of them are solved, as far as the kernel knows.

        Reference: Cottle, Pang and Stone, The Linear Complementarity Problem (1992), section 4.4, for the blocks.

        >>> chain = blocks(ICP([[1.0, 0.0], [-1.0, 1.0]], [-1.0, -1.0]))
        >>> chain.forward(np.zeros(2), np.array([True, False]))
        (array([1., 0.]), array([ True, False]))
        """
        if not wanted.any():
            return z, wanted
        from .kernels.pivoting import apart  # loads numba

        A, psi, z = self.problem.A, self.problem.psi, z.copy()
        c = getattr(psi, "c", np.full(z.size, -np.inf))  # rows of a best jump are never in a block
        G = psi.G if isinstance(psi, Affine) else sp.csr_array(A.shape)
        slopes = (G.indptr, G.indices, G.data)
        return z, apart(A.indptr, A.indices, A.data, self.problem.q, c, slopes, self.rows, self.starts, wanted, z)


def without(problem: ICP, open_rows: Mask) -> Blocks:
    """The `open_rows` of `problem`, a mask of shape (n,), as one part, where the others rest on a fixed obstacle.

    >>> without(ICP(np.eye(3), [-1.0, 1.0, 2.0]), np.array([True, False, False]))
    n = 3 -> 1 rows still open: 2 rest on the obstacle
    """
    nothing, rows = np.zeros(0, dtype=bool), np.flatnonzero(open_rows)
    return Blocks(problem, open_rows, rows[:0], np.zeros(1, dtype=np.intp), nothing, nothing, ((rows,),))


def certain_rows(problem: ICP, z: Vector) -> Mask:
    """The rows that are proved to touch the obstacle, z*_i = c_i, by what p and r are at `z`, shape (n,); ψ = c.

    With ⟨A⟩v > 0 and e = max_i |min(p_i/(⟨A⟩v)_i, r_i/v_i)|, |z − z*| ≤ ev, so that p_i(z) > e(|A|v)_i proves
    p_i(z*) > 0. v is that of the proof that A is an H₊-matrix where it was asked for before, else 1: then the rows of A
    must be strictly dominant. Bounds on the rounding errors are included. One pass over A; no row where it fails.
    Reference: `icpmodel.theory.certificates`: `h_plus` for the bound, `active_set` for the rows.

    >>> certain_rows(ICP([[2.0, -1.0], [-1.0, 2.0]], [-1.0, 3.0]), np.array([0.5, 0.0]))
    array([False,  True])
    """
    from .kernels.parts import certain  # loads numba

    A, v = problem.A, getattr(problem._memory.get("h plus"), "v", None)
    assert isinstance(problem.psi, Constant), "ask is_lcp first"
    v = np.ones(problem.n) if v is None else v
    found: Mask = certain(A.indptr, A.indices, A.data, problem.q, problem.psi.c, v, z, UNIT_ROUNDOFF, SMALLEST)
    return found


def blocks(problem: ICP, core: Mask | None = None) -> Blocks | None:
    """The blocks of `problem`, None where all rows are one, or where it is not known on which unknowns ψ depends.

    Parameters: rows that are to be in the `core`, a mask of shape (n,), or None.
    Reference: Tarjan, SIAM J. Comput. 1 (1972), for strong components.

    >>> blocks(ICP([[2.0, -1.0], [-1.0, 2.0]], [-1.0, 3.0])).core, blocks(ICP([[1.0]], [1.0], np.sin))
    (0, None)
    """
    from scipy.sparse.csgraph import connected_components

    fixed = has_fixed_obstacle(problem)
    graph = problem.A if fixed else _dependencies(problem)
    if graph is None:
        return None
    from .kernels.parts import linked  # loads numba

    if problem.n > PIVOT_UP_TO and linked(graph.indptr, graph.indices):
        return None
    count, part = connected_components(graph, connection="strong")
    if count == 1 and problem.n > PIVOT_UP_TO:
        return None
    # SciPy numbers the components so that each hangs on those before it only
    simple = with_fixed_obstacle(problem) if fixed else problem
    sizes = np.bincount(part, minlength=count)
    heavy = sizes > PIVOT_UP_TO
    heavy[part[_unsuitable(simple, part, sizes)]] = True
    if core is not None:
        heavy[part[core]] = True
    return _arranged(simple, graph, part, np.concatenate([[0], np.cumsum(sizes)]), heavy)


def _dependencies(problem: ICP) -> sp.csr_array | None:
    """Where row i depends on unknown j, be it through A or ψ; None where that is not known, or not of use."""
    psi = problem.psi
    if not isinstance(psi, Affine | Intervention) or psi.lipschitz is None:
        return None
    return sp.csr_array(problem.absolute_A() + psi.lipschitz)


def _unsuitable(problem: ICP, part: Any, sizes: Any) -> Mask:
    """The rows that `Blocks.forward` does not solve: those alone without one answer, and moving ψ inside a block."""
    psi, alone = problem.psi, sizes[part] == 1
    wrong: Mask = alone & ~(problem.A.diagonal() > 0)
    if isinstance(psi, Affine):
        i, j = row_of(psi.G), psi.G.indices
        wrong |= alone & ~(psi.G.diagonal() < 1)
        wrong[i[~alone[i] & (part[i] == part[j])]] = True
    elif isinstance(psi, Intervention):
        assert psi.jumps is not None
        wrong |= np.diff(psi.jumps.indptr) > 0
        wrong[psi.jumps.indices] = True
    return wrong


def _arranged(simple: ICP, graph: sp.csr_array, part: Any, starts: Rows, heavy: Mask) -> Blocks:
    """The blocks by what they need of the `heavy` ones."""
    from scipy.sparse.csgraph import connected_components

    rows, everything = np.argsort(part, kind="stable"), np.ones(simple.n, dtype=bool)
    if not heavy.any():
        return Blocks(simple, everything, rows, starts, ~heavy, heavy, ())
    from .kernels.parts import stages  # loads numba

    depth, needed = stages(graph.indptr, graph.indices, part, rows, starts, heavy)
    last, inner, before = int(depth.max()), (depth > 0) & needed, depth == 0
    many = last > _STAGES or PIVOT_UP_TO * max(last - _PARTS, 0) > np.count_nonzero(heavy[part])
    # where rows are dominant nothing grows along the chain, and one method for all costs less; and jumps must not leave
    # their part
    dominant = (simple.absolute_A() @ np.ones(simple.n) <= 2.0 * simple.A.diagonal()).all()
    if many or dominant or isinstance(simple.psi, Intervention):
        depth, last, heavy = inner.astype(np.int64), 1, inner
    of = np.where(heavy, depth, 0)[part]
    i, j = row_of(graph), graph.indices
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
