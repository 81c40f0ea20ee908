"""How much z moves with the data, and the pictures of z."""

import numpy as np
import pytest

import icpmodel as icp
from icpmodel.study.sensitivity import sensitivity

#: these have no condition number
WITHOUT = ("hard-many", "hard-scaled", "hard-singular")


def perturbed(problem, random, eps):
    """The problem with every entry of A, q and an obstacle that has data changed by a factor 1 ± ε."""

    def moved(x):
        return x * (1.0 + eps * random.choice([-1.0, 1.0], np.shape(x)))

    A = problem.A.copy()
    A.data = moved(A.data)
    psi = problem.psi
    if problem.upper is None and psi.linear is not None:
        G, c = psi.linear
        G = G.copy()
        G.data = moved(G.data)
        psi = icp.Affine(G, moved(c))
    return icp.ICP(A, moved(problem.q), psi)


@pytest.mark.parametrize("name", [name for name in icp.scenes.names() if name not in WITHOUT])
def test_random_changes_move_z_by_no_more_than_the_condition_numbers(name):
    """Law: |δz_i| ≤ κ_i·ε·max|z| to first order; where the norm is only estimated, κ may be short by a factor of 3."""
    eps = 1e-6
    random = np.random.default_rng(0)
    scene = icp.scenes.scene(name, 100 if "n" in icp.scenes.parameters(name) else None)
    if scene.why_no_solution is not None or scene.problem.f is not None:
        return
    solution = scene.problem.solve().polish()
    found = sensitivity(solution)
    assert found.local == pytest.approx(found.rows.max()) or not found.exact
    unit = eps * np.abs(solution.z).max()
    for _ in range(3):
        moved = np.abs(perturbed(solution.problem, random, eps).solve(z0=solution.z).polish().z - solution.z) / unit
        if found.exact and not found.undecided:
            assert (moved <= found.rows * 1.001 + 1e-6).all()
        assert moved.max() <= found.local * (1.001 if found.exact else 3.0)
    if found.certified is not None:
        assert found.local <= found.certified * 1.001


def test_the_certificate_knows_the_condition_of_an_equation():
    """z = −q/a without an obstacle near: the proof gives 2 as well, up to rounding."""
    assert sensitivity(icp.ICP([[3.0]], [-6.0]).solve()).certified == pytest.approx(2.0, rel=1e-6)
    assert sensitivity(icp.scenes.hard_many().problem.solve()).certified is None


def test_rows_of_fixed_unknowns_do_not_weaken_the_certificate():
    """Where ψ_i = ψ̄_i row i of A has no influence on z: with any row there κ is certified, and not exceeded."""
    problem = icp.ICP([[2.0, -1.0, 0.0], [-1.0, 2.0, 5.0], [3.0, -7.0, 0.0]], [-1.0, -1.0, 2.0], 0.0, [9.0, 9.0, 0.0])
    found = sensitivity(problem.solve())
    assert found.local == pytest.approx(4.0)
    assert found.local <= found.certified <= 3.0 * found.local * 1.001


def test_the_certificate_includes_the_slope_of_a_nonlinear_p():
    """2z − 1 − 1.9z = 0: a change of 2 by 2ε and of 1 by ε moves z = 10 by 210ε, κ = 21."""
    f = icp.Elementwise(lambda z: -1.9 * z, lambda z: -1.9 + 0.0 * z, slope_range=(-1.9, -1.9))
    assert sensitivity(icp.ICP([[2.0]], [-1.0], f=f).solve()).certified == pytest.approx(21.0, rel=1e-6)


def test_the_worst_signs_reach_the_condition_number():
    """|J⁻¹|E is attained: for an M-matrix and q < 0, a_ij + ε|a_ij| off … the signs are those of J⁻¹ row by row."""
    A, q, eps = np.array([[1.0, -0.9], [-0.9, 1.0]]), np.array([-1.0, -1.0]), 1e-7
    solution = icp.ICP(A, q).solve()
    worst = icp.ICP(A - eps * np.abs(A), q * (1 + eps)).solve(rtol=1e-15)
    moved = np.abs(worst.z - 10.0).max() / (10.0 * eps)
    assert moved == pytest.approx(sensitivity(solution).local, rel=1e-4)


def test_the_condition_numbers_are_the_same_in_all_units():
    A, q = np.array([[1.0, -0.9], [-0.9, 1.0]]), np.array([-1.0, 0.5])
    one, other = (sensitivity(icp.ICP(A, s * q).solve()) for s in (1.0, 2.0**300))
    assert one.local == pytest.approx(other.local)
    assert one.rows == pytest.approx(other.rows)


def test_an_estimate_agrees_with_the_exact_number():
    small, large = (sensitivity(icp.scenes.bai_symmetric(n=n).problem.solve()) for n in (484, 529))
    assert small.exact
    assert not large.exact
    assert large.local == pytest.approx(small.local, rel=0.5)


def test_what_is_not_known_is_reported():
    with pytest.raises(icp.InputError, match="not solved"):
        sensitivity(icp.scenes.hard_jump().problem.solve(raise_on_failure=False))
    with pytest.raises(icp.InputError, match="z = 0"):
        sensitivity(icp.ICP([[1.0]], [1.0]).solve())
    many = sensitivity(icp.scenes.hard_many().problem.solve())
    assert many.local is None
    assert "singular" in str(many)


@pytest.mark.parametrize("name", ["bearing", "hand-free"])
def test_a_picture_shows_z_and_p_at_their_places(name):
    scene = icp.scenes.scene(name)
    solution = scene.problem.solve()
    axes = icp.study.figure(solution, scene.points).axes
    x = np.arange(scene.problem.n) if scene.points is None else scene.points
    drawn = axes[0].lines[1]
    assert np.array_equal(drawn.get_xdata(), x)
    assert np.array_equal(drawn.get_ydata(), solution.z)
    in_p, _ = scene.problem.rounding(solution.z)
    assert (np.abs(axes[1].lines[0].get_ydata() - solution.p) <= in_p).all()


def test_equations_that_are_singular_but_for_rounding_give_no_condition_number():
    B = np.random.default_rng(80).normal(size=(80, 79))
    solution = icp.ICP(B @ B.T, -B @ (B.T @ np.ones(80)), psi=-10.0).solve(z0=np.ones(80))
    assert sensitivity(solution).local is None


def test_each_row_changes_with_the_obstacle_that_it_is_at():
    solution = icp.ICP(np.eye(2), [1.0, -5.0], psi=[1.0, 0.0], upper=[1000.0, 10.0]).solve()
    assert icp.study.sensitivity(solution).rows == pytest.approx([0.2, 2.0])


def test_what_is_proved_of_a_tangent_problem_alone_certifies_nothing():
    """p = (z - 1)² + 1e-9 is nowhere 0, and the tangent problem at 1 has one solution."""
    force = icp.Elementwise(lambda z: z**2, lambda z: 2 * z)
    problem = icp.ICP([[-2.0]], [1 + 1e-9], psi=-np.inf, f=force)
    assert icp.study.sensitivity(problem.solve(z0=[3.0], rtol=1e-3)).certified is None
