"""ψ ≤ z ≤ ψ̄: every method against the enumeration of all choices of rows, and what the second obstacle leaves alone."""

import itertools
import re

import numpy as np
import pytest
import scipy.sparse as sp

import icpmodel as icp
from icpmodel import ICP, Affine, Elementwise, Function, scenes
from icpmodel.methods import names
from icpmodel.solve.solution import Status

#: they say in a sentence that they are made for one obstacle
ONE_SIDED = ("mms",)
TAKE_TWO = [name for name in names() if name not in (*ONE_SIDED, "reduced", "tridiagonal")]


def drawn(seed, n, moves=False):
    """A strictly dominant problem with a positive diagonal and two obstacles, some of them infinite, some equal."""
    rng = np.random.default_rng(seed)
    B = rng.normal(size=(n, n))
    A = B + np.diag(np.abs(B).sum(axis=1) + rng.random(n) + np.abs(np.diag(B)))
    q, c = 3.0 * rng.normal(size=n), rng.normal(size=n)
    d = c + 2.0 * rng.random(n) * (rng.random(n) < 0.8)
    c, d = np.where(rng.random(n) < 0.2, -np.inf, c), np.where(rng.random(n) < 0.2, np.inf, d)
    G = 0.3 * rng.normal(size=(n, n)) / n
    return ICP(A, q, Affine(G, c), upper=Affine(G, d)) if moves else ICP(A, q, c, upper=d)


def enumerated(problem):
    """All solutions where the obstacles are constant or affine: of each row one of three equations."""
    n, found = problem.n, []
    sides = [(problem.dense(), -problem.q)]
    sides += [(np.eye(n) - G.toarray(), c) for G, c in (problem.psi.linear, problem.upper.linear)]
    for choice in itertools.product(range(3), repeat=n):
        M = np.array([sides[side][0][i] for i, side in enumerate(choice)])
        right = np.array([sides[side][1][i] for i, side in enumerate(choice)])
        if np.isfinite(right).all() and problem.residual(z := np.linalg.solve(M, right)) < 1e-9:
            found.append(z)
    return found


@pytest.mark.parametrize("name", [None, *TAKE_TWO])
@pytest.mark.parametrize("moves", [False, True])
def test_every_method_finds_the_one_solution_that_enumeration_finds(name, moves):
    for seed in range(4):
        problem = drawn(seed, 1 + seed, moves)
        (z, *others) = enumerated(problem)
        assert all(np.allclose(other, z) for other in others)
        solution = problem.solve(name)
        np.testing.assert_allclose(solution.z, z, atol=1e-6)
        assert np.abs(solution.z - z).max() <= solution.error_bound + 1e-12


@pytest.mark.parametrize("name", ONE_SIDED)
def test_methods_for_one_obstacle_say_so(name):
    with pytest.raises(icp.NotApplicable, match="obstacle"):
        ICP(np.diag([2.0, 3.0]), [-1.0, 1.0], upper=1.0).solve(name)


@pytest.mark.parametrize("name", TAKE_TWO)
def test_an_obstacle_above_that_is_never_touched_changes_nothing(name):
    problem = scenes.membrane(n=64).problem
    alone, below = problem.solve(name), problem.with_upper(1e3).solve(name)
    np.testing.assert_allclose(below.z, alone.z, atol=1e-6)
    assert below.active_set.above.sum() == 0


@pytest.mark.parametrize("name", [None, *TAKE_TWO])
def test_upside_down_the_problem_has_the_answer_upside_down(name):
    """z ↦ −z turns (A, q, ψ, ψ̄) into (A, −q, −ψ̄, −ψ)."""
    problem = scenes.membrane(n=36).problem
    problem = problem.with_upper(0.3 - problem.r(np.zeros(36)))
    turned = ICP(problem.A, -problem.q, -problem.upper.c, upper=problem.r(np.zeros(36)))
    np.testing.assert_allclose(turned.solve(name).z, -problem.solve(name).z, atol=1e-6)


@pytest.mark.parametrize("name", TAKE_TWO)
def test_without_any_obstacle_the_rows_are_equations(name):
    A = np.array([[4.0, -1.0, 0.0], [-2.0, 4.0, 1.0], [0.0, 1.0, 3.0]])
    q = np.array([1.0, -2.0, 3.0])
    nothing = np.full(3, np.inf)
    np.testing.assert_allclose(ICP(A, q, -nothing, upper=nothing).solve(name).z, np.linalg.solve(A, -q), atol=1e-6)


@pytest.mark.parametrize("name", [None, "mnmgs", "newton", "multilevel", "accelerated"])
def test_obstacles_may_be_any_two_maps(name):
    """z = cos z in every row that touches the upper one, z = sin(z)/2 − 1 in those that touch the lower one."""
    below = Elementwise(lambda z: 0.5 * np.sin(z) - 1.0, lambda z: 0.5 * np.cos(z), lipschitz=0.5)
    above = Function(np.cos, lambda z: sp.diags_array(-np.sin(z)), lipschitz=0.9)
    problem = ICP(np.diag([2.0, 3.0, 2.0]), [-9.0, 9.0, 0.0], below, upper=above)
    z = problem.solve(name).z
    np.testing.assert_allclose(z, [0.7390851332, -1.4987011335, 0.0], atol=1e-6)
    assert problem.residual(z) <= 1e-7


def test_obstacles_that_cross_where_the_run_has_come_to_are_a_status_with_the_row():
    steep = Affine([[0.0, 0.0], [2.0, 0.0]], [0.0, 0.0])  # psi_1 = 2 z_0, and z_0 is to be 1
    problem = ICP(np.eye(2), [-1.0, 0.0], steep, upper=[5.0, 1.0])
    solution = problem.solve(raise_on_failure=False)
    assert solution.status is Status.CROSSED
    assert re.search(r"psi_1 = [\d.]+ is above upper_1 = 1 at this z", solution.message)
    assert not solution.certificate.unique


def test_fixed_obstacles_that_cross_are_found_before_any_method_is_tried():
    """ψ_i = z_i/2 + 1 is an obstacle at 2, whatever z is."""
    half = Elementwise(lambda z: 0.5 * z + 1.0, lambda z: np.full(z.shape, 0.5), lipschitz=0.5)
    solution = ICP(np.eye(3), np.zeros(3), half, upper=[3.0, 1.9, 3.0]).solve(raise_on_failure=False)
    assert solution.status is Status.CROSSED
    assert solution.iterations == 0
    assert "psi_1 = 2 is above upper_1 = 1.9" in solution.message
    assert "psi_1 and upper_1 are fixed, and cross" in solution.why


def test_obstacles_that_cross_everywhere_are_bad_input():
    with pytest.raises(icp.InputError, match=r"cross in row 1: psi has 2 there, upper 1"):
        ICP(np.eye(2), [0.0, 0.0], [0.0, 2.0], upper=1.0)
    for bad, told in ((-np.inf, "upper"), (np.nan, "upper"), ([1.0], "upper"), ("one", "upper")):
        with pytest.raises(icp.InputError, match=told):
            ICP(np.eye(2), [0.0, 0.0], upper=bad)
    with pytest.raises(icp.InputError, match="psi"):
        ICP(np.eye(2), [0.0, 0.0], np.inf)


def test_the_interior_steps_of_the_proximal_method_know_both_sides():
    """A linear program with its dual, z between 0 and 1: no pattern is found by Newton's steps alone."""
    rng = np.random.default_rng(5)
    m, n = 60, 90
    K = sp.random_array((m, n), density=0.1, rng=rng)
    A = sp.csr_array(sp.block_array([[None, -K.T], [K, None]]))
    x, y = rng.random(n), rng.random(m) * (rng.random(m) < 0.5)
    q = np.concatenate([K.T @ y + rng.normal(size=n), -(K @ x) + 0.1])
    upper = np.concatenate([np.ones(n), np.full(m, np.inf)])
    solution = ICP(A, q, upper=upper).solve("proximal")
    assert solution.residual <= solution.tolerance
    assert 0 < (solution.z[:n] > 1.0 - 1e-6).sum() < n


@pytest.mark.parametrize("seed", range(6))
def test_on_a_line_the_direct_pass_and_newtons_steps_find_both_contact_sets(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 400))
    stiff = 1.0 + rng.random(n + 1)
    A = sp.diags_array([-stiff[1:-1], stiff[:-1] + stiff[1:], -stiff[1:-1]], offsets=(-1, 0, 1)).tocsr()
    c = 0.1 * np.cumsum(rng.normal(size=n))
    problem = ICP(A, 0.02 * np.cumsum(rng.normal(size=n)), c, upper=c + rng.random(n))
    solution = problem.solve("tridiagonal")
    np.testing.assert_allclose(solution.z, problem.solve("newton").z, atol=1e-7)


def test_many_problems_at_once_with_two_obstacles_are_those_one_by_one():
    rng = np.random.default_rng(3)
    dense = drawn(7, 6)
    line = 3.0 * np.eye(80) - np.eye(80, k=1) - np.eye(80, k=-1)
    for A, n in ((dense.dense(), 6), (line, 80)):
        Q, C = 3.0 * rng.normal(size=(5, n)), rng.normal(size=(5, n))
        for D in (C + rng.random((5, n)), C[0] + 1.0, np.where(rng.random((5, n)) < 0.5, np.inf, C + 0.5)):
            below = C if np.ndim(D) == 2 else C[0]
            many = icp.solve_many(A, Q, below, upper=D)
            for k in range(5):
                c, d = (one[k] if one.ndim == 2 else one for one in (below, D))
                np.testing.assert_allclose(many.Z[k], ICP(A, Q[k], c, upper=d).solve().z, atol=1e-6)
    G, D = 0.1 * np.eye(6), 1.0 + rng.random((5, 6))
    for psi, upper in ((Affine(G, -1.0), D), (-D, Affine(G, 1.0))):
        many = icp.solve_many(dense.dense(), Q[:, :6], psi, upper=upper)
        for k in range(5):
            c, d = (one[k] if isinstance(one, np.ndarray) else one for one in (psi, upper))
            np.testing.assert_allclose(many.Z[k], ICP(dense.dense(), Q[k, :6], c, upper=d).solve().z, atol=1e-6)
    many = icp.solve_many(dense.dense(), Q[:, :6], Affine(G, -1.0), upper=Affine(G, 1.0))
    for k in range(5):
        alone = ICP(dense.dense(), Q[k, :6], Affine(G, -1.0), upper=Affine(G, 1.0)).solve()
        np.testing.assert_allclose(many.Z[k], alone.z, atol=1e-6)


@pytest.mark.parametrize("name", [None, "mnmj", "newton", "multilevel", "psor"])
def test_the_best_of_some_jumps_may_be_the_obstacle_above(name):
    """Row 0 may not lie above z_1 + 1, the others have nothing above."""
    jumps = sp.csr_array((np.array([1.0]), (np.array([0]), np.array([1]))), shape=(3, 3))
    problem = ICP(2.0 * np.eye(3), [-8.0, -2.0, 2.0], upper=icp.Intervention(jumps, "min"))
    assert problem.upper.value(np.zeros(3)).tolist() == [1.0, np.inf, np.inf]
    np.testing.assert_allclose(problem.solve(name).z, [2.0, 1.0, 0.0], atol=1e-7)
