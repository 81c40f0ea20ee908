"""`solve_avi`, `solve_lsq`, `solve_nnls`: known answers, bounds that hold, and what SciPy says."""

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from hypothesis import given
from known_answers import GENERATORS, SEEDS
from scipy.optimize import linprog, lsq_linear, nnls

import icpmodel as icp


def planted(seed):
    """A monotone inequality with a known solution: rows, equations, bounds, degenerate or not."""
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(2, 8)), int(rng.integers(1, 8))
    B, S = rng.normal(size=(n, n)), rng.normal(size=(n, n))
    H = B @ B.T + 0.5 * np.eye(n) + S - S.T
    x = rng.integers(-2, 3, n).astype(float)
    G, A = rng.normal(size=(m, n)), rng.normal(size=(1, n))
    tight = rng.random(m) < min(0.5, (n - 2) / m)
    multiplier, nu = np.where(tight, rng.random(m), 0.0), rng.normal(size=1)
    at_low = rng.random(n) < 0.2
    box = -np.where(at_low, rng.random(n), 0.0)
    g = -(H @ x + G.T @ multiplier + A.T @ nu + box)
    low = np.where(at_low, x, x - 1.0)
    return (H, g, G, G @ x + np.where(tight, 0.0, rng.random(m)), A, A @ x, low, x + 2.0), x


@given(SEEDS)
def test_the_solution_of_a_monotone_inequality_is_within_its_bound(seed):
    data, x = planted(seed)
    found = icp.solve_avi(*data)
    assert found.x == pytest.approx(x, abs=1e-6)
    assert found.violation <= 1e-9
    assert np.isnan(found.objective)
    bound = found.error_bound
    if bound.value is not None:  # the planted x is rounded as well
        assert bound.unique
        assert (np.abs(found.x - x) <= bound.componentwise + 1e-9).all()


def test_symmetric_inequalities_are_quadratic_programs_and_others_are_checked():
    P, q, rows = [[2.0, 1.0], [1.0, 2.0]], [-4.0, 1.0], {"G": [[1.0, 1.0]], "h": [1.0], "lb": 0}
    game, program = icp.solve_avi(P, q, **rows), icp.solve_qp(P, q, **rows)
    assert game.x == pytest.approx(program.x)
    assert game.objective == pytest.approx(program.objective)
    assert program.error_bound.value < 1e-9
    assert icp.solve_avi([[1.0, 2.0], [-2.0, 1.0]], q, **rows).crosscheck(["osqp"]).agrees
    with pytest.raises(icp.InputError, match="solve_avi"):
        icp.solve_qp([[1.0, 2.0], [-2.0, 1.0]], q)


@pytest.mark.parametrize("n", [50, 400])
@pytest.mark.parametrize("seed", range(3))
def test_no_direction_descends_from_the_answer_of_a_program_that_is_not_convex(seed, n):
    rng = np.random.default_rng(seed)
    S = sp.random_array((n, n), density=4 / n, rng=rng, data_sampler=rng.standard_normal)
    H = (S + S.T) / 2 + sp.diags_array(rng.uniform(-1.0, 3.0, n))
    g = rng.normal(size=n)
    G = sp.random_array((n // 4, n), density=4 / n, rng=rng)
    h = 0.5 * G.sum(axis=1) + 0.1
    with pytest.raises(icp.InputError, match=r"solve_avi\(P, q, ...\)"):
        icp.solve_qp(H, g, G, h, lb=0.0, ub=1.0)
    x = icp.solve_avi(H, g, G, h, lb=0.0, ub=1.0).x
    gradient = H @ x + g
    assert linprog(gradient, G, h, bounds=(0.0, 1.0)).fun == pytest.approx(gradient @ x, abs=1e-6)


def test_inequalities_without_solution_are_proved():
    """No x; and no solution although there are x: the skew game x'Sy with prices that nothing bounds."""
    skew = [[0.0, 1.0], [-1.0, 0.0]]
    empty = icp.solve_avi(skew, [0, 0], G=[[1, 1]], h=[-1], lb=0, raise_on_failure=False)
    falls = icp.solve_avi(skew, [-1, -1], lb=0, raise_on_failure=False)
    assert empty.status == falls.status == "infeasible"
    assert falls.error_bound.value is None


def test_a_solution_0_beside_rounded_multipliers_is_found():
    """x = 0 with multipliers (−4, 1, 3): what rounding leaves in their place is nothing beside g."""
    H = [[8, 0, -3, 10, -7], [4, 5, -2, 1, -2], [-5, 0, 6, -4, 3], [6, 3, 0, 9, -8], [-9, -2, 1, -10, 9]]
    rows = {"G": [[1, 0, 1, 1, -2]], "h": [0], "A": [[2, -1, 1, -2, -2], [2, -2, 1, 0, 1]], "b": [0, 0]}
    found = icp.solve_avi(H, [3, -2, 0, -2, 1], **rows, lb=[-np.inf, -2, -2, 0, 0], ub=[np.inf, np.inf, 2, 0, 2])
    assert not found.x.any()
    assert np.r_[found.y, found.z] == pytest.approx([-4, 1, 3])


@pytest.mark.parametrize("n", [10, 300])
def test_programs_in_a_box_are_solved_like_their_conditions(n):
    rng = np.random.default_rng(n)
    B = rng.normal(size=(n, n)) / np.sqrt(n)
    P, q = B @ B.T, rng.normal(size=n)
    found = icp.solve_qp(P, q, lb=0, ub=1)
    assert found.violation <= 1e-9
    assert found.conditions.residual(found.x) <= 1e-8 * found.conditions.residual_at_0()
    assert found.objective <= 0.5 * (z := icp.ICP(P, q, 0, upper=1).solve().z) @ P @ z + q @ z + 1e-7


def hilbert(m, n):
    return 1.0 / (np.arange(m)[:, None] + np.arange(n) + 1.0)


@pytest.mark.parametrize(("seed", "sparse"), [(0, False), (1, True)])
def test_bounded_least_squares_are_as_good_as_those_of_scipy(seed, sparse):
    rng = np.random.default_rng(seed)
    m, n = 30, 12
    U, V = (np.linalg.qr(rng.normal(size=(k, n)))[0] for k in (m, n))
    for B in (rng.normal(size=(m, n)), U * 10.0 ** -np.linspace(0, 12, n) @ V.T, hilbert(m, n), U[:, :3] @ V[:, :3].T):
        c = B @ np.maximum(rng.normal(size=n), 0.0) + 1e-3 * rng.normal(size=m)
        given = sp.csc_matrix(B) if sparse else B
        for low, high in ((0.0, np.inf), (-0.5, 0.5), (-np.inf, np.inf)):
            found = icp.solve_lsq(given, c, low, high)
            theirs = lsq_linear(B, c, (low, high), method="bvls", tol=1e-14)
            rounding = 1e-14 * np.linalg.norm(np.abs(B) @ np.abs(found.x))
            # of rank 3 but for rounding: an x of 1e12 gains a thousandth
            theirs_rounding = 1e-14 * np.linalg.norm(np.abs(B) @ np.abs(theirs.x))
            assert found.success
            assert np.linalg.norm(found.fun) <= np.linalg.norm(theirs.fun) + rounding + theirs_rounding
            assert ((low <= found.x) & (found.x <= high)).all()
            assert found.fun == pytest.approx(B @ found.x - c, abs=rounding)


@given(GENERATORS)
def test_nonnegative_least_squares_are_never_worse_than_those_of_scipy(rng):
    """Small whole numbers: degenerate, rank-deficient, wide, with columns that repeat or are 0."""
    m, n = int(rng.integers(1, 6)), int(rng.integers(1, 9))
    B, c = rng.integers(-2, 3, (m, n)).astype(float), rng.integers(-3, 4, m).astype(float)
    x, rnorm = icp.solve_nnls(B, c)
    assert (x >= 0).all()
    assert rnorm == pytest.approx(np.linalg.norm(B @ x - c))
    # SciPy 1.15 may state the norm of another x
    assert rnorm <= np.linalg.norm(B @ nnls(B, c, maxiter=1000)[0] - c) + 1e-9


@pytest.mark.parametrize(("rows", "columns", "seed"), [(200, 60, 0), (150, 120, 2), (300, 150, 3)])
def test_sums_of_exponentials_are_fitted_as_well_as_by_an_active_set(rows, columns, seed):
    """Columns that decay to next to nothing, of condition 1e16 and more."""
    rng = np.random.default_rng(seed)
    B = np.exp(-np.linspace(0.0, 1.0, rows)[:, None] / np.logspace(-3, 0, columns))
    c = B @ np.maximum(0.0, rng.normal(size=columns)) + 1e-6 * rng.normal(size=rows)
    _, rnorm = icp.solve_nnls(B, c)
    assert rnorm <= 1.001 * nnls(B, c, maxiter=100_000)[1]


@pytest.mark.parametrize("size", [1e-200, 1e-170, 1e155, 1e290])
def test_least_squares_may_have_any_units(size):
    B, c = size * np.array([[1.0, 2], [3, 4], [5, 6]]), size * np.array([1.0, 0, 1])
    assert icp.solve_lsq(B, c, lb=0).x == pytest.approx([0.0, 1 / 7])


def test_least_squares_whose_units_are_far_apart():
    """x is on its bound, or leaves the range of floats; or the bounds are far above c/B."""
    assert icp.solve_lsq([[1e-170]], [1e160], 0.0, 1.0).x == [1.0]
    assert icp.solve_lsq([[1e-200]], [1e200], 0.0, 1e-10).x == [1e-10]
    for B, c in ((1e-200, 1e200), (1e-300, 1e300)):
        assert icp.solve_lsq([[B]], [c], 0.0, raise_on_failure=False).status == "solver_error"
    x = np.ldexp(icp.solve_lsq([[2.0, 1.0], [1.0, 3.0]], np.ldexp([5.0, 5.0], -1050), 0.0).x, 1050)
    assert x == pytest.approx([2.0, 1.0], rel=1e-6)
    assert icp.solve_lsq([[1.0, 1.0]], [1e-170], [1e140, 0.0], [1e141, 1.0]).x.tolist() == [1e140, 0.0]
    assert icp.solve_lsq([[1e-200, 0.0]], [1e-300], [1e220, 0.0], [2e220, 1.0]).x.tolist() == [1e220, 0.0]


def test_a_matrix_without_columns_is_named():
    with pytest.raises(icp.InputError, match=r"B has shape \(3, 0\)"):
        icp.solve_nnls(np.zeros((3, 0)), np.ones(3))


def test_what_nnls_of_scipy_got_wrong_is_right():
    """Its issue 25389."""
    assert icp.solve_nnls([[3, 2], [1, 1]], [3, 2])[0] == pytest.approx([0, 1.6])
    # a row without residual beside one with a large one
    B = [[2, 1, 2, 1, 2, 0, 1], [1, 2, 2, -2, 2, 2, 1]]
    assert icp.solve_nnls(B, [-3, 3])[0] == pytest.approx([0, 0, 0, 0, 0, 1.5, 0])


def test_the_rounding_of_a_heavy_row_hides_no_gradient():
    """A sum that is given by a weight of 1e7, beside rows of about 1."""
    B = [[0.2, 0.0, 0.1], [0.2, 0.3, 0.3], [-0.1, -0.3, -0.2], [1e7, 1e7, 1e7]]
    assert icp.solve_nnls(B, [0.01, 0.36, -0.19, 1e7])[0] == pytest.approx([0.0, 0.4, 0.6])


@pytest.mark.timeout(60)
def test_a_residual_that_is_rounding_ends_the_steps():
    """Each step takes 2e-13 of it away, or a tenth, for ever."""
    B = [[3.0, -1.0], [-2.0, 0.0], [1e7, 1e7]]
    assert icp.solve_lsq(B, [2.0, 0.0, -2e7], [-1, -2], [1, -1]).x == pytest.approx([0.0, -2.0])
    B = [[-2, -1, 0, 3], [-3, 3, -1, -1], [3, 2, 0, 3], [2, 0, 1, 3], [10, 10, 10, 10]]
    assert icp.solve_lsq(B, [0, 8, 1, -1, 20], [-1, 2, 0, -1], [0, 3, 1, 1]).cost == pytest.approx(0.0, abs=1e-20)


def test_an_inequality_that_every_choice_of_active_rows_contradicts_is_infeasible():
    H = [[3, 2, 0, -2], [1, 0, 1, 2], [3, -3, -1, -1], [2, 1, 1, 2]]
    bounds = {"lb": [0, 1, -np.inf, -1], "ub": [2, np.inf, 0, 2]}
    outcome = icp.solve_avi(H, [-1, -4, 1, -3], **bounds, raise_on_failure=False)
    assert outcome.status == "infeasible"
    assert outcome.conditions.solve(raise_on_failure=False).infeasible.holds


@pytest.mark.parametrize(("n", "seed"), [(36, 35), (30, 13), (30, 26)])
def test_nearly_dependent_columns_leave_no_better_point_along_a_long_step(n, seed):
    B = np.vander(np.linspace(0.0, 1.0, 12), n)
    c = np.random.default_rng(seed).standard_normal(12)
    low = np.where(np.arange(n) % 3 == 0, -np.inf, -1.0)
    high = np.where(np.arange(n) % 4 == 0, np.inf, 1.0)
    theirs = lsq_linear(B, c, (low, high), method="bvls", tol=1e-14, max_iter=9999)
    x = np.clip(theirs.x, low, high)
    assert icp.solve_lsq(B, c, low, high).cost <= 0.5 * np.sum((B @ x - c) ** 2) + 1e-6


def test_a_cost_that_overflows_loses_no_answer():
    x, rnorm = icp.solve_nnls([[1.0]], [-1e200])
    assert (x, rnorm) == ([0.0], 1e200)
    assert icp.solve_lsq([[1.0]], [-1e200], 0).cost == np.inf


def test_entries_next_to_nothing_hide_no_error():
    """Columns from 1 down to e^-1000, as of a Laplace transform: the gradient has the right signs."""
    t = np.linspace(0.0, 1.0, 100)
    B = np.exp(-t[:, None] / np.logspace(-3, 1, 80))
    c = np.exp(-t / 0.3) + 0.5 * np.exp(-t / 0.01)
    x, _ = icp.solve_nnls(B, c)
    assert np.minimum(x, B.T @ (B @ x - c)) == pytest.approx(0.0, abs=1e-9)


def test_least_squares_without_time_for_a_factorisation_return_where_they_are():
    B = np.eye(300) + 1.0
    outcome = icp.solve_lsq(B, np.ones(300), 0.0, time_limit=1e-9, raise_on_failure=False)
    assert outcome.status == "user_limit"
    assert np.isfinite(outcome.x).all()


def test_least_squares_begin_by_orthogonal_factors_where_these_cost_less_than_the_icp():
    """They take no step of a method. B has many rows, or few entries in each."""
    rng = np.random.default_rng(0)
    assert icp.solve_lsq(rng.normal(size=(5000, 5)), rng.normal(size=5000), 0.0).nit == 0
    chain = sp.eye_array(600) - sp.eye_array(600, k=1)
    assert icp.solve_lsq(chain, rng.normal(size=600), 0.0, 1.0).nit > 0


@pytest.mark.parametrize(
    ("place", "name", "last", "B"),
    [
        (scipy.linalg, "lstsq", 2, np.random.default_rng(0).normal(size=(60, 40))),
        (icp.ICP, "p", 12, sp.eye_array(600) - sp.eye_array(600, k=1)),
    ],
    ids=["orthogonal", "ICP"],
)
def test_ctrl_c_loses_no_iterate_of_least_squares(monkeypatch, place, name, last, B):
    plain = getattr(place, name)
    calls = []

    def interrupted(*args, **options):
        calls.append(args)
        if len(calls) == last:
            raise KeyboardInterrupt
        return plain(*args, **options)

    monkeypatch.setattr(place, name, interrupted)
    c = np.random.default_rng(1).normal(size=B.shape[0])
    with pytest.raises(icp.NotSolved, match="Ctrl-C") as raised:
        icp.solve_lsq(B, c, 0.0, 1.0)
    assert len(calls) >= last
    solution = raised.value.solution
    assert ((solution.x >= 0.0) & (solution.x <= 1.0)).all()
    assert solution.cost == pytest.approx(0.5 * np.sum((B @ solution.x - c) ** 2))
    assert solution.cost < 0.5 * c @ c


def test_wrong_arguments_of_least_squares_are_named():
    for arguments, sentence in (
        (([[1.0, np.nan]], [1.0]), r"B\[0, 1\] is nan"),
        (([[1.0]], [1.0, 2.0]), r"c has shape \(2,\)"),
        (([[1.0]], [1.0], 2.0, 1.0), r"lb\[0\] = 2 is above ub\[0\] = 1"),
    ):
        with pytest.raises(icp.InputError, match=sentence):
            icp.solve_lsq(*arguments)
    for name in ("tolerance", "time_limit"):
        for wrong in (-1, "x"):
            with pytest.raises(icp.InputError, match=f"{name} is"):
                icp.solve_lsq([[1.0]], [1.0], **{name: wrong})


def test_least_squares_with_equal_columns_stay_moderate():
    """An x whose rounding is larger than the residual is no solution, however small the gradient that it has."""
    for k in range(40):
        generator = np.random.default_rng(k)
        b, c = generator.standard_normal((2, 8))
        least = np.linalg.norm(b * (b @ c) / (b @ b) - c)
        for equal in (b, 0.3 + 0.0 * b):
            solution = icp.solve_lsq(np.column_stack([b, equal, equal]), c, ub=[np.inf, np.inf, 1.0])
            assert np.abs(solution.x).max() <= 1e3
            assert np.linalg.norm(solution.fun) <= (1.0 + 1e-9) * least
