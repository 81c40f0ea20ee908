"""The interior method: monotone problems with one obstacle or two, fixed or moving; proofs; and what is redundant."""

from functools import partial

import numpy as np
import pytest
import scipy.sparse as sp
from benchmarks.families import drawn
from hypothesis import given, settings
from known_answers import GENERATORS, attempt

import icpmodel as icp
from icpmodel import Status
from icpmodel.algebra.subproblems import without_redundant_rows


def run(problem, **options):
    return attempt(problem, "interior", **options)


def shortest_path(rng, n):
    """A path of n arcs and back: the residual creeps for 35 steps, while s comes to p in all of them."""
    low, arcs = np.arange(n), np.arange(2 * n)
    start, end = np.concatenate([low, low + 1]), np.concatenate([low + 1, low])
    B = sp.csr_array((np.repeat([-1.0, 1.0], 2 * n), (np.concatenate([start, end]), np.tile(arcs, 2))))
    demand = np.zeros(n + 1)
    demand[[0, -1]] = -1.0, 1.0
    return icp.ICP(sp.block_array([[None, -B.T], [B, None]]), np.append(rng.uniform(1.0, 3.0, 2 * n), -demand))


def dependent_equations(rng, n):
    """Equations without a diagonal of their own, one of them twice."""
    B = rng.integers(-3, 4, (n, 2 * n)).astype(float)
    B[0] = B[-1]
    A = np.block([[np.zeros((2 * n, 2 * n)), -B.T], [B, np.zeros((n, n))]])
    q = np.append(rng.random(2 * n) + 1.0, -B @ rng.random(2 * n))
    return icp.ICP(A, q, np.repeat([0.0, -np.inf], [2 * n, n]))


CASES = {
    **{
        family: partial(drawn, family, n)
        for family, n in {"contact-pile": 300, "contact-redundant": 400, "program-regression": 900}.items()
    },
    "path": lambda rng: shortest_path(rng, 1000),
    "dependent": lambda rng: dependent_equations(rng, 8),
}


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("name", CASES)
def test_semidefinite_problems_take_few_steps(name, seed):
    solution = run(CASES[name](np.random.default_rng(seed)))
    assert solution.solved
    assert solution.iterations <= 60


def test_equations_of_a_linear_program_move_the_start():
    """At z = 0 p > 0 in the row without obstacle: that is no solution."""
    answer = icp.ICP([[0, 1], [-1, 0]], [1, 2], psi=[0, -np.inf]).solve("interior")
    assert answer.z == pytest.approx([2, -1])


def convex_regression(values):
    """min ½‖x − values‖² over all convex x: its multipliers are as large as n² in the units of x."""
    n = values.size
    B = sp.diags_array([np.full(n - 2, d) for d in (1.0, -2.0, 1.0)], offsets=range(3), shape=(n - 2, n))
    A = sp.block_array([[sp.eye_array(n), -B.T], [B, None]])
    return icp.ICP(A, np.append(-values, np.zeros(n - 2)), np.repeat([-np.inf, 0.0], [n, n - 2]))


def test_steps_from_a_start_near_the_obstacle_are_long():
    """The nearest convex function to a concave one is the line of least squares."""
    t = np.linspace(0.0, 1.0, 1000)
    values = np.sin(np.pi * t)
    solution = run(convex_regression(values))
    assert solution.solved
    assert solution.iterations < 20
    line = np.polynomial.Polynomial.fit(t, values, 1)(t)
    assert solution.polish().z[:1000] == pytest.approx(line, abs=1e-8)


def test_a_short_step_of_the_multipliers_does_not_shorten_that_of_the_unknowns():
    """With one length for both it takes 58 steps, in 40 of which neither residual falls by a tenth."""
    t = np.linspace(0.0, 1.0, 6000)
    solution = run(convex_regression(np.sin(np.pi * t) + 0.1 * np.sin(np.arange(1, 6001))))
    assert solution.solved
    assert solution.iterations < 40


@pytest.mark.parametrize("seed", range(4))
def test_one_multiplier_for_many_bounded_unknowns_takes_few_steps(seed):
    """min qᵀx with 0 ≤ x ≤ 1 and a weighted sum of 30: few of 4000 are not 0, which a predictor far off makes grow."""
    rng = np.random.default_rng(seed)
    n = 4000
    weights = sp.csr_array(rng.uniform(0.5, 2.0, (1, n)))
    A = sp.block_array([[sp.csr_array((n, n)), weights.T], [-weights, None]])
    low = np.append(np.zeros(n), -np.inf)
    solution = run(icp.ICP(A, np.append(rng.normal(size=n), 30.0), low, upper=np.append(np.ones(n), np.inf)))
    assert solution.solved
    assert solution.iterations < 55


@pytest.mark.parametrize("seed", range(20))
def test_linear_programs_with_fixed_unknowns_are_solved_up_to_rounding(seed):
    """min cᵀx with Bx = b, rows in units from 1e-3 to 1e3, and x ≥ 0, a third of them fixed: these have no interior."""
    rng = np.random.default_rng(seed)
    n, m = 40, 25
    B = rng.integers(-3, 4, (m, n)) * 10.0 ** rng.integers(-3, 4, (m, 1))
    x = rng.random(n) * (rng.random(n) < 0.5)
    fixed = rng.random(n) < 0.3
    c = B.T @ rng.normal(size=m) + rng.random(n) * (x == 0)
    low = np.append(np.where(fixed, x, 0.0), np.full(m, -np.inf))
    upper = np.append(np.where(fixed, x, np.inf), np.full(m, np.inf))
    A = np.block([[np.zeros((n, n)), -B.T], [B, np.zeros((m, m))]])
    assert run(icp.ICP(A, np.append(c, -B @ x), low, upper=upper), rtol=1e-14).solved


def test_equations_alone_are_solved_by_newton_steps():
    """Nothing is bounded: there is no longest step and no complementarity to measure."""
    B = np.array([[7e3, 1.0, 2.0], [-2e4, 3.0, 1.0], [1.5e4, 1.0, 0.0]])
    assert run(icp.ICP(B @ B.T, [-0.36, 0.21, 0.96], -np.inf)).solved


@pytest.mark.parametrize("method", ["interior", "proximal", None])
@pytest.mark.parametrize("boxed", [False, True])
def test_what_has_no_solution_ends_with_a_proof(method, boxed):
    """x ≥ 0 with eᵀx ≤ −1, in a program and its dual; with an upper bound on x the proof takes it into account."""
    rng = np.random.default_rng(1)
    B = np.vstack([rng.integers(-2, 3, (30, 40)), np.full(40, -1.0)])
    A = sp.block_array([[None, -sp.csr_array(B).T], [sp.csr_array(B), None]])
    q = np.concatenate([rng.random(40), rng.random(30), [-1.0]])
    upper = np.append(np.full(40, 5.0), np.full(31, np.inf)) if boxed else None
    solution = attempt(icp.ICP(A, q, upper=upper), method)
    assert solution.status is Status.INFEASIBLE
    y = np.array([float(x) for x in solution.infeasible.witness])
    columns = A.T @ y
    assert (y >= 0).all()
    assert q @ y + 5.0 * np.maximum(columns[:40], 0.0).sum() * boxed < 0


def infeasible_beside(kind, size, seed):
    """x ≥ 0 with Bx ≥ b and eᵀx ≤ −1, beside every fourth x fixed at `size`, or unknowns that equations fix there."""
    rng = np.random.default_rng(seed)
    n = 40
    B = np.vstack([rng.integers(-2, 3, (30, n)), np.full(n, -1.0)])
    p = np.concatenate([rng.random(n), rng.random(30), [-1.0]])
    A = np.block([[np.zeros((n, n)), -B.T], [B, np.zeros((31, 31))]])
    if kind == "fixed":
        i = np.arange(n + 31)
        fixed = (i % 4 == 0) & (i < n)
        shift = A[:, fixed].sum(axis=1) * size
        return icp.ICP(A, p - shift, np.where(fixed, size, 0.0), upper=np.where(fixed, size, np.inf))
    E = np.eye(8) + 0.1 * rng.normal(size=(8, 8))
    equations = sp.block_array([[None, -E.T], [E, None]])
    q = np.concatenate([p, np.zeros(8), -size * rng.random(8)])
    return icp.ICP(sp.block_diag([A, equations]), q, np.repeat([0.0, -np.inf], [n + 31, 16]))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", ["fixed", "equations"])
def test_what_stays_bounded_does_not_delay_a_proof(kind, seed):
    """Where it is 1e6 times as large as what grows, the direction from the first iterate has none of it."""
    solution = run(infeasible_beside(kind, 1e6, seed))
    assert solution.status is Status.INFEASIBLE
    assert solution.iterations < 30


def test_a_proof_says_which_values_of_redundant_unknowns_it_rests_on():
    """z = (1, 0) has p ≥ 0 and z ≥ 0, but p_0 = 1 > 0 makes z_0 = 0, and then p_1 = −1."""
    problem = icp.ICP([[0, 0], [1, 0]], [1, -1])
    for method in (None, "interior"):
        solution = attempt(problem, method)
        assert "no z has" not in solution.message
        assert "no z with" not in solution.message
    assert "proved values of other unknowns" in attempt(problem).message


def test_what_an_unknown_is_fixed_at_does_not_move_the_start():
    """The start is as far from the obstacle as unknowns are large: those that are fixed are not counted."""
    problem = dependent_equations(np.random.default_rng(1), 8)
    A = sp.block_diag([problem.A, [[1.0]]])
    low = np.append(problem.psi.value(np.zeros(problem.n)), 1e12)
    beside = icp.ICP(A, np.append(problem.q, 0.0), low, upper=np.append(np.full(problem.n, np.inf), 1e12))
    assert run(beside, atol=1e-8, rtol=0.0).iterations <= run(problem, atol=1e-8, rtol=0.0).iterations + 1


def test_a_fixed_unknown_whose_terms_overflow_is_no_error():
    problem = icp.ICP([[2.0, 1e300], [1e300, 2.0]], [1.0, 1.0], [-np.inf, 1e200], upper=[np.inf, 1e200])
    for method in (None, "interior"):
        assert attempt(problem, method).status is not Status.SOLVED


@settings(max_examples=100)
@given(GENERATORS)
def test_what_redundant_rows_are_left_out_changes_no_solution(rng):
    """Fixed unknowns, and empty rows, in a program with its multipliers that has repeated rows."""
    n, m = int(rng.integers(1, 6)), int(rng.integers(1, 6))
    P, G = np.diag(rng.integers(0, 3, n)).astype(float), rng.integers(-2, 3, (m, n)).astype(float)
    rows = rng.integers(0, m, m)
    G = np.vstack([G, rng.integers(1, 4, (m, 1)) * G[rows], np.zeros((1, n))])
    x = rng.integers(-2, 3, n).astype(float)
    slack = rng.integers(0, 2, 2 * m + 1).astype(float)
    A = np.block([[P, G.T], [-G, np.zeros((2 * m + 1, 2 * m + 1))]])
    q = np.append(rng.integers(-2, 3, n), G @ x + slack)
    low = np.append(x - rng.integers(0, 2, n), np.where(rng.random(2 * m + 1) < 0.3, -np.inf, 0.0))
    upper = np.append(x + rng.integers(0, 2, n), np.full(2 * m + 1, np.inf))
    problem = icp.ICP(A, q, low, upper=upper)
    smaller = icp.solve(without_redundant_rows(problem), "proximal", raise_on_failure=False)
    whole = attempt(problem, "proximal")
    assert not whole.solved or smaller.solved
    assert not smaller.solved or problem.residual(smaller.z) <= 1e-6 * max(problem.residual_at_0(), 1.0)
