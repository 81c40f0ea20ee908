"""The theorems as printed and their counterexamples, as data: what the page says, what is true, and what a run does."""

import itertools

import numpy as np
import pytest
from known_answers import attempt

import icpmodel as icp
from icpmodel.theory import check, check_all, proximal_point

BY_NORM = ("4.3", "4.4", "4.2", "4.1", "sharper")


def iterate(method, problem, z, steps):
    path = method.iterates(problem, np.asarray(z, dtype=float))
    return [next(path)[0] for _ in range(steps + 1)]


#: theorem, problem, member, what is printed, what is true (numbers, each None where it has none), ρ of the error matrix
#: at z* = (1, …, 1)
PRINTED = {
    "4.3 (a) the parenthesis": (
        "4.3",
        icp.ICP([[0.1]], [1.0], icp.Affine([[-5.0]], 6.0)),
        icp.MNMGS(phi1=1.0, phi2=0.1),
        0.5,
        5.0,
        5.0,
    ),
    "4.3 (b) phi < 0": ("4.3", icp.ICP([[1.0]], [-1.0]), icp.MNMGS(phi=-1.5), None, None, 3.0),
    "4.3 (c) theta2 < 0": (
        "4.3",
        icp.ICP([[1.0, -0.5], [-0.5, 1.0]], [-0.5, -0.5]),
        icp.MNMAOR(theta1=1.0, theta2=-4.0),
        None,
        None,
        1.151,
    ),
    "4.4 case (1)": (
        "4.4",
        icp.ICP([[1.0]], [5.0], icp.Affine([[-0.9]], 1.9)),
        icp.Modulus(splitting=[[0.1]], phi=0.5, phi1=0.1, phi2=0.1),
        0.5 / 0.51,  # 1 - .01/.51
        0.13 / 0.06,  # 1 + .07/.06
        1.375,
    ),
}


@pytest.mark.parametrize("name", PRINTED)
def test_the_printed_statement_holds_and_the_method_does_not_converge(name):
    theorem, problem, member, said, true, radius = PRINTED[name]
    printed, corrected = (check(theorem, problem, member, as_printed=flag) for flag in (True, False))
    assert (printed.holds, corrected.holds) == (True, False)
    assert printed.false_as_printed
    assert corrected.reason
    for found, number in ((printed, said), (corrected, true)):
        assert number is None or found.number == pytest.approx(number)
    assert check("sharper", problem, member).holds is not True
    ones = np.ones(problem.n)
    assert problem.residual(ones) < 1e-14
    steps = [(iterate(member, problem, ones + 1e-6 * e, 1)[1] - 1.0) / 1e-6 for e in np.eye(problem.n)]
    assert np.abs(np.linalg.eigvals(np.array(steps).T)).max() == pytest.approx(radius, abs=1e-3)


def test_the_parenthesis_of_43_leads_into_a_cycle():
    problem = PRINTED["4.3 (a) the parenthesis"][1]
    solution = attempt(problem, "mnmgs", phi1=1.0, phi2=0.1, z0=[56.0])
    assert solution.status is icp.Status.CYCLED
    assert "period 2" in solution.message
    assert solution.iterations <= 20
    assert sorted(z[0] for z in iterate(icp.MNMGS(phi2=0.1), problem, [2.0], 400)[-2:]) == pytest.approx([-10, 56])


def test_41_the_componentwise_decrease_is_false_and_that_in_the_norm_of_v_is_true():
    """A = [2, −1; −.5, 2], GS, Ω = D, z⁰ = (1, 3): ρ(L) = .283, |e⁰| = (0, 2), |e¹| = (1, .125)."""
    A = np.array([[2.0, -1.0], [-0.5, 2.0]])
    problem = icp.ICP(A, -A @ np.ones(2))
    printed, corrected = (check("4.1", problem, icp.MNMGS(), as_printed=flag) for flag in (True, False))
    assert printed.holds is corrected.holds is True
    assert printed.false_as_printed
    assert corrected.number == pytest.approx(0.283, abs=5e-4)
    before, after = (np.abs(z - 1.0) for z in iterate(icp.MNMGS(), problem, [1.0, 3.0], 1))
    assert after == pytest.approx([1.0, 0.125])
    assert after[0] > before[0]
    assert (after / corrected.vector).max() <= corrected.number * (before / corrected.vector).max()


@pytest.mark.parametrize("member", [icp.MNMOD(), icp.MNMAOR(theta1=1.0, theta2=1.0), icp.MNMJ()], ids=repr)
def test_42_as_printed_holds_for_nonzero_g_almost_never(member):
    """The bounds on g_ij force G = 0; the useful form takes a small G of any pattern."""
    A = np.array([[1.0, -0.2, 0.1], [0.1, 1.0, 0.3], [-0.2, 0.1, 1.0]])
    for entry in itertools.product(range(3), repeat=2):
        G = np.zeros((3, 3))
        G[entry] = 1e-6
        problem = icp.ICP(A, np.zeros(3), icp.Affine(G))
        printed = check("4.2", problem, member, as_printed=True)
        assert (printed.holds, printed.false_as_printed) == (False, "")
        if not isinstance(member, icp.MNMOD):  # there |N| + |A| counts A twice, and Ω is not D
            assert check("4.2", problem, member).holds is True
    assert check("4.2", icp.ICP(A, np.zeros(3)), member, as_printed=True).holds is True


def test_44_case_two_as_printed():
    """φ₁ = I: then the printed case (2) is right, and says what the corrected theorem says, but for mixed rows."""
    problem = icp.ICP([[4.0, -1.0], [1.0, 4.0]], [0.0, 0.0])
    for phi2, printed, corrected in ((3.5, True, True), (0.9, False, False), ([3.5, 5.0], False, True)):
        assert check("4.4", problem, icp.MNMGS(phi2=phi2), as_printed=True).holds is printed
        assert check("4.4", problem, icp.MNMGS(phi2=phi2)).holds is corrected


def test_44_needs_a_positive_diagonal():
    """A = M₁ = −1, Ω = 1: (⟨M̂⟩ − |N̂| + min(Ω, D) − D)v = v > 0, yet X = 0."""
    problem, member = icp.ICP([[-1.0]], [0.0]), icp.Modulus(splitting="whole", phi2=1.0)
    assert check("4.4", problem, member).holds is check("4.1", problem, member).holds is False


def test_where_splittings_differ():
    """A = [1, −.9; −.9, 1], ψ(z) = 1 − .9(z₂, z₁), q = (−1, 3): the sum of both couplings is 1.8, the larger one .9."""
    problem, start = icp.scenes.hand_splittings().problem, [5.0, -7.0]
    assert check("sharper", problem, icp.MNMJ()).number == pytest.approx(0.9)
    assert check("4.3", problem, icp.MNMJ()).number == pytest.approx(1.8)
    assert problem.solve("mnmj", z0=start).z == pytest.approx([1.0497, 0.05525], abs=5e-5)
    for member in (icp.MNMGS(), icp.MNMOD()):
        assert check("sharper", problem, member).holds is check("4.1", problem, member).holds is False
        assert not attempt(problem, member, z0=start, max_iter=5000).solved


def test_monotone_on_the_dividend_scene():
    """φ ≥ |D − Ω|: Ω = .25D fails with φ = 0 and holds with φ = .75D; no other theorem can speak."""
    problem = icp.scenes.dividend(n=31).problem
    D = problem.A.diagonal()
    bare, shifted = icp.MNMJ(phi2=0.25 * D), icp.MNMJ(phi2=0.25 * D, phi=0.75 * D)
    assert check("monotone", problem, bare).holds is False
    assert check("monotone", problem, shifted).holds is True
    assert check("monotone", problem, icp.MNMJ(phi2=0.3 * D, phi=np.abs(D - 0.3 * D))).holds is True
    assert all(check(name, problem, shifted).holds is None for name in BY_NORM)
    assert problem.paper_residual(attempt(problem, bare, max_iter=5_000).z) > 1.0
    assert problem.solve(shifted, rtol=1e-6, max_iter=50_000).solved


def test_on_the_cyclic_p_matrix_nothing_holds_newton_goes_round_and_mnmmod_converges():
    """A = [1, 0, 2; 2, 1, 0; 0, 2, 1], q = −(1, 1, 1): period 3 at Res = √10."""
    problem = icp.scenes.hand_cyclic().problem
    for member in (icp.MNMGS(), icp.MNMMOD(theta1=2.0)):
        assert not any(found.holds for found in check_all(problem, member).values())
    A, q, z, seen = problem.A.toarray(), problem.q, np.array([1.0, 0.0, 0.0]), []
    for _ in range(9):
        rows = problem.p(z) < z
        z = np.linalg.solve(np.where(rows[:, None], A, np.eye(3)), np.where(rows, -q, 0.0))
        seen.append(z)
    assert np.array_equal(seen[-1], seen[-4])
    assert problem.paper_residual(z) == pytest.approx(np.sqrt(10))
    assert problem.solve("mnmmod", theta1=2.0).z == pytest.approx(np.full(3, 1 / 3))


def test_the_sign_of_the_triangles():
    """A = D − L − U: with L taken as the triangle itself Gauss–Seidel would go to (0.75, 0.5) and not to (1, 1)."""
    A, q, z = np.array([[4.0, -1.0], [-2.0, 4.0]]), np.array([-3.0, -2.0]), np.zeros(2)
    assert icp.ICP(A, q).solve("mnmgs", rtol=1e-12).z == pytest.approx([1.0, 1.0])
    for _ in range(200):
        right = np.array([-z[1], 0.0]) + np.abs((A - 4.0 * np.eye(2)) @ z + q) - q
        z = np.linalg.solve(np.array([[8.0, 0.0], [2.0, 8.0]]), right)
    assert np.abs(z - 1.0).max() > 0.2


def test_mnmmod_corrected():
    """A = q = ψ = 1, θ₁ = 2: the literal display gives 0.25, only the "+" restored 0.5, the right scheme 1 = z*."""
    problem = icp.ICP([[1.0]], [1.0], psi=1.0)
    assert iterate(icp.MNMMOD(theta1=2.0), problem, [0.0], 60)[-1] == pytest.approx([1.0])
    literal = plus = 0.0
    for _ in range(200):
        literal = (abs((1 - 2) * literal + 1 * 1) - 1 + 1) / 3
        plus = (abs((1 - 2) * plus + 1 + 1) - 1 + 1) / 3
    assert (literal, plus) == pytest.approx((0.25, 0.5))


@pytest.mark.parametrize(
    ("problem", "holds"),
    [
        (icp.ICP([[0.0, -1.0], [1.0, 0.0]], [1.0, -1.0]), True),
        (icp.ICP([[0.0, -1.0], [1.0, 0.0]], [1.0, -1.0], 0.0, upper=[2.0, np.inf]), True),
        (icp.ICP([[1.0, 3.0], [3.0, 1.0]], [1.0, 1.0]), False),
        (icp.ICP(np.eye(2), [1.0, 1.0], icp.Affine([[0.0, 1.5], [0.0, 0.0]])), False),
        (icp.ICP(np.eye(2), [1.0, 1.0], 0.0, upper=icp.Affine(np.eye(2), 1.0)), False),
    ],
)
def test_the_proximal_point_method_is_proved_where_a_is_monotone_and_the_obstacles_fixed(problem, holds):
    assert proximal_point(problem).holds is holds
    assert ("theorem proximal" in problem.explain().sections()["best proved"]) is holds
