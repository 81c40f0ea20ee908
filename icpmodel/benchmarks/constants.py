"""The constants of `numerics.work`, measured again: what an entry, a row, a multiplication cost on this machine."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
import scipy.sparse as sp

from ..algebra.active_equations import Elimination
from ..algebra.hierarchy import Hierarchy
from ..icp import ICP
from ..methods.contract import Method
from ..methods.newton import Newton
from ..methods.psor import PSOR
from ..methods.shortcuts import Lemke
from ..numerics import work
from ..numerics.arrays import as_number
from ..numerics.factorisation import SymmetricPattern, factorise
from ..numerics.fill import Look, ordered
from ..numerics.multigrid import KrylovMultigrid, krylov_cost
from ..numerics.threads import one_blas_thread
from ..present.table import Table
from ..study.timing import as_repeats, machine
from .families.graphs import expander

#: name of a constant ↦ how many units of it are in a task
_Units = dict[str, float]
#: factorisations with more multiplications take seconds, and so does much with more rows but a sweep or a product
_LARGEST, _ROWS = 3e9, 100_000
#: full matrices have so many rows at the most, and graphs without geometry
_FULL, _TANGLED = 1_000, 4_000


def constants(sizes: Sequence[int] = (100, 1_000, 10_000, 100_000, 1_000_000), repeats: int = 9) -> Table:
    """The constants that estimates of cost use, in the table and as measured now, in nanoseconds per unit.

    Each is fitted to the times of tasks on grids in one to three dimensions, on random trees and graphs and on random
    dense matrices, relative errors by least squares; a time is the least of all `repeats`, the one that a busy machine
    disturbs least. Beyond 100 000 unknowns only sweeps, products and operations on vectors are timed; dense matrices
    have up to 1 000 rows, and 300 where they are pivoted.
    Parameters: `sizes` unknowns (the nearest squares and cubes); `repeats` of a task, ≥ 3. Returns a `Table`.

    >>> icp.benchmarks.constants([100], repeats=3).heads
    ('constant', 'in the table, ns', 'measured now, ns', 'ratio')
    """
    repeats = as_repeats(repeats)
    sizes = [int(as_number(n, "sizes", least=8, whole=True)) for n in sizes]
    known = work.COSTS._asdict()
    found: dict[str, float] = {}
    for tasks in (_passes, _sparse, _dense, _multigrid, _runs):
        found |= _fitted([(units, _nanoseconds(task, repeats)) for units, task in tasks(sizes)])
    rows = tuple((name, known[name], value, value / known[name]) for name, value in sorted(found.items()))
    heads = ("constant", "in the table, ns", "measured now, ns", "ratio")
    return Table(f"Constants of the estimates ({machine()})", heads, rows)


def _nanoseconds(task: Callable[[], object], repeats: int) -> float:
    task()  # compiles
    taken = []
    for _ in range(repeats):
        start = time.perf_counter_ns()
        task()
        taken.append(time.perf_counter_ns() - start)
    return float(min(taken))


def _fitted(timed: list[tuple[_Units, float]]) -> dict[str, float]:
    """The constants ≥ 0 for which Σ units·constant is the time of each task, with the least relative errors."""
    from scipy.optimize import nnls

    names = sorted({name for units, _ in timed for name in units})
    shares = np.array([[units.get(name, 0.0) / taken for name in names] for units, taken in timed])
    size = shares.max(axis=0)
    return dict(zip(names, (nnls(shares / size, np.ones(len(timed)))[0] / size).tolist(), strict=True))


def _matrices(sizes: Sequence[int]) -> Iterator[sp.csr_array]:
    """Laplacians on a square, on a cube and on a random tree, each shifted by 1e-2."""
    random = np.random.default_rng(0)
    for n in sizes:
        for power in (2, 3):
            m = max(round(n ** (1 / power)), 2)
            line, grid = _line(m, 2.0), sp.csr_array((1, 1))
            for _ in range(power):
                grid = sp.kron(grid, sp.eye_array(m)) + sp.kron(sp.eye_array(grid.shape[0]), line)
            yield sp.csr_array(grid + 0.01 * sp.eye_array(grid.shape[0]))
        child = np.arange(1, n)
        half = sp.csr_array((-np.ones(n - 1), (child, (random.random(n - 1) * child).astype(int))), shape=(n, n))
        tree = half + half.T
        yield sp.csr_array(tree + sp.diags_array(0.01 - tree.sum(axis=1)))


def _passes(sizes: Sequence[int]) -> Iterator[tuple[_Units, Callable[[], object]]]:
    # the squares have fuller rows
    for A in (power for grid in _matrices(sizes) for power in (grid, sp.csr_array(grid @ grid))):
        n, z = A.shape[0], np.ones(A.shape[0])
        problem = ICP(A, -z)
        step = PSOR(omega=1.0).step_of(problem)
        yield {"call": 1, "row": n, "entry": A.nnz}, partial(A.__matmul__, z)
        yield {"call": 1, "sweep_row": n, "sweep_entry": A.nnz}, partial(step, z)
        if A.shape[0] <= _ROWS:
            yield {"sparse_flop": float(np.diff(A.indptr)[A.indices].sum())}, partial(A.__matmul__, A)
            yield {"built": 1, "built_entry": A.nnz}, partial(A.__add__, A)
        yield {"vector": n}, partial(np.minimum, z, z, out=np.empty(n))


def _sparse(sizes: Sequence[int]) -> Iterator[tuple[_Units, Callable[[], object]]]:
    # factors of graphs without geometry take many multiplications for each of their entries
    tangled = sorted({min(n, _TANGLED // k) for n in sizes for k in (1, 2, 4)})
    expanders = (expander(n, np.random.default_rng(0))[0] for n in tangled)
    for A in (*_matrices([n for n in sizes if n <= _ROWS]), *expanders):
        before, n, f = work.done(), A.shape[0], np.ones(A.shape[0])
        fill, _ = seen = ordered(A, np.inf)
        looks = (work.done() - before - work.COSTS.call) / work.COSTS.look
        yield {"look": looks}, partial(ordered, A, np.inf)
        if fill.flops <= _LARGEST:
            made = partial(factorise, A, triangles=True)
            lu = made()
            yield {"factor_row": n, "factor_entry": fill.entries, "factor_flop": fill.flops}, made
            yield {"solve_entry": fill.entries}, partial(lu.solve, f)
            pattern = SymmetricPattern(A, seen)
            symmetric = pattern.factors(A.data)
            assert symmetric is not None  # they are definite
            counts = {"symmetric_entry": fill.entries, "symmetric_flop": fill.flops}
            yield {"call": 1, **counts}, partial(pattern.factors, A.data)
            yield {"call": 1, "symmetric_row": n, **counts}, partial(_of_symmetric, A)
            yield {"solve_entry": fill.entries}, partial(symmetric.solve, f)
    for n in sorted({min(n, _ROWS) for n in sizes}):
        yield from _bands(n)


def _of_symmetric(A: sp.csr_array) -> None:
    SymmetricPattern(A, ordered(A, np.inf)).factors(A.data)


def _bands(n: int) -> Iterator[tuple[_Units, Callable[[], object]]]:
    for b in (width for width in (1, 8, 64, 512) if width < n):
        for above in (b, b // 2):  # symmetric, and not
            offsets = range(-b, above + 1)
            diagonals = [2.0 * b + 1.0 if k == 0 else -1.0 for k in offsets]
            band = sp.csr_array(sp.diags_array(diagonals, offsets=offsets, shape=(n, n)))
            look = Look(band)
            if look.is_band and look.band.flops <= _LARGEST:
                units = {"band": 1, "band_entry": look.band.entries, "band_flop": look.band.flops}
                yield units, partial(factorise, band, look=look)


def _dense(sizes: Sequence[int]) -> Iterator[tuple[_Units, Callable[[], object]]]:
    random = np.random.default_rng(0)
    for n in sorted({min(n, most) for n in sizes for most in (30, 100, 300, _FULL)}):
        B = random.normal(size=(n, n))
        A = sp.csr_array(B @ B.T + np.eye(n))
        yield {"dense_entry": n**2, "dense_flop": n**3 / 3.0}, partial(_factorised, A)
        problem = ICP(A, random.normal(size=n))
        for task in (problem.matrix.product, PSOR().step_of(problem)):
            yield {"full_entry": n**2, "call": 1}, partial(task, problem.q)
        if n <= 300:
            before = work.done()
            pivoted = partial(_ends, Lemke(), problem)
            pivoted()
            pivots = (work.done() - before) / (work.COSTS.pivot_entry * n**2)
            yield {"pivot_entry": pivots * n**2}, pivoted


def _factorised(A: sp.csr_array) -> None:
    from scipy.linalg import lu_factor

    with one_blas_thread():
        lu_factor(A.toarray(), check_finite=False)


def _ends(method: Method, problem: ICP) -> None:
    for _ in method.iterates(problem, np.zeros(problem.n)):
        pass


def _hierarchy(A: sp.csr_array, f: np.ndarray) -> Hierarchy:
    return Hierarchy(ICP(A, f))  # of a matrix that is new, whose levels are not there


def _multigrid(sizes: Sequence[int]) -> Iterator[tuple[_Units, Callable[[], object]]]:
    for k, A in enumerate(_matrices([n for n in sizes if n <= _ROWS])):
        if k % 3 == 2:  # no grid
            continue
        f = np.sin(np.arange(A.shape[0]))
        problem = ICP(A, f)
        hierarchy, krylov = Hierarchy(problem), KrylovMultigrid(A)
        yield {"hierarchy": 1, "hierarchy_entry": A.nnz}, partial(_hierarchy, A, f)
        yield {"cycle": 1, "cycle_entry": A.nnz}, partial(hierarchy.cycle, f)
        before = work.done()
        krylov.solve(f, 1e-8)
        steps = (work.done() - before) / krylov_cost(A.nnz, 1, hierarchy=False)
        yield {"krylov": steps, "krylov_entry": steps * A.nnz}, partial(krylov.solve, f, 1e-8)


def _runs(sizes: Sequence[int]) -> Iterator[tuple[_Units, Callable[[], object]]]:
    """Iterates whose sweeps cost next to nothing, and Newton's steps whose linear systems do: tridiagonal ones, and
    those of full matrices of which few rows leave the obstacle; and equations that are made of A and ψ′."""
    few = ICP(_line(16, 2.0), -np.ones(16))
    run = partial(few.solve, PSOR(omega=1.0), rtol=0.0, max_iter=300, raise_on_failure=False)
    yield {"iterate": run().iterations}, run
    random = np.random.default_rng(0)
    problems = [ICP(_line(n, 2.5), random.normal(size=n)) for n in sizes if n <= _ROWS]
    for n in sorted({min(n, _FULL) for n in sizes}):
        q = np.where(np.arange(n) % (n // 4) == 0, -1.0, 1.0)
        problems.append(ICP(random.random((n, n)) + n * np.eye(n), q))
    for problem in problems:
        steps = sum(1 for _ in Newton().iterates(problem, np.zeros(problem.n))) - 1
        units = {"newton": 1.0, "newton_row": problem.n, "newton_entry": problem.nnz}
        yield {name: steps * count for name, count in units.items()}, partial(_ends, Newton(), problem)
        mixed = partial(Elimination, problem, np.arange(problem.n) % 2 == 0, sp.csr_array(0.1 * problem.A))
        yield {"mixed": 1, "mixed_entry": 2 * problem.nnz}, mixed


def _line(n: int, diagonal: float) -> sp.csr_array:
    return sp.csr_array(sp.diags_array([-1.0, diagonal, -1.0], offsets=[-1, 0, 1], shape=(n, n)))
