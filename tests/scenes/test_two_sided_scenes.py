"""Scenes with two obstacles against references that share no code with them."""

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from known_answers import SEEDS
from scipy.sparse.linalg import splu
from test_scene_references import errors_on_grids, newton, order

import icpmodel as icp
import icpmodel.scenes as scenes
from icpmodel.scenes import options, plasticity

# --- exact solutions of the discrete problem


@settings(max_examples=25)
@given(
    seed=SEEDS,
    mu=st.floats(0, 50),
    m=st.integers(1, 9),
    skew=st.floats(-1, 1),
    coupling=st.sampled_from([0.0, 0.5, 0.95]),
)
def test_a_manufactured_solution_between_two_obstacles_has_every_kind_of_row_and_is_found(seed, mu, m, skew, coupling):
    scene = scenes.box_manufactured(n=m * m, mu=mu, skew=skew, coupling=coupling, seed=seed)
    problem, z = scene.problem, scene.z_exact
    tiny = 1e-14 * (10 + mu)
    p, r, s = problem.p(z), problem.r(z), -problem.r_upper(z)
    below, above = np.abs(r) <= tiny, np.abs(s) <= tiny
    assert (p[below] >= 0.5 - tiny).all()
    assert (p[above] <= tiny - 0.5).all()
    assert (np.abs(p[~below & ~above]) <= tiny).all()
    assert min(r[~below].min(initial=1), s[~above].min(initial=1)) >= 0.5 - tiny
    kinds = np.unique(below + 2 * above + 4 * np.isinf(r) + 8 * np.isinf(s), return_counts=True)[1]
    assert len(kinds) == min(6, m * m)
    assert kinds.max() <= kinds.min() + 1
    assert np.abs(newton(problem) - z).max() <= 1e-11


def test_three_walls_have_three_solutions_and_whichever_is_found_is_not_called_unique():
    scene = scenes.hard_three()
    found = [z for z in np.linspace(-1.0, 1.0, 801) if scene.problem.residual(np.array([z])) == 0.0]
    assert found == [-1.0, -0.25, 1.0]
    assert [scene.errors([z])["(z + 1)(z + 1/4)(z - 1)"] for z in found] == [0.0, 0.0, 0.0]
    solution = scene.problem.solve()
    assert solution.solved
    assert not solution.certificate.bound.unique
    assert solution.error_bound is None


def test_where_the_obstacles_cross_no_z_has_a_small_residual_and_the_status_names_the_row():
    problem = scenes.hard_crossing().problem
    grid = np.linspace(-0.5, 2.5, 61)
    assert min(problem.residual(np.array([x, y])) for x in grid for y in grid) >= 0.04
    assert problem.solve(raise_on_failure=False).status is icp.Status.INFEASIBLE
    solution = problem.solve("psor", raise_on_failure=False)
    assert solution.status is icp.Status.CROSSED
    assert "psi_0 = " in solution.message
    stopped = problem.solve("psor", max_iter=2, raise_on_failure=False)
    assert stopped.status is icp.Status.ITERATION_LIMIT
    assert "psi_0 = " in stopped.message


# --- the game between holder and writer


def test_the_value_of_the_cancellable_put_is_that_of_the_game_on_a_lattice():
    """V ↦ min(second payoff, max(first payoff, discounted mean of V up and down)), from below and from above, on a
    lattice that has no exact solution in common with the scene; at s = 1 the writer cancels, so that what lies beyond
    has no influence up to there."""
    step = 0.02
    y = np.arange(-1.0, 1.0 + step / 2, step)
    years = (step / options.VOLATILITY) ** 2
    up = 0.5 + (options.INTEREST - 0.5 * options.VOLATILITY**2) * step / (2 * options.VOLATILITY**2)
    first = np.maximum(1.0 - np.exp(y), 0.0)
    second = first + 0.05
    V, discount = np.vstack([first, second]), np.exp(-options.INTEREST * years)
    V[:, 0] = first[0]
    for _ in range(5000):
        held = discount * (up * V[:, 2:] + (1.0 - up) * V[:, :-2])
        V[:, 1:-1] = np.minimum(second[1:-1], np.maximum(first[1:-1], held))
    to_strike = y <= 1e-12
    value, k = options.game_put_value(0.05)
    np.testing.assert_allclose(V[0, to_strike], V[1, to_strike], atol=1e-9)
    np.testing.assert_allclose(V[0, to_strike], value(np.exp(y[to_strike])), atol=2e-4)
    exercised = np.exp(y[to_strike & (V[0] == first)])
    assert abs(np.log(exercised.max() / k)) <= step


def test_the_cancellable_put_is_of_second_order_and_cancelled_in_one_row():
    h, error = errors_on_grids("game-put", [33, 51, 81, 131])
    assert (error["V"] <= 0.12 * h**2).all(), error
    assert (error["k"] <= 0.34 * h**2).all(), error
    for delta in (0.05, 0.1, 0.4):
        scene = scenes.game_put(n=101, delta=delta)
        above = -scene.problem.r_upper(newton(scene.problem))
        assert (above == 0.0).sum() == (delta < 0.2)
        assert above.argmin() == 50


# --- two phases


def test_the_interface_is_of_second_order_and_has_the_tension_of_the_theory():
    h, error = errors_on_grids("phase-step", [33, 51, 81, 131, 201, 301, 501])
    assert (error["u"] <= 3.1 * h**2).all(), error
    assert ((error["energy"] >= 1.5 * h**2) & (error["energy"] <= 1.8 * h**2)).all(), error
    assert order(h, error["energy"]) == pytest.approx(2.0, abs=0.05)


# --- torsion


def torque(cells):
    """That of a quarter of the bar, mirrored at its middle lines, by an active set of its own."""
    m, h = cells // 2, 1 / cells
    weight = np.ones(m)
    weight[-1] = 0.5
    beside = -np.ones(m - 1)
    line = sp.diags_array([beside, 2 * weight, beside], offsets=(-1, 0, 1))
    W = sp.diags_array(weight)
    A, w = sp.csc_array(sp.kron(line, W) + sp.kron(W, line)), np.kron(weight, weight)
    x = np.arange(1, m + 1) * h
    distance, load = np.minimum(x[:, None], x).ravel(), 5.0 * h * h * w
    plastic = np.zeros(m * m, dtype=bool)
    while True:
        u, rest = np.where(plastic, distance, 0.0), np.flatnonzero(~plastic)
        u[rest] = splu(A[rest][:, rest]).solve((load - A @ u)[rest])
        now = np.where(plastic, A @ u <= load, u > distance)
        if (now == plastic).all():
            return 8.0 * h**2 * float(w @ u)
        plastic = now


def test_the_torque_is_that_of_another_code_extrapolated():
    cells = np.array([40, 48, 56, 64, 72, 80, 96])
    found = np.array([torque(n) for n in cells])
    weights = cells.astype(float) ** 2
    (limit, factor), *_ = np.linalg.lstsq(np.c_[weights, np.ones(cells.size)], found * weights, rcond=None)
    assert limit == pytest.approx(plasticity.TORQUE, abs=1e-5)
    assert -0.57 <= factor <= -0.46


def test_the_torsion_is_of_second_order_and_yields_first_in_the_middle_of_the_sides():
    h, error = errors_on_grids("torsion", [81, 144, 225, 441, 1024, 1600])
    assert ((error["torque"] >= 0.46 * h**2) & (error["torque"] <= 0.57 * h**2)).all(), error
    scene = scenes.torsion(n=39**2)
    z = newton(scene.problem).reshape(39, 39)
    plastic = (scene.problem.r_upper(z.ravel()) == 0.0).reshape(39, 39)
    assert plastic[0, 19]
    assert not plastic[0, 0]
    assert not plastic[19, 19]
    for mirrored in (z.T, z[::-1], z[:, ::-1]):
        np.testing.assert_allclose(mirrored, z, atol=1e-13)
    back = scene.problem.with_q(-scene.problem.q)
    np.testing.assert_allclose(newton(back), -z.ravel(), atol=1e-13)
