"""icpmodel as a solver of CVXPY: right answers and duals, proofs where there is no answer, in any units."""

import cvxpy as cp
import numpy as np
import pytest
from cvxpy_programs import PROGRAMS

import icpmodel as icp

TIGHT = {"tol_gap_abs": 1e-11, "tol_gap_rel": 1e-11, "tol_feas": 1e-11}


def solve(problem, **options):
    problem.solve(solver=icp.cvxpy_solver(), **options)
    return problem


@pytest.mark.parametrize("make", PROGRAMS, ids=lambda make: make.__name__)
def test_cvxpys_standard_programs_have_the_answers_of_clarabel(make):
    """The value to nine digits, variables and duals as far as the other solver goes; the transport is an LP."""
    ours, theirs = solve(make()), make()
    theirs.solve(solver="CLARABEL", **TIGHT)
    assert ours.status == cp.OPTIMAL
    assert ours.value == pytest.approx(theirs.value, rel=1e-9)
    for mine, other in zip(ours.variables(), theirs.variables(), strict=True):
        assert mine.value == pytest.approx(other.value, abs=1e-4)
    if make.__name__ != "transport":  # whose duals are determined up to a constant
        for mine, other in zip(ours.constraints, theirs.constraints, strict=True):
            assert mine.dual_value == pytest.approx(other.dual_value, abs=1e-3)


x = cp.Variable(3)
WITHOUT_ANSWER = {
    "bounds that cross": (cp.Minimize(cp.sum_squares(x)), [x >= 1, x <= 0], cp.INFEASIBLE),
    "equations": (cp.Minimize(cp.sum_squares(x)), [cp.sum(x) == 1, cp.sum(x) == 2], cp.INFEASIBLE),
    "inequalities": (cp.Minimize(cp.sum(x)), [cp.sum(x) >= 1, x <= 0.25], cp.INFEASIBLE),
    "zero row": (cp.Minimize(cp.sum(x)), [0 * x[0] >= 1], cp.INFEASIBLE),
    "both": (cp.Minimize(x[0]), [x[1] >= 1, x[1] <= 0], cp.INFEASIBLE),
    "linear": (cp.Minimize(cp.sum(x)), [], cp.UNBOUNDED),
    "linear with bounds": (cp.Maximize(cp.sum(x)), [x >= 0], cp.UNBOUNDED),
    "linear with rows": (cp.Maximize(cp.sum(x)), [x >= 0, x[0] == x[1]], cp.UNBOUNDED),
    "quadratic": (cp.Minimize(cp.square(x[0]) - x[1]), [x[2] == 0], cp.UNBOUNDED),
}


@pytest.mark.parametrize("name", WITHOUT_ANSWER)
def test_infeasible_and_unbounded_are_proved(name):
    """Hence without "inaccurate"; the value is that of the empty minimum."""
    objective, rows, status = WITHOUT_ANSWER[name]
    problem = solve(cp.Problem(objective, rows))
    assert problem.status == status
    assert np.isinf(problem.value)
    assert all(v.value is None for v in problem.variables())
    if name != "zero row":
        assert "up to rounding" not in problem.solver_stats.extra_stats.message


def many_bounds(n=300):
    """An obstacle problem, which goes to `icpmodel.solve`."""
    y = cp.Variable(n)
    return cp.Problem(cp.Minimize(cp.sum_squares(cp.diff(y)) + cp.sum(y)), [y >= -1, y[0] <= 1])


@pytest.mark.parametrize("unit", [1e-100, 1e-9, 1e9, 1e100])
def test_units_do_not_matter(unit):
    """Of the objective, of a row and of the variables: the answer is (1, 0, 0) in the unit of x."""
    aim = np.array([3.0, 0.0, 1.0])
    by_objective = cp.Problem(cp.Minimize(unit * cp.sum_squares(x - aim)), [cp.sum(x) == 1, x >= 0])
    by_row = cp.Problem(cp.Minimize(cp.sum_squares(x - aim)), [unit * cp.sum(x) == unit, x >= 0])
    by_unknown = cp.Problem(cp.Minimize(cp.sum_squares(unit * x - aim)), [unit * cp.sum(x) == 1, x >= 0])
    for problem, size in ((by_objective, 1.0), (by_row, 1.0), (by_unknown, unit)):
        assert solve(problem).status == cp.OPTIMAL
        assert x.value * size == pytest.approx([1, 0, 0], abs=1e-8)
    no_value = cp.Problem(cp.Minimize(cp.sum_squares(unit * x)), [unit * x >= 1, cp.sum(x) <= 2 / unit])
    assert solve(no_value).status == cp.INFEASIBLE


def test_bounds_of_variables_and_parameters_arrive():
    """Also through hinges, which CVXPY 1.9.3 gives wrong bounds for solvers that take bounds as such."""
    y, level = cp.Variable(2, nonneg=True), cp.Parameter()
    problem = cp.Problem(cp.Minimize(cp.sum_squares(y - 1) + cp.sum(cp.pos(np.eye(2) @ y - level))))
    for level.value, expected in ((0.75, 0.75), (2.0, 1.0), (-1.0, 0.5)):
        solve(problem)
        assert y.value == pytest.approx([expected] * 2, abs=1e-7)
    box = cp.Variable(2, bounds=[-5, [1, 5]])
    solve(cp.Problem(cp.Minimize(cp.square(box[0] - 3) + cp.square(box[0] + box[1] - 3))))
    assert box.value == pytest.approx([1, 2], abs=1e-7)  # without the bounds (3, 0)


def test_the_options_are_checked_and_work(capsys):
    problem = cp.Problem(cp.Minimize(cp.sum_squares(x - 1)), [cp.sum(x) == 1])
    for option, value, sentence in (
        ("rtol", 1, "has no option rtol; it takes tolerance, time_limit"),
        ("tolerance", 0, "tolerance is 0; a finite number > 0"),
        ("time_limit", "no", "time_limit is 'no'"),
    ):
        with pytest.raises(icp.InputError, match=sentence):
            solve(problem, **{option: value})
    assert solve(problem, tolerance=1e-3, time_limit=60).status == cp.OPTIMAL
    assert solve(problem, warm_start=False).solver_stats.solver_name == "ICPMODEL"
    assert problem.solver_stats.num_iters >= 1
    problem.solve(solver=icp.cvxpy_solver(), verbose=True)
    assert "icpmodel: optimal after" in capsys.readouterr().out


@pytest.mark.filterwarnings("ignore:Solution may be inaccurate")
def test_out_of_time_is_a_status_of_this_solve():
    """Not that of the solve before; the variables have the best iterate, and the next solve is not impressed."""
    problem = solve(PROGRAMS[0]())
    value = problem.value
    for _ in range(2):
        assert solve(problem, time_limit=1e-9, warm_start=False).status == cp.USER_LIMIT
        assert all(np.isfinite(v.value).all() for v in problem.variables())
    assert solve(problem).status == cp.OPTIMAL
    assert problem.value == pytest.approx(value)
    assert solve(many_bounds(), time_limit=1e-9).status == cp.USER_LIMIT


@pytest.mark.parametrize("make", [PROGRAMS[0], many_bounds])
def test_ctrl_c_is_not_swallowed(make, monkeypatch):
    """By a step, or where there are bounds only."""
    program = make()
    monkeypatch.setattr(icp.ICP, "p", lambda *_: interrupt())
    with pytest.raises(KeyboardInterrupt):
        solve(program)


def interrupt():
    raise KeyboardInterrupt


def test_right_hand_sides_that_are_rounding_forbid_no_answer():
    """Sums that come to 1e-16 and not to 0, where the unknowns of the row are 0 and others are 1000."""
    G, h = [[1.0, 1.0, 0.0], [0.0, 0.0, -1.0]], [-1e-16, -1000.0]
    found = icp.solve_qp(np.diag([0.0, 0.0, 1.0]), [1.0, 2.0, 0.0], G, h, [[1.0, -1.0, 1e-3]], [1.0], lb=0)
    assert found.x == pytest.approx([0.0, 0.0, 1000.0], abs=1e-12)


def test_programs_that_a_residual_in_other_units_calls_solved():
    y = cp.Variable(2)
    rows = [y[0] + 2 * y[1] == 4, y >= 0, y[0] - y[1] >= 1]
    assert solve(cp.Problem(cp.Minimize(1e-10 * cp.sum_squares(y) + cp.sum(y)), rows)).status == cp.OPTIMAL
    assert y.value == pytest.approx([2, 1], rel=1e-6)
    problem = solve(cp.Problem(cp.Minimize(1e-10 * cp.square(y[0]) + y[0]), [y[0] <= -3, y[0] >= -1]))
    assert problem.status == cp.INFEASIBLE


def test_a_side_of_any_size_changes_no_later_answer():
    """The largest float cannot be brought into other units: nothing of that solve may be used again."""
    x = cp.Variable(2)
    h = cp.Parameter(2)
    P = np.array([[1e-10, -2e-12], [-2e-12, 8e-14]])
    G = np.array([[-1e4, -100.0], [1e-13, 2e-15]])
    problem = cp.Problem(cp.Minimize(0.5 * cp.quad_form(x, P) + np.array([-2e-5, 1e-7]) @ x), [G @ x <= h])
    for h.value in ([0.0, 0.0], [0.0, np.finfo(float).max], [-1e9, 2e-8]):
        problem.solve(solver=icp.cvxpy_solver())
    assert x.value == pytest.approx([170000.0, 1500000.0], rel=1e-6)
