"""solve_many is solve, row by row."""

import time

import numpy as np
import pytest
import scipy.sparse as sp
from known_answers import chain, definite, sine

import icpmodel as icp
from icpmodel import Status
from icpmodel.solve.many import solve_many
from icpmodel.solve.many.compiled_solver import UNKNOWNS_A_THREAD

SMALL = [[2.0, -1.0], [-1.0, 2.0]]
TRIDIAGONAL = chain(100)


def same_as_row_by_row(A, Q, psi, obstacles=False, **options):
    """Several of A, of q, and of ψ where there are `obstacles`, are those of each row."""
    found = solve_many(A, Q, psi, **options)
    for i, z in enumerate(found.Z):
        q = Q[i] if np.ndim(Q) == 2 else Q
        problem = icp.ICP(A[i] if np.ndim(A) == 3 else A, q, psi[i] if obstacles else psi)
        alone = problem.solve(**options)
        assert z == pytest.approx(alone.z, abs=1e-6)
        assert found.residuals[i] == pytest.approx(problem.residual(z), rel=1e-6, abs=1e-13)
        assert found.residuals[i] <= found.tolerances[i]
        assert found.tolerances[i] == pytest.approx(alone.tolerance, rel=1e-12)
    assert found.failed == []
    assert set(found.statuses) == {icp.Status.SOLVED}
    return found


@pytest.mark.parametrize("n", [1, 3, 16, 64])
def test_small_lcps_with_fixed_obstacles(n):
    rng = np.random.default_rng(n)
    same_as_row_by_row(definite(rng, n), rng.normal(size=(30, n)), 0.0)
    same_as_row_by_row(definite(rng, n), rng.normal(size=(30, n)), rng.normal(size=n))


@pytest.mark.parametrize("A", [[np.array([[2.0, -1.0], [-1.0, 2.0]])], np.array([[[2.0, -1.0], [-1.0, 2.0]]])])
def test_a_list_of_one_matrix_is_that_matrix(A):
    Q = np.random.default_rng(0).normal(size=(5, 2))
    assert (solve_many(A, Q).Z == solve_many(A[0], Q).Z).all()


@pytest.mark.parametrize("form", [lambda M: M.astype(int), lambda M: M.astype("f4"), lambda M: M.tolist()])
def test_matrices_of_any_kind_of_numbers_in_one_call(form, caplog):
    rng = np.random.default_rng(6)
    A = [np.rint(definite(rng, 3)) + 4.0 * np.eye(3) for _ in range(20)]
    Q = rng.normal(size=(20, 3))
    with caplog.at_level("INFO", logger="icpmodel"):
        assert (solve_many(list(map(form, A)), Q).Z == solve_many(A, Q).Z).all()
    assert caplog.text.count("20 are solved at once") == 2


@pytest.mark.parametrize("atol", [0.0, 1e-9])
@pytest.mark.parametrize("obstacles", ["one", "each"])
def test_matrices_of_their_own_in_one_call(obstacles, atol):
    """Rows of which 0 is the answer, in units of their own, without obstacles, and one that has no solution."""
    rng = np.random.default_rng(5)
    k, n = 40, 7
    A = [definite(rng, n) * 2.0 ** rng.integers(-60, 60) for _ in range(k)]
    Q = rng.normal(size=(k, n)) * np.array([np.abs(M).max() for M in A])[:, None]
    Q[3] = np.abs(Q[3])
    A[5] = -np.eye(n)
    Q[5] = -1.0
    psi = np.zeros(n) if obstacles == "one" else np.where(rng.random((k, n)) < 0.2, -np.inf, rng.normal(size=(k, n)))
    found = solve_many(A, Q, psi, atol=atol, raise_on_failure=False)
    assert found.failed == [5]
    for i in set(range(k)) - {5}:
        alone = icp.ICP(A[i], Q[i], psi if obstacles == "one" else psi[i]).solve(atol=atol)
        assert found.Z[i] == pytest.approx(alone.z, rel=1e-9, abs=1e-12)
        assert found[i].solved
        assert found[i].problem.residual(found.Z[i]) == pytest.approx(found[i].residual, rel=1e-6, abs=1e-13)
        assert found.tolerances[i] == pytest.approx(alone.tolerance, rel=1e-12)
        assert "at once" in found[i].why


def test_obstacles_of_each_row_and_rows_without_one():
    rng = np.random.default_rng(0)
    C = rng.normal(size=(40, 6))
    C[rng.random(C.shape) < 0.3] = -np.inf
    A = definite(rng, 6)
    same_as_row_by_row(A, rng.normal(size=(40, 6)), C, obstacles=True)
    same_as_row_by_row(A, rng.normal(size=6), C, obstacles=True)
    assert np.array_equal(solve_many(A, np.ones((3, 6)), C[:1]).Z, solve_many(A, np.ones((3, 6)), C[[0, 0, 0]]).Z)


def test_what_is_not_pivoted_is_solved_one_by_one():
    rng = np.random.default_rng(1)
    large = icp.scenes.membrane(n=100).problem
    Q = large.q + 0.01 * rng.normal(size=(4, 100))
    same_as_row_by_row(large.A, Q, large.psi.c)
    same_as_row_by_row(large.A, Q, np.array([large.psi.c - 0.1 * k for k in range(4)]), obstacles=True)
    same_as_row_by_row(definite(rng, 5), rng.normal(size=(5, 5)), icp.Affine(0.1 * np.eye(5), -0.1))
    same_as_row_by_row(definite(rng, 5), rng.normal(size=(5, 5)), lambda z: 0.1 * np.sin(z))


def test_threads_give_the_rows_in_their_order():
    rng = np.random.default_rng(2)
    A, (Q, C) = definite(rng, 4), rng.normal(size=(2, UNKNOWNS_A_THREAD, 4))
    parts = [np.array_split(rows, 5) for rows in (Q, C, C + 1.0)]
    whole = solve_many(A, Q, C, upper=C + 1.0)
    by_part = [solve_many(A, q, c, upper=d).Z for q, c, d in zip(*parts, strict=True)]
    assert np.array_equal(whole.Z, np.vstack(by_part))


@pytest.mark.parametrize("A", [definite(np.random.default_rng(0), 6), TRIDIAGONAL])
def test_rows_with_obstacles_of_their_own_are_solved_at_once(A, caplog):
    """By pivots and by the tridiagonal pass: with the obstacles of another row they would be solved again, alone."""
    n = A.shape[0]
    Q, C = np.random.default_rng(0).normal(size=(2, 5, n))
    for upper in (C + 1.0, np.where(C > 0.0, C + 1.0, np.inf)):
        caplog.clear()
        with caplog.at_level("INFO", "icpmodel"):
            solve_many(A, Q, C, upper=upper)
        assert any(one.startswith(f"5 rows, n = {n}: 5 are solved at once") for one in caplog.messages)


def test_the_rows_that_fail_are_named_and_the_others_are_solved():
    A, Q = [[1.0, -1.0], [-1.0, 1.0]], [[1.0, 1.0], [-1.0, 0.0], [-1.0, 2.0], [-2.0, 1.0]]
    found = solve_many(A, Q, raise_on_failure=False)
    assert found.failed == [1, 3]
    assert [status.name for status in found.statuses] == ["SOLVED", "INFEASIBLE", "SOLVED", "INFEASIBLE"]
    assert found.message.startswith("2 of 4 rows failed, first row 1: Lemke() infeasible")
    assert "2 of 4 rows failed" in repr(found)
    with pytest.raises(icp.NotSolved, match="2 of 4 rows failed") as caught:
        solve_many(A, Q)
    assert np.array_equal(caught.value.solution.Z, found.Z)


def test_rows_whose_problem_is_solved_by_0_and_problems_in_units_of_their_own():
    assert solve_many([[2.0]], [[0.0], [3.0]]).residuals.tolist() == [0.0, 0.0]
    assert solve_many(sp.eye_array(3), np.ones((2, 3)), -1.0).failed == []


@pytest.mark.parametrize(
    ("Q", "psi", "words"),
    [
        ([[1.0, 2.0]], 0.0, "q has shape|Q has shape"),
        ([[[1.0]]], 0.0, "Q has shape .1, 1, 1."),
        (np.zeros((0, 1)), 0.0, "Q has shape .0, 1."),
        ([[1.0], [np.nan]], 0.0, r"Q\[1, 0\] is nan"),
        ([[1.0], [1.0, 2.0]], 0.0, "Q cannot be read as an array of numbers"),
        ([[1.0], [2.0]], np.zeros((3, 1)), "there are 2 of Q, 3 of psi; as many of each were expected"),
        ([[1.0]], [[np.inf]], r"psi\[0, 0\] is inf"),
    ],
)
def test_wrong_input_is_named(Q, psi, words):
    with pytest.raises(icp.InputError, match=words):
        solve_many([[2.0]], Q, psi)


@pytest.mark.parametrize(
    ("A", "psi", "Z0", "words"),
    [
        ([np.eye(2)] * 3, 0.0, None, "there are 3 of A, 2 of Q"),
        (np.eye(2), 0.0, np.zeros((3, 2)), "2 of Q, 3 of Z0"),
        (np.eye(2), 0.0, np.zeros((2, 3)), "Z0 has shape .3,.; shape .2,. was expected"),
        (np.eye(2), np.zeros((2, 3)), None, "psi has shape .3,.; shape .2,. was expected"),
    ],
)
def test_lists_that_do_not_fit_each_other_are_named(A, psi, Z0, words):
    with pytest.raises(icp.InputError, match=words):
        solve_many(A, np.ones((2, 2)), psi, Z0=Z0)


def test_obstacles_that_move_are_pivoted_too_where_they_are_affine_or_amount_to_fixed_ones():
    rng = np.random.default_rng(6)
    c = np.where(rng.random(6) < 0.3, -np.inf, rng.normal(size=6))
    maps = [
        icp.Affine(0.1 * rng.normal(size=(6, 6)), c),
        icp.Affine(np.diag(rng.uniform(-0.9, 0.9, 6)), c),
        sine(0.8, c),
    ]
    A, Q = definite(rng, 6), rng.normal(size=(25, 6))
    for psi in maps:
        same_as_row_by_row(A, Q, psi)


def test_tridiagonal_problems_of_any_size_are_solved_in_compiled_code_on_all_cores():
    rng = np.random.default_rng(7)
    bearing = icp.scenes.bearing(n=300).problem
    Q = bearing.q * rng.uniform(0.5, 2.0, (150, 1)) + 1e-6 * rng.normal(size=(150, 300))
    C = 0.1 * rng.normal(size=(150, 300))
    expected = same_as_row_by_row(bearing.A, Q, C, obstacles=True)
    assert expected.Z.size > 2 * UNKNOWNS_A_THREAD
    same_as_row_by_row(
        bearing.A, Q[:5], icp.Elementwise(np.tanh, lambda z: 1 - np.tanh(z) ** 2, lipschitz=0.999, c=-0.1)
    )


def test_parameter_values_a_list_of_matrices_or_of_maps():
    rng = np.random.default_rng(8)
    q = rng.normal(size=5)
    matrices = [definite(rng, 5) for _ in range(4)]
    maps = [icp.Elementwise(lambda z, t=t: t * np.sin(z), lipschitz=t) for t in (0.0, 0.1, 0.5, 0.9)]
    assert np.array_equal(
        solve_many(matrices[0], q, [0.0, maps[2]]).Z, solve_many(matrices[0], q, [maps[0], maps[2]]).Z
    )
    for A, psi in ((matrices, 0.0), (matrices, maps), (matrices[0], maps), (np.array(matrices), maps[2])):
        assert len(same_as_row_by_row(A, q, psi, obstacles=psi is maps)) == 4
    sparse = [sp.csr_array(A) for A in matrices]
    assert np.array_equal(solve_many(sparse, np.tile(q, (4, 1))).Z, solve_many(matrices, q).Z)


@pytest.mark.parametrize("last", range(17, 77, 12))
def test_ctrl_c_leaves_the_rows_that_are_solved_and_begins_no_others(last):
    """Wherever it comes: in the loop, or while a row is set up."""
    rng = np.random.default_rng(9)
    Q, calls = rng.normal(size=(5, 4)), []

    def psi(z):
        calls.append(1)
        if len(calls) == last:
            raise KeyboardInterrupt
        return 0.1 * np.sin(z)

    found = solve_many(definite(rng, 4), Q, psi, raise_on_failure=False)
    names = [status.name for status in found.statuses]
    if "INTERRUPTED" not in names:  # it came while a row that is solved was judged once more
        assert set(names) == {"SOLVED"}
        return
    at = names.index("INTERRUPTED")
    assert set(names[:at]) <= {"SOLVED"}
    assert set(names[at:]) == {"INTERRUPTED"}
    assert all("an earlier row was interrupted" in found.messages[row] for row in range(at + 1, 5))


def test_a_psi_that_fails_fails_in_its_own_row():
    def failing(z):
        raise ValueError("no data for this day")

    def near_0(z):  # it has no value at the answer of the row before
        if (np.abs(z) > 1.5).any():
            raise ValueError("out of its domain")
        return 0.1 * z

    Q, maps = [[-2.0], [-2.0], [-9.0], [-2.0]], [icp.Constant(0.1), failing, icp.Constant(0.2), near_0]
    found = solve_many([[2.0]], Q, maps, raise_on_failure=False)
    assert found.failed == [1]
    assert found.statuses[1] is icp.Status.MAP_FAILED
    assert found.Z.ravel()[[0, 2, 3]] == pytest.approx([1.0, 4.5, 1.0])
    with pytest.raises(icp.NotSolved, match=r"1 of 4 rows failed, first row 1: psi.z. raised ValueError: no data"):
        solve_many([[2.0]], Q, maps)


@pytest.mark.parametrize("psi", [0.0, lambda z: 0.1 * np.sin(z)])
def test_limits_of_time_and_memory_are_statuses_of_the_rows(psi):
    """Law 12. A row that was not begun has its start, and nothing is said of its residual."""
    rng = np.random.default_rng(7)
    A, Q, Z0 = definite(rng, 5), rng.normal(size=(6, 5)), rng.normal(size=(6, 5))
    found = solve_many(A, Q, psi, Z0=Z0, time_limit=0.0, raise_on_failure=False)
    assert set(found.statuses) == {icp.Status.TIME_LIMIT}
    assert np.array_equal(found.Z, Z0)
    assert np.isinf(found.residuals).all()
    assert solve_many(A, Q, psi, time_limit=60.0, memory_limit=1e9).failed == []
    starved = solve_many(
        icp.scenes.membrane(n=400).problem.A, np.ones((2, 400)) * -1, psi, memory_limit=0.0, raise_on_failure=False
    )
    assert set(starved.statuses) <= {icp.Status.SOLVED, icp.Status.MEMORY_LIMIT}


def test_what_is_wrong_in_a_row_is_said_before_another_one_is_solved():
    """As `ICP` says it: a matrix that is not finite, one of another size, a map of another length, texts and dates."""
    never = icp.Function(lambda z: pytest.fail("a row was solved"))
    good, Q = np.eye(2), np.ones((2, 2))
    for A in ([good, np.array([[1.0, np.nan], [0.0, 1.0]])], [good, np.eye(3)], [good, 1j * good]):
        with pytest.raises(icp.InputError):
            solve_many(A, Q, never)
    with pytest.raises(icp.InputError, match=r"Constant\.c has shape"):
        solve_many(good, Q, [never, icp.Constant([1.0, 2.0, 3.0])])


@pytest.mark.parametrize("psi", [0.0, [-0.5, 0.0, -2.0]])
@pytest.mark.parametrize("upper", [None, 3.0])
def test_each_row_has_the_tolerance_of_its_own_problem_where_0_is_a_solution(psi, upper):
    A = [np.diag([2.0, 3.0, 4.0]) + 0.1 * k for k in range(4)]
    A[3][1] = 0.0
    Q = np.array([[1.0, 2.0, 0.0], [0.0, 0.0, 0.0], [-1.0, 2.0, 3.0], [0.0, 1e-3, 0.0]])
    for matrices in (A, A[0], A[3]):
        rows = solve_many(matrices, Q, psi, upper=upper)
        for row, M, q in zip(rows, [matrices] * 4 if matrices is not A else A, Q, strict=True):
            expected = 1e-8 * icp.ICP(M, q, psi, upper=upper).residual_scale()
            assert row.tolerance == pytest.approx(expected, rel=1e-12)


def test_the_row_before_is_no_measure_of_what_is_small():
    """Where 0 is the solution the answer of the row before does not set the scale of this one."""
    psi = icp.Elementwise(lambda x: np.abs(x) / 2, c=np.zeros(1))
    found = icp.solve_many([[1.0]], [[-1.0], [1.0]], psi)
    assert found.Z.ravel().tolist() == [1.0, 0.0]
    assert found.residuals[1] == 0.0


def half_sine(z):
    return 0.5 * np.sin(z)


def test_a_row_is_a_solution_of_its_own_problem_whatever_found_it():
    """At once by pivots and by the tridiagonal pass, and one by one; with the certificate that `solve` gives."""
    random = np.random.default_rng(0)
    for A, psi in ((SMALL, 0.0), (SMALL, icp.Affine(0.1 * np.eye(2), -1.0)), (TRIDIAGONAL, 0.0), (SMALL, half_sine)):
        Q = random.standard_normal((4, np.shape(A)[0] if psi is not half_sine else 2))
        many = icp.solve_many(A, Q, psi)
        assert len(many) == len(list(many)) == 4
        for k, one in enumerate(many):
            alone = icp.ICP(A, Q[k], psi).solve()
            assert isinstance(one, icp.Solution)
            assert np.array_equal(one.z, many.Z[k])
            assert (one.problem.q == Q[k]).all()
            assert one.status is many.statuses[k]
            assert one.residual == many.residuals[k] <= one.tolerance == many.tolerances[k]
            assert one.certificate.residual == pytest.approx(one.residual, rel=1e-12)
            assert one.certificate.unique == alone.certificate.unique
            assert np.abs(one.polish().z - alone.polish().z).max() <= 1e-9
        assert type(many[0].method) is type(alone.method) or psi is half_sine


@pytest.mark.parametrize("kind", ["upper rows", "psi rows", "psi maps", "upper maps", "matrices"])
def test_a_row_keeps_its_problem_where_the_arrays_of_the_caller_change(kind):
    low = np.array([0.5, 0.5])
    high = np.array([9.0, 9.0])
    given = {
        "upper rows": {"psi": low, "upper": np.full((2, 2), 9.0)},
        "psi rows": {"psi": np.full((2, 2), 0.5), "upper": high},
        "psi maps": {"psi": [low, icp.Constant(0.5)], "upper": high},
        "upper maps": {"psi": low, "upper": [high, icp.Constant(9.0)]},
        "matrices": {"A": [np.array(SMALL), 2.0 * np.array(SMALL)], "psi": low},
    }[kind]
    many = solve_many(**{"A": SMALL, "Q": [[-3.0, 1.0], [-2.0, -2.0]], **given})
    low += 3.0
    high -= 8.8
    for one in many:
        assert one.problem.residual(one.z) == pytest.approx(one.residual, abs=1e-12)


def slow(z):
    time.sleep(0.01)
    return half_sine(z)


def slow_and_rough(z):
    return slow(z) + 3.0 * np.sin(1e3 * z[::-1])


def test_a_row_that_runs_out_of_time_names_the_limit_of_all_rows():
    many = solve_many(SMALL, [1.0, -2.0], [slow, slow_and_rough], time_limit=1.5, raise_on_failure=False)
    assert many.statuses[1] is Status.TIME_LIMIT
    assert many.messages[1].count("time_limit =") == many.messages[1].count("time_limit = 1.5 s") == 1


def test_a_row_of_lists_has_its_own_obstacle_and_a_failed_one_its_end():
    many = icp.solve_many([[2.0]], [[-8.0], [-8.0]], psi=[[0.0], [1.0]], upper=[[3.0], [2.0]])
    assert [one.problem.upper.value(one.z).item() for one in many] == [3.0, 2.0]
    failed = icp.solve_many([[-1.0]], [[1.0], [-1.0]], raise_on_failure=False)[1]
    assert (failed.status, failed.infeasible.holds) == (Status.INFEASIBLE, True)
    assert "infeasible" in str(failed)
    late = icp.solve_many(SMALL, [[1.0, -2.0]] * 2, np.sin, time_limit=1e-9, raise_on_failure=False)[1]
    assert late.status is Status.TIME_LIMIT
    assert "was over before its turn" in late.message


def test_each_row_starts_at_its_own_z0_where_there_are_several_solutions():
    A = np.array([[1.0, 2.0], [2.0, 1.0]])
    starts = np.array([[1.0, 0.0], [0.0, 1.0]])
    many = icp.solve_many(A, -np.ones((2, 2)), Z0=starts)
    assert many.Z.tolist() == starts.tolist()


def test_a_row_says_what_differentiates_it():
    A = np.array([[2.0, -1.0], [-1.0, 2.0]])
    row = icp.solve_many([A, A], [[-1.0, 3.0], [1.0, 2.0]])[0]
    with pytest.raises(icp.InputError, match=r"icpmodel\.Derivative\(solution\)"):
        row.derivative()
    assert icp.Derivative(row).forward(dq=[1.0, 0.0]) == pytest.approx([-0.5, 0.0])
