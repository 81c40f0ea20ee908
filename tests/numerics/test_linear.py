"""The solver that fits a matrix: bands, borders, dense, sparse and large ones."""

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

import icpmodel as icp
from icpmodel.numerics import work
from icpmodel.numerics.arrays import is_symmetric
from icpmodel.numerics.factorisation import factorise
from icpmodel.numerics.fill import Look, ordered
from icpmodel.numerics.linear import solver_of


def band(n):
    return sp.diags_array([-np.ones(n - 1), 3.0 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1]).tocsr()


def bordered(n):
    A = band(n).tolil()
    A[n // 2, :] = 0.01
    A[n // 2, n // 2] = 5.0
    return sp.csr_array(A)


@pytest.mark.parametrize(
    "M",
    [
        band(50),
        bordered(300),
        np.random.default_rng(0).normal(size=(20, 20)),
        icp.scenes.membrane(n=900, skew=0.3).problem.A,
        icp.scenes.membrane(n=230**2).problem.A,
        icp.scenes.membrane(n=230**2, skew=0.3).problem.A,
    ],
    ids=["band", "border", "dense", "sparse", "multigrid", "multigrid, not symmetric"],
)
def test_the_solution_does_not_depend_on_the_units_of_the_rows(M):
    M = sp.csr_array(M)
    rng = np.random.default_rng(1)
    f, units = rng.normal(size=M.shape[0]), rng.integers(-300, 300, size=M.shape[0])
    scaled = sp.csr_array(sp.diags_array(np.ldexp(1.0, units)) @ M)
    for A, right in ((M, f), (scaled, np.ldexp(f, units))):
        assert np.allclose(M @ solver_of(A)(right, 1e-10), f, atol=1e-6)


def skewed(n):
    """A border and a band that are not symmetric."""
    A = sp.lil_array(sp.diags_array([-1.0, -2.0, 5.0, 0.5], offsets=[-2, -1, 0, 1], shape=(n, n)))
    A[[3, n // 2], :] = np.random.default_rng(5).normal(size=(2, n)) / n
    A[[3, n // 2], [3, n // 2]] = 5.0
    return sp.csr_array(A)


@pytest.mark.parametrize("wild", ["rows", "columns", "both"])
@pytest.mark.parametrize("kind", ["band", "tridiagonal", "border", "dense", "sparse", "multigrid", "skewed multigrid"])
def test_the_transposed_system_is_solved_whatever_the_units_of_rows_and_columns(kind, wild):
    """And ⟨w, M⁻¹d⟩ = ⟨M⁻ᵀw, d⟩: both are solved with the same factors, levels, or band."""
    rng, by_multigrid = np.random.default_rng(2), "multigrid" in kind
    M = {
        "band": sp.diags_array([-1.0, -2.0, 4.0, -0.5], offsets=[-5, -1, 0, 2], shape=(200, 200)),
        "tridiagonal": sp.diags_array([-1.0, 3.0, -0.5], offsets=[-1, 0, 1], shape=(200, 200)),
        "border": skewed(300),
        "dense": rng.normal(size=(20, 20)),
        "sparse": icp.scenes.bai_nonsymmetric(n=900).problem.A,
        "multigrid": icp.scenes.membrane(n=900).problem.A,
        "skewed multigrid": icp.scenes.membrane(n=900, skew=0.3).problem.A,
    }[kind]
    n = M.shape[0]
    rows, columns = (
        np.ldexp(1.0, rng.integers(-30, 30, n) if wild in (one, "both") else np.zeros(n, int))
        for one in ("rows", "columns")
    )
    scaled = sp.csr_array(sp.diags_array(rows) @ sp.csr_array(M) @ sp.diags_array(columns))
    x, y = rng.normal(size=(2, n))
    solve = solver_of(scaled, by_multigrid=by_multigrid)
    assert columns * solve(rows * (M @ x), 1e-12) == pytest.approx(x, abs=1e-8)
    assert rows * solve(columns * (M.T @ y), 1e-12, True) == pytest.approx(y, abs=1e-8)


@pytest.mark.parametrize(
    "M",
    [
        np.zeros((3, 3)),
        [[1.0, 1.0], [1.0, 1.0]],
        [[np.nan, 0.0], [0.0, 1.0]],
        sp.block_diag([band(40), np.zeros((2, 2))]),
        sp.block_diag([bordered(300), np.ones((2, 2))]),
    ],
)
def test_a_singular_matrix_has_no_solution(M):
    M = sp.csr_array(M)
    with np.errstate(all="ignore"):
        assert solver_of(M)(np.ones(M.shape[0]), 1e-8) is None
        assert solver_of(M)(np.ones(M.shape[0]), 1e-8, transposed=True) is None


def network(seed, n=3000):
    """BᵀB for the n arcs of a random network and some more, each row of B 1 and −1: only constants have BᵀBx = 0."""
    rng = np.random.default_rng(seed)
    arcs = np.arange(n + n // 5)
    ends = np.column_stack([arcs % n, rng.integers(0, n, arcs.size)])
    signs, rows = np.tile([1.0, -1.0], arcs.size), np.repeat(arcs, 2)
    B = sp.csr_array((signs, (rows, ends.ravel())), shape=(arcs.size, n))
    L = sp.csr_array(B.T @ B)
    L.eliminate_zeros()
    return L


@pytest.mark.parametrize("seed", range(5))
def test_a_singular_sparse_matrix_is_seen_to_be(seed):
    """Pivots that are exactly 0 and such as rounding has left of them."""
    L, rng = network(seed), np.random.default_rng(seed)
    f = rng.normal(size=L.shape[0])
    assert solver_of(L)(f, 1e-8) is None
    assert solver_of(L)(f, 1e-8, transposed=True) is None


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 100), st.floats(-9.0, 0.0))
def test_a_sparse_matrix_that_is_nearly_singular_is_solved_as_well_as_any(seed, size):
    """As exactly as rounding allows: what is added to the diagonal for the pivots is taken back."""
    L, rng = network(seed), np.random.default_rng(seed)
    M = sp.csr_array(L + 10.0**size * sp.eye_array(L.shape[0]))
    x = rng.normal(size=L.shape[0])
    found = solver_of(M)(M @ x, 1e-8)
    assert np.abs(found - x).max() <= 1e-15 * (5.0 + 0.5 / 10.0**size)
    assert np.abs(M @ found - M @ x).max() <= 1e-15 * (abs(M) @ np.abs(found) + np.abs(M @ x)).max()


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 100), st.floats(-7.0, 0.0))
def test_small_pivots_take_no_more_work_than_foreseen_and_no_digits(seed, size):
    """[δI, B; −Bᵀ, I] with the arcs of a grid in B: no rows are exchanged, which would fill it up."""
    rng, n, arcs = np.random.default_rng(seed), 1000, 2000
    start = rng.integers(0, n, arcs)
    ends = np.concatenate([start, (start + rng.choice([1, -1, 30, -30], arcs)) % n])
    B = sp.csr_array((np.repeat([1.0, -1.0], arcs), (np.tile(np.arange(arcs), 2), ends)), shape=(arcs, n))
    M = sp.csr_array(sp.block_array([[10.0**size * sp.eye_array(arcs), B], [-B.T, sp.eye_array(n)]]))
    f, before = rng.normal(size=M.shape[0]), work.done()
    x = solver_of(M)(f, 1e-8)
    assert work.done() - before <= 2.0 * work.factor_cost(ordered(M, np.inf)[0])
    assert np.abs(M @ x - f).max() <= 1e-15 * (abs(M) @ np.abs(x) + np.abs(f)).max()


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 100), st.sampled_from([0.0, 1e-18, 1e-12, 1e-9, 1e-3]), st.booleans())
def test_zeros_on_the_diagonal_take_no_more_work_than_foreseen_and_no_digits(seed, size, transposed):
    """[L + I, Cᵀ; −C, δI], as in optimality conditions: no rows are exchanged to bring C onto the diagonal."""
    L, rng = network(seed), np.random.default_rng(seed)
    n, m = L.shape[0], 500
    C = sp.random_array((m, n), density=6.0 / n, rng=rng)
    C = sp.csr_array(C + sp.eye_array(m, n))
    M = sp.csr_array(sp.block_array([[L + sp.eye_array(n), C.T], [-C, size * sp.eye_array(m) if size else None]]))
    f, before = rng.normal(size=n + m), work.done()
    x = solver_of(M)(f, 1e-8, transposed)
    whole = M.T if transposed else M
    assert work.done() - before <= 2.0 * work.factor_cost(ordered(M, np.inf)[0])
    assert np.abs(whole @ x - f).max() <= 1e-14 * (abs(whole) @ np.abs(x) + np.abs(f)).max()


@pytest.mark.parametrize("shift", [0.0, 0.7])
@pytest.mark.parametrize("transposed", [False, True])
def test_symmetric_systems_that_are_not_definite_are_factorised_without_exchanges_all_the_same(shift, transposed):
    """[[L, C′], [C, −δI]], δ = 0 for one, and L less a multiple of the identity for the other: one factorisation."""
    L, rng = network(3), np.random.default_rng(3)
    n, m = L.shape[0], 400
    C = sp.csr_array(sp.random_array((m, n), density=4.0 / n, rng=rng) + sp.eye_array(m, n))
    M = sp.csr_array(L - shift * sp.eye_array(n))
    if not shift:
        M = sp.csr_array(sp.block_array([[M + sp.eye_array(n), C.T], [C, None]]))
    f, before = rng.normal(size=M.shape[0]), work.done()
    x = solver_of(M)(f, 1e-8, transposed)
    assert work.done() - before <= 2.0 * work.factor_cost(ordered(M, np.inf, symmetric=True)[0])
    assert np.abs(M @ x - f).max() <= 1e-13 * (abs(M) @ np.abs(x) + np.abs(f)).max()


@pytest.mark.parametrize("size", [1e-250, 1e-180, 1e180, 1e250])
def test_right_hand_sides_whose_squares_are_no_floats_are_solved(size):
    M, rng = sp.csr_array(network(0) + sp.eye_array(3000)), np.random.default_rng(0)
    x = size * rng.normal(size=M.shape[0])
    assert solver_of(M)(M @ x, 1e-8) == pytest.approx(x, rel=1e-9, abs=1e-9 * size)


def test_no_equations_have_the_empty_solution():
    assert solver_of(sp.csr_array((0, 0)))(np.zeros(0), 1e-8).size == 0


def test_what_multigrid_cannot_do_is_factorised():
    """No Krylov method gets to a residual of 0, and positive entries off the diagonal are not given to it."""
    M = icp.scenes.membrane(n=900).problem.A
    f = np.sin(np.arange(900.0))
    for matrix in (M, abs(M)):
        x = solver_of(sp.csr_array(matrix), by_multigrid=True)(f, 0.0)
        assert np.linalg.norm(matrix @ x - f) <= 1e-9 * np.linalg.norm(f)


@pytest.mark.parametrize("within", [0.0, 1e-14, 1.0])
@pytest.mark.parametrize("rows", [1, 3, 16, 17])
def test_a_band_with_a_few_full_rows_is_solved(rows, within):
    """Up to 16 of them by Woodbury's formula, unless the band alone is singular or nearly; else as a sparse matrix."""
    n, rng = 3000, np.random.default_rng(rows)
    M = sp.lil_array(sp.diags_array([-1.0, 2.5, -1.0], offsets=[-1, 0, 1], shape=(n, n)))
    for i in 100 + 150 * np.arange(rows):
        M[i, [i - 1, i, i + 1]] = within, -2.5 * within, within
        M[i, i + (n // 10 if within == 1.0 else 10)] = 1.5
    M = sp.csr_array(M)
    M.eliminate_zeros()
    f = rng.normal(size=n)
    solve = solver_of(M)
    assert M @ solve(f, 1e-12) == pytest.approx(f, abs=1e-10)
    assert M.T @ solve(f, 1e-12, transposed=True) == pytest.approx(f, abs=1e-10)


@pytest.mark.parametrize("kind", ["band", "dense", "sparse", "multigrid", "multigrid, rows in units"])
def test_only_multigrid_stops_at_the_tolerance(kind):
    rng, n = np.random.default_rng(11), 900
    f = rng.normal(size=n)
    M = {
        "band": sp.diags_array([-1.0, -2.0, 4.0, -0.5], offsets=[-5, -1, 0, 2], shape=(n, n)),
        "dense": rng.normal(size=(n, n)),
        "sparse": icp.scenes.bai_nonsymmetric(n=n).problem.A,
        "multigrid": icp.scenes.membrane(n=n).problem.A,
        "multigrid, rows in units": icp.scenes.bai_nonsymmetric(n=n).problem.A,
    }[kind]
    units = 10.0 ** rng.integers(-9, 9, n) if kind == "multigrid, rows in units" else np.ones(n)
    M, f = sp.csr_array(sp.diags_array(units) @ M), units * f

    def is_solution(x):
        return bool(np.linalg.norm((M @ x - f) / units) <= 1e-9 * np.linalg.norm(f / units))

    solve = solver_of(M, by_multigrid=True) if kind.startswith("multigrid") else solver_of(M)
    assert is_solution(solve(f, 1e-10))
    assert is_solution(solve(f, 1e-2)) is not kind.startswith("multigrid")


def test_what_was_seen_of_the_fill_is_not_looked_for_again():
    """Neither where another limit is asked about nor where the matrix is factorised, in the same order."""
    order = np.random.default_rng(6).permutation(900)  # no band
    M = sp.csr_array(icp.scenes.membrane(n=900).problem.A[order][:, order])
    look, counts, factors = Look(M), [], []
    cost = work.factor_cost(ordered(M, np.inf)[0])
    assert look.costs_more(0.9 * cost)
    assert not look.costs_more(1.1 * cost)
    for known in (None, look):
        before = work.done()
        assert known is None or look.costs_more(0.9 * cost)
        factors.append(factorise(M, look=known))
        counts.append(work.done() - before)
    assert (factors[0].L != factors[1].L).nnz == 0
    assert counts[0] - counts[1] > work.COSTS.look * M.nnz


@pytest.mark.parametrize("form", [sp.csr_array, sp.csc_array, sp.coo_array])
def test_symmetry_is_seen_entry_by_entry_whatever_is_stored(form):
    """Zeros that are stored, and rows that are not sorted, are no asymmetry."""
    M = np.array([[2.0, 1.0, 0.0], [1.0, 2.0, 3.0], [0.0, 3.0, 2.0]])
    stored = sp.csr_array((np.array([0.0, 1.0, 2.0]), np.array([2, 1, 0]), np.array([0, 3, 3, 3])), shape=(3, 3))
    assert is_symmetric(form(M))
    assert not is_symmetric(form(M + np.eye(3, k=1)))
    assert not is_symmetric(form(np.triu(M)))
    assert is_symmetric(form(stored + sp.csr_array(M.T) - stored))
    assert not is_symmetric(stored)
    stored.data[1] = 0.0
    assert is_symmetric(stored)


def laplacian(m, power):
    line, M = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(m, m)), sp.csr_array((1, 1))
    for _ in range(power):
        M = sp.kron(M, sp.eye_array(m)) + sp.kron(sp.eye_array(M.shape[0]), line)
    return sp.csr_array(M)


def random_tree(n):
    child = np.arange(1, n)
    half = sp.csr_array(
        (-np.ones(n - 1), (child, (np.random.default_rng(0).random(n - 1) * child).astype(int))), (n, n)
    )
    return sp.csr_array(half + half.T + sp.diags_array(0.1 - (half + half.T).sum(axis=1)))


@pytest.mark.parametrize(
    ("M", "by_multigrid"),
    [(laplacian(25, 3), True), (laplacian(76, 2), False), (random_tree(30_000), False), (-laplacian(12, 3), False)],
    ids=["space", "plane", "tree", "not an M-matrix"],
)
def test_what_is_foreseen_to_cost_more_to_factorise_goes_to_multigrid(M, by_multigrid):
    """Not what is large: a small grid in space fills up, a large tree does not. Only multigrid minds the tolerance."""
    f = np.random.default_rng(1).normal(size=M.shape[0])
    before = work.done()
    x = solver_of(M)(f, 1e-2)
    counted, factors = work.done() - before, work.factor_cost(Look(M).fill)
    assert bool(np.linalg.norm(M @ x - f) > 1e-9 * np.linalg.norm(f)) is by_multigrid
    assert (counted < factors) is by_multigrid
