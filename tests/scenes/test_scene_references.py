"""Each scene against its reference: solved by an oracle that shares no code with the package's methods."""

import numpy as np
import pytest
import scipy.sparse as sp
from exact import ExactProblem
from hypothesis import given, settings
from hypothesis import strategies as st
from known_answers import SEEDS
from scipy.sparse.linalg import splu, spsolve

import icpmodel.scenes as scenes
from icpmodel.problem.affine import Affine

WITH_Z = [name for name in scenes.names() if scenes.scene(name).z_exact is not None]
#: the oracle is too simple a method for the others
TAME = [name for name in WITH_Z if not name.startswith("hard") and scenes.scene(name).problem.f is None]


def newton(problem, z=None, steps=300):
    """Primal-dual active set: rows with z - upper <= p < r take the row of A, the others that of I - psi'(z)."""
    z = np.zeros(problem.n) if z is None else z
    eye = sp.eye_array(problem.n)
    for _ in range(steps):
        p, r = problem.p(z), problem.r(z)
        balance, top, slopes = (p < r) * 1.0, np.zeros(problem.n), problem.psi.jacobian(z)
        F = np.minimum(p, r)
        if problem.upper is not None:  # p in the units of z, or a row leaps from one obstacle to the other
            above, D = problem.r_upper(z), problem.A.diagonal()
            balance, top, F = (p < D * r) * 1.0, (p < D * above) * 1.0, np.maximum(np.minimum(p / D, r), above)
            balance = (balance - top) / D
            slopes = sp.diags_array(1 - top) @ slopes + sp.diags_array(top) @ problem.upper.jacobian(z)
        J = sp.diags_array(balance) @ problem.A + sp.diags_array((balance == 0) * 1.0) @ (eye - slopes)
        step = spsolve(sp.csc_array(J), F)
        z = z - step
        if np.abs(step).max() <= 1e-12 * max(1.0, np.abs(z).max()):
            return z
    raise AssertionError("the oracle did not converge")


def errors_on_grids(name, sizes):
    """(h, {quantity: errors}) over the grids."""
    built = [scenes.scene(name, n) for n in sizes]
    rows = [scene.errors(newton(scene.problem)) for scene in built]
    return np.array([scene.h for scene in built]), {key: np.array([row[key] for row in rows]) for key in rows[0]}


def order(h, error):
    return np.polyfit(np.log(h), np.log(error), 1)[0]


# --- exact solutions of the discrete problem


@pytest.mark.parametrize("name", WITH_Z)
def test_z_exact_is_complementary_to_rounding(name):
    """The median of z − ψ̄, p and r is 0 in every row, up to the rounding errors of computing them at z*."""
    scene = scenes.scene(name)
    problem, z = scene.problem, scene.z_exact
    rounding_p, rounding_r = problem.rounding(z)
    slack_p, slack_r = problem.p(z) / np.maximum(rounding_p, 1e-300), problem.r(z) / np.maximum(rounding_r, 1e-300)
    above = (
        np.full(problem.n, -np.inf) if problem.upper is None else problem.r_upper(z) / np.maximum(rounding_r, 1e-300)
    )
    assert (np.abs(np.median([above, slack_p, slack_r], axis=0)) <= 1.0).all()


def test_what_has_no_solution_has_none_where_psi_has_values():
    """hard-infeasible: a row of p is −z − 1; hard-jump: residual ≥ ¼; hard-domain: A⁻¹ ≥ 0, A⁻¹q < −2."""
    infeasible, jump, domain = (scenes.scene("hard-" + name).problem for name in ("infeasible", "jump", "domain"))
    assert infeasible.A.toarray()[1].tolist() == [-1.0, 0.0]
    assert infeasible.q[1] == -1.0
    assert min(jump.residual(np.array([z])) for z in np.linspace(-5.0, 5.0, 2001)) >= 0.25
    inverse = np.linalg.inv(domain.A.toarray())
    assert (inverse > 0).all()
    lowest = -inverse @ domain.q
    assert lowest == pytest.approx([0.05 * i * (32 - i) for i in range(1, 32)])
    assert np.isnan(domain.psi.value(lowest)).any()


@pytest.mark.parametrize("t", [0.0, 1.0, 50.0])
def test_many_and_steep_have_the_solutions_that_they_name(t):
    many, steep = scenes.hard_many(), scenes.hard_steep()
    z = np.array([t, t + 1.0])
    assert many.problem.residual(z) == many.errors(z)["z2 - z1"] == 0.0
    for z in ([-1.0], [2.0]):
        assert steep.problem.residual(np.array(z)) == steep.errors(np.array(z))["|z - 1/2|"] == 0.0


@pytest.mark.parametrize("name", TAME)
@pytest.mark.parametrize("n", [None, 49, 2500])
def test_the_oracle_finds_z_exact(name, n):
    scene = scenes.scene(name, n if "n" in scenes.parameters(name) else None)
    assert scene.problem.residual(scene.z_exact) <= 1e-15 * (10 + 10 * scene.problem.n)
    errors = scene.errors(newton(scene.problem))
    assert max(errors.values()) <= 1e-13, errors


@pytest.mark.parametrize("name", [name for name in scenes.names() if name.startswith("hand")])
def test_by_hand_trying_every_set_of_rows_finds_this_solution_and_no_other(name):
    scene = scenes.scene(name)
    found = ExactProblem(scene.problem).zeros()
    assert found.complete
    assert found.solutions
    for z in found.solutions:
        np.testing.assert_allclose(np.array(z, dtype=float), scene.z_exact, rtol=0, atol=1e-15)


def test_hand_cyclic_sends_newton_in_a_circle_of_three():
    scene = scenes.hand_cyclic()
    A, q, z = scene.problem.A.toarray(), scene.problem.q, scene.z0
    seen = []
    for _ in range(6):
        z = np.linalg.solve(np.where((A @ z + q < z)[:, None], A, np.eye(3)), np.where(A @ z + q < z, -q, 0.0))
        assert scene.problem.paper_residual(z) == pytest.approx(np.sqrt(10))
        seen.append(z)
    np.testing.assert_allclose(seen[3:], seen[:3], atol=1e-15)
    assert not np.allclose(seen[0], seen[1])


@settings(max_examples=30)
@given(seed=SEEDS, mu=st.floats(0, 50), m=st.integers(1, 9), kind=st.sampled_from(["affine", "elementwise"]))
def test_a_manufactured_solution_is_complementary_to_rounding_and_found(seed, mu, m, kind):
    scene = scenes.scene(f"manufactured-{kind}", m * m, mu=mu, seed=seed)
    z, problem = scene.z_exact, scene.problem
    p, r = problem.p(z), problem.r(z)
    tiny = 1e-14 * (10 + mu)
    assert np.abs(np.minimum(p, r)).max() <= tiny
    assert np.maximum(p, r).min() >= 0.5 - tiny
    assert (r < p).sum() == m * m // 2
    assert np.abs(newton(problem) - z).max() <= 1e-12


@pytest.mark.parametrize(
    ("name", "mu", "counts"),
    [("bai-symmetric", 0, (142, 493)), ("bai-symmetric", 4, (36, 39)), ("bai-nonsymmetric", 0, (45, 67))],
)
def test_bai_gives_the_known_step_counts_of_the_modulus_gauss_seidel_method(name, mu, counts):
    # gamma = 2, Omega = D/2, m = 10 and 20: pins A, q and z0 at once
    for m, count in zip((10, 20), counts, strict=True):
        scene = scenes.scene(name, m * m, mu=mu)
        A, z, k = scene.problem.A, scene.z0, 0
        M, omega = sp.tril(A), sp.diags_array(A.diagonal() / 2)
        X, x = splu(sp.csc_array(M + omega), permc_spec="NATURAL"), scene.z0
        while scene.problem.paper_residual(z) > 1e-5:
            x = X.solve((M - A) @ x + (omega - A) @ np.abs(x) - 2 * scene.problem.q)
            z, k = (np.abs(x) + x) / 2, k + 1
        assert k == count


# --- contact


@pytest.mark.parametrize("n", [100, 900, 2500])
def test_the_membrane_touches_in_a_disc_and_has_the_symmetries_of_the_square(n):
    problem = scenes.membrane(n=n).problem
    assert (problem.A != problem.A.T).nnz == 0
    z = newton(problem)
    touches = problem.r(z) < problem.p(z)
    grid = z.reshape(round(n**0.5), -1)
    assert 0.005 * n < touches.sum() < 0.3 * n
    for mirrored in (grid.T, grid[::-1], grid[:, ::-1]):
        np.testing.assert_allclose(mirrored, grid, atol=1e-13)
    assert (z > 0).all()
    distance = ((scenes.membrane(n=n).points - 0.5) ** 2).sum(axis=1)
    assert distance[touches].max() <= distance[~touches].min() + 3 / n**0.5


def test_the_ball_is_of_second_order():
    h, error = errors_on_grids("ball", [15**2, 25**2, 40**2, 63**2, 100**2])
    assert (error["u"] <= 0.4 * h**2).all(), error
    assert (error["contact radius"] <= 0.07 * h**2).all(), error
    assert order(h, error["u"]) > 1.7
    assert order(h, error["contact radius"]) > 1.7


def test_the_obstacle_in_space_is_of_second_order_and_touches_in_a_sphere():
    h, error = errors_on_grids("obstacle-3d", [5**3, 8**3, 12**3, 17**3])
    assert (error["u"] <= 0.78 * h**2).all(), error
    scene = scenes.obstacle_3d(n=12**3)
    z = newton(scene.problem)
    axis = np.linspace(-1, 1, 14)[1:-1]
    r = np.sqrt((np.stack(np.meshgrid(axis, axis, axis)) ** 2).sum(axis=0)).ravel()
    touches = scene.problem.r(z) < scene.problem.p(z)
    assert r[touches].max() <= 0.5 + scene.h
    assert r[~touches].min() >= 0.5 - scene.h


# --- lubrication


def test_the_bearing_is_of_second_order():
    h, error = errors_on_grids("bearing", [25, 50, 100, 200, 400, 800])
    assert (error["p_max"] <= 0.08 * h**2).all(), error
    assert (error["cavitation angle"] <= 0.015 * h**2).all(), error
    assert 1.8 < order(h, error["p_max"]) < 2.2
    scene = scenes.bearing(n=400)
    z, beyond = newton(scene.problem), scene.points - scene.quantities["cavitation angle"].exact
    assert (z[beyond < -scene.h] > 0).all()
    assert (z[beyond > scene.h] == 0).all()


# --- impulse control


def test_the_dividend_is_of_second_order_on_three_grids():
    h, error = errors_on_grids("dividend", [121, 241, 481])
    for name in ("V(1)", "x*", "target"):
        assert 1.8 < order(h, error[name]) < 2.25, (name, error[name])


# --- friction


@given(alpha=st.floats(0, 89), mu=st.floats(0, 3), mass=st.floats(0.1, 50), dt=st.floats(1e-3, 1))
def test_the_block_slips_exactly_if_the_slope_is_steeper_than_the_friction(alpha, mu, mass, dt):
    scene = scenes.coulomb(alpha=alpha, mu=mu, mass=mass, dt=dt)
    z, speed = newton(scene.problem), scene.quantities["slip speed"]
    margin = np.tan(np.deg2rad(alpha)) - mu
    if abs(margin) > 1e-9:
        assert (speed.exact > 0) is bool(margin > 0)
    np.testing.assert_allclose(z, scene.z_exact, atol=1e-12 * mass)
    assert scene.problem.p(z)[1] == pytest.approx(speed.exact, abs=1e-12)
    assert z[0] > 0
    assert 1e-12 * mass >= z[1] >= -mu * z[0] - 1e-12 * mass
    assert isinstance(scene.problem.psi, Affine)


def test_bratu_has_three_solutions_and_beyond_the_fold_the_one_at_the_ceiling():
    scene = scenes.bratu()
    tops = []
    for start in (np.zeros(100), 4.0 * np.sin(np.pi * scene.points), np.full(100, 5.0)):
        # from above sweeps go down to the largest solution, row by row
        z = scene.problem.solve("psor" if start.min() == 5.0 else None, z0=start).z
        assert scene.errors(z)["top"] < 1e-3
        tops.append(z.max())
    np.testing.assert_allclose(sorted(tops), [0.1405, 4.09, 5.0], rtol=1e-3)
    beyond = scenes.bratu(heat=4.0)
    assert beyond.problem.solve(z0=np.full(100, 5.0)).z.max() == 5.0
