"""`icp.Problem` has what CVXPY's user expects of a problem: status, value, statistics, dual values, copies, a log."""

import copy
import pickle

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from known_answers import PAIR as A
from known_answers import attempt

import icpmodel as icp
from icpmodel.modelling.cvxpy.cvxpy_problem import STATUSES


def contact(load):
    z = cp.Variable(2, name="z")
    pair = icp.complements(A @ z - load, z)
    return icp.Problem(pair), z, pair


def two_answers():
    """p = (x + 2y − 1, 2x + y − 1) ⟂ (x, y): (1, 0), (0, 1) and (1/3, 1/3)."""
    z = cp.Variable(2, name="z")
    return icp.complements(np.array([[1.0, 2.0], [2.0, 1.0]]) @ z - 1, z), z


def test_status_and_value_are_those_of_a_problem_with_the_objective_0():
    load = cp.Parameter(value=1.0)
    problem, _, _ = contact(load)
    assert (problem.status, problem.value, problem.solution, problem.solver_stats) == (None, None, None, None)
    problem.solve()
    assert (problem.status, problem.value) == (cp.OPTIMAL, 0.0)
    attempt(problem, "mnmgs", warm_start=False, max_iter=1)
    assert (problem.status, problem.value) == (cp.USER_LIMIT, None)
    z = cp.Variable()
    never = icp.Problem(icp.complements(-z - 1, z))
    attempt(never)
    assert (never.status, never.value) == (cp.INFEASIBLE, np.inf)
    x = cp.Variable(2)
    lost = icp.Problem(icp.complements(np.array([[1.0, -2.0], [2.0, 2.0]]) @ x - [1, 2], x))
    attempt(lost, "mnmgs")
    assert (lost.status, lost.value) == (cp.SOLVER_ERROR, None)


def test_every_end_of_a_run_has_a_word_that_cvxpy_knows():
    known = {*cp.settings.SOLUTION_PRESENT, *cp.settings.INF_OR_UNB, *cp.settings.ERROR}
    assert set(STATUSES) == set(icp.Status)
    assert set(STATUSES.values()) <= known
    assert [status for status, word in STATUSES.items() if word == cp.OPTIMAL] == [icp.Status.SOLVED]
    assert [status for status, word in STATUSES.items() if word == cp.INFEASIBLE] == [icp.Status.INFEASIBLE]


def test_variables_parameters_and_constraints_are_asked_for_as_in_cvxpy():
    load, x, high = cp.Parameter(2, name="load", value=[3, -1]), cp.Variable(2, name="x"), cp.Parameter(value=9)
    given = [icp.complements(A @ x - load, x), x <= high]
    problem = icp.Problem(one for one in given)
    assert problem.variables() == [x]
    assert problem.parameters() == [load, high]
    assert problem.constraints == given
    problem.constraints.clear()
    assert problem.constraints == given
    assert problem.is_dpp()
    assert problem.icp() is problem.icp()
    assert problem.explain().bound.unique
    with pytest.raises(icp.InputError, match="covers the members of the modulus family only"):
        problem.explain("lemke")


def test_the_start_is_the_last_answer_unless_a_warm_one_is_not_wanted():
    problem, _, _ = contact(np.array([1.0, 3.0]))
    starts = []

    def solve(**options):
        problem.solve("mnmgs", callback=lambda state: starts.append(state) if state.iteration == 0 else None, **options)
        return starts[-1].z.tolist()

    answer = problem.solve("lemke").z.tolist()
    assert solve() == answer
    assert solve(warm_start=False) == [0, 0]
    assert solve(warm_start=False, z0=[3, 4]) == [3, 4]
    with pytest.raises(icp.InputError, match="warm_start is 'no'; True or False was expected"):
        problem.solve(warm_start="no")


def test_a_failed_run_leaves_its_best_iterate_where_it_does_not_raise_and_nothing_where_it_does():
    problem, z, pair = contact(1.0)
    total = cp.sum(z) <= 9
    problem = icp.Problem([pair, total])
    problem.solve()
    assert total.dual_value == 0
    with pytest.raises(icp.NotSolved) as caught:
        problem.solve("mnmgs", z0=[9, 0], max_iter=1)
    assert caught.value.solution is problem.solution
    assert problem.status == cp.USER_LIMIT
    assert (z.value, pair.p, pair.r, pair.dual_value, total.dual_value) == (None,) * 5
    found = attempt(problem, "mnmgs", z0=[9, 0], max_iter=1)
    assert not found.solved
    assert z.value.tolist() == found.z.tolist()
    assert pair.p == pytest.approx(A @ found.z - 1)
    assert pair.r.tolist() == found.z.tolist()
    assert total.dual_value is None


# ---------------------------------------------------------------------------------------------------- dual values


@settings(max_examples=15)
@given(st.integers(0, 10_000))
def test_dual_values_are_cvxpys_wherever_the_conditions_are_those_of_an_optimum(seed):
    """Equations and multipliers in any order and sign, in one block or several, in any units."""
    random = np.random.default_rng(seed)
    n, m = 5, 2
    B, E = random.normal(size=(n, n)), random.normal(size=(m, n))
    P, q, b = B @ B.T + np.eye(n), 3 * random.normal(size=n), E @ random.uniform(0.2, 0.8, n)
    x, force = cp.Variable(n), [cp.Variable(name=f"force{k}") for k in range(m)]
    sign, unit = random.choice([-1, 1], m), 2.0 ** random.integers(-3, 4, m)
    pushed = sum(sign[k] * unit[k] * E[k] * force[k] for k in random.permutation(m))
    pair = icp.complements(P @ x + q + pushed, x, upper=1)
    rows = [E[k] @ x == b[k] if seed % 2 else b[k] == E[k] @ x for k in range(m)]
    icp.Problem([*(rows[k] for k in random.permutation(m)), pair]).solve(rtol=1e-10)
    y = cp.Variable(n)
    program = [E[k] @ y == b[k] if seed % 2 else b[k] == E[k] @ y for k in range(m)]
    bounds = [y >= 0, y <= 1]
    tight = {"tol_gap_abs": 1e-11, "tol_gap_rel": 1e-11, "tol_feas": 1e-11}
    objective = cp.Minimize(0.5 * cp.quad_form(y, cp.psd_wrap(P)) + q @ y)
    cp.Problem(objective, program + bounds).solve(solver="CLARABEL", **tight)
    assert x.value == pytest.approx(y.value, abs=1e-6)
    for k, cvxpys in enumerate(program):
        assert sign[k] * unit[k] * force[k].value == pytest.approx(cvxpys.dual_value, abs=1e-4)
    assert pair.dual_value == pytest.approx(bounds[0].dual_value - bounds[1].dual_value, abs=1e-4)


# ---------------------------------------------------------------------------------------------------- inequalities


def test_an_inequality_that_holds_changes_nothing_and_has_the_dual_value_0():
    _, z, pair = contact(np.array([1.0, -3.0]))
    rows = [z <= 2, cp.NonNeg(z), z[0] >= 0.5, 1e6 * z >= 0, A @ z - [1, -3] >= 0]
    plain = icp.Problem(pair).solve(warm_start=False).z
    problem = icp.Problem([*rows, pair])
    assert (problem.solve(warm_start=False).z == plain).all()
    assert problem.status == cp.OPTIMAL
    assert all((one.dual_value == 0).all() and one.dual_value.shape == one.shape for one in rows)


def test_a_violated_inequality_is_infeasible_where_the_conditions_have_one_solution():
    cap = cp.Parameter(2, value=[9, 9])
    _, z, pair = contact(np.array([1.0, 3.0]))  # z = (5/3, 7/3)
    rows = [z <= cap, cp.sum(z) >= 0]
    problem = icp.Problem([pair, *rows])
    assert problem.solve().solved
    cap.value = [9, 2]
    with pytest.raises(icp.NotSolved, match=r"z <= .*, entry \[1\], is violated by 0.333: .* no other sol"):
        problem.solve()
    assert (problem.status, problem.value, problem.solution.status) == (cp.INFEASIBLE, np.inf, icp.Status.INFEASIBLE)
    assert z.value is None
    found = attempt(problem)
    assert not found.solved
    assert z.value == pytest.approx([5 / 3, 7 / 3])
    assert [one.dual_value for one in rows] == [None, None]
    assert problem.crosscheck(["osqp"]).agrees  # the ICP has an answer
    cap.value = [9, 3]
    assert problem.solve().solved
    assert rows[0].dual_value.tolist() == [0, 0]


def test_a_violated_inequality_proves_nothing_where_there_may_be_other_solutions():
    pair, z = two_answers()
    problem = icp.Problem([pair, z[0] <= 0.9, z[1] >= 0.9])
    z.value = [1.0, 0.0]
    found = attempt(problem)
    assert (problem.status, problem.value, found.status) == (cp.SOLVER_ERROR, None, icp.Status.STAGNATED)
    assert "0.9 <= z[1] is violated by 0.9" in found.message
    assert "the conditions may have another solution" in found.message
    z.value = [0.0, 1.0]
    assert problem.solve().z == pytest.approx([0, 1])
    assert problem.status == cp.OPTIMAL


def test_what_is_large_elsewhere_hides_no_violation():
    """A tolerance for all of z would be larger than this one's inequality; an equality that is tight holds."""
    x, y, low = cp.Variable(), cp.Variable(), cp.Variable(bounds=[0, 0.5])
    large = icp.complements(x - 1e9, x)
    for rows in ([icp.complements(y - 1, y), y <= 0.5], [low == 1]):
        problem = icp.Problem([large, *rows])
        attempt(problem)
        assert problem.status == cp.INFEASIBLE
    assert icp.Problem([large, icp.complements(y - 1, y), y <= 1, y >= 1]).solve().solved


def test_terms_that_cancel_at_the_answer_are_small_beside_their_own_sizes():
    x = cp.Variable(value=1.0)
    for rtol in (1e-8, 1e-14):
        assert icp.Problem([cp.exp(x) == 3 * cp.square(x)]).solve(rtol=rtol).z == pytest.approx([0.91000757248871])


# ---------------------------------------------------------------------------------------------- copies and printing


def test_a_copy_is_a_problem_of_its_own_in_the_same_variables():
    """As CVXPY's is; its expressions cannot be copied deeply, which would end the process, but the ICP can be sent."""
    load, z = cp.Parameter(2, value=[1.0, 3.0]), cp.Variable(2, name="z")
    problem = icp.Problem([icp.complements(A @ z - load, z - 0.1 * cp.exp(-z)), cp.sum(z) >= 0])
    solution = problem.solve()
    there = copy.copy(problem)
    assert there.status is None
    assert there.variables()[0] is z
    load.value = [3.0, 1.0]
    assert there.solve().z == pytest.approx(solution.z[::-1], abs=1e-6)
    assert problem.solution is solution
    for again in (copy.deepcopy, pickle.dumps):
        with pytest.raises(TypeError, match=r"a Problem cannot be; problem.icp\(\) can"):
            again(problem)
    assert pickle.loads(pickle.dumps(problem.icp())).solve().z == pytest.approx(there.solution.z, abs=1e-6)


def test_rtol_may_be_none():
    z = cp.Variable(2)
    problem = icp.Problem([icp.complements(2 * z - [2, -2], z)])
    assert problem.solve(rtol=None).z == pytest.approx([1.0, 0.0])
