"""Lemke's method: right where it ends in a basis, and no proof of infeasibility that is not one."""

from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import example, given, settings
from hypothesis import strategies as st
from known_answers import SEEDS
from scipy.optimize import linprog

import icpmodel as icp
from icpmodel.methods.shortcuts import Lemke
from icpmodel.theory.certificates.contradiction import multipliers
from icpmodel.theory.certificates.infeasible import infeasible


def run(problem, **options):
    return problem.solve(Lemke(), raise_on_failure=False, **options)


def proves_in_fractions(A, q, c, y):
    """y ≥ 0, Aᵀy ≤ 0 and (q + Ac)ᵀy < 0, without rounding."""
    A, q, c, y = (np.vectorize(Fraction, otypes=[object])(np.asarray(x)) for x in (A, q, c, y))
    return bool((y >= 0).all() and (A.T @ y <= 0).all() and (q + A @ c) @ y < 0)


def test_what_no_elimination_can_start_on_is_refused():
    with pytest.raises(icp.SingularOperator, match="rows and columns without obstacle"):
        icp.ICP([[0, 1], [0, -1]], [-1.0, 5.0], [-np.inf, 0.0]).solve("lemke")  # z_1 = 1, and p_1 = 4
    assert run(icp.ICP([[0, 1], [1, 1]], [1.0, 1.0], [-np.inf, 0.0])).status is icp.Status.INFEASIBLE
    with pytest.raises(icp.SingularOperator, match="I - G is singular"):
        icp.ICP([[1.0]], [1.0], icp.Affine([[1.0]], 1.0)).solve("lemke")
    with pytest.raises(icp.NotApplicable, match="with n = 1000000 they need"):
        icp.ICP(sp.eye_array(10**6), np.ones(10**6)).solve("lemke")


@pytest.mark.parametrize("n", [10, 300])
def test_equations_are_eliminated_with_other_rows_where_they_are_singular(n):
    """The least of xᵀQx/2 + cᵀx over a simplex, Q indefinite: z keeps to the simplex along the path; and a copy."""
    rng = np.random.default_rng(n)
    Q = rng.normal(size=(n, n))
    E = np.ones((2, n))
    A = np.block([[Q + Q.T, -E.T], [E, np.zeros((2, 2))]])
    z = run(icp.ICP(A, np.append(rng.normal(size=n), [-1, -1]), np.append(np.zeros(n), [-np.inf, -np.inf]))).z
    assert z[:n].sum() == pytest.approx(1.0)


def test_on_a_cyclic_p_matrix_with_ties_everywhere_the_pivots_end():
    """Every ratio is a tie at first: without the lexicographic rule the pivots do not end."""
    n = 31
    A = np.eye(n) + 2 * np.eye(n, k=1)
    A[-1, 0] = 2
    assert run(icp.ICP(A, -np.ones(n))).z == pytest.approx(np.full(n, 1 / 3))


def test_where_rounding_takes_ties_for_none_the_pivots_begin_again_and_end():
    """A ≥ 0 with a positive diagonal is strictly copositive: the path cannot end in a ray."""
    rng = np.random.default_rng(8)
    for _ in range(10):
        A = rng.integers(0, 2, (80, 80)) * (rng.random((80, 80)) < 0.7) + np.eye(80)
        problem = icp.ICP(A, -rng.integers(1, 3, 80))
        assert run(problem).solved, problem.q


def test_many_degenerate_problems_in_zeros_and_ones_end_and_never_go_round():
    rng = np.random.default_rng(4)
    for _ in range(300):
        n = int(rng.integers(2, 9))
        K = rng.integers(-1, 2, size=(n, n)).astype(float)
        problem = icp.ICP(K - K.T + np.diag(rng.integers(0, 2, n)), -rng.integers(0, 2, n))
        solution = run(problem)
        assert solution.status in (icp.Status.SOLVED, icp.Status.INFEASIBLE)
        assert solution.iterations <= 3


@pytest.mark.parametrize(
    ("problem", "y", "proof"),
    [
        (icp.ICP([[-1.0]], [0.5], 1.0), [1.0], True),  # p = 1/2 − z: no z ≥ 1 will do, but any in [0, 1/2]
        (icp.ICP([[-1.0]], [0.5]), [1.0], None),
        (icp.ICP([[-1.0]], [-1.0]), [0.0], None),
        (icp.ICP([[-1.0]], [-1.0]), [np.nan], None),
        (icp.ICP([[-1.0]], [-1.0]), [-1.0], None),
        (icp.ICP([[-1.0]], [-1.0], icp.Affine([[2.0]])), [1.0], None),  # z >= 2z: z = −1 has p = 0
        # p_1 = z_1 - 1 = 0 and p_2 = -z_1 >= 0; with p_2 = z_1 they are no contradiction
        (icp.ICP([[1.0, 0.0], [-1.0, 0.0]], [-1.0, 0.0], [-np.inf, 0.0]), [1.0, 1.0], True),
        (icp.ICP([[1.0, 0.0], [1.0, 0.0]], [-1.0, 0.0], [-np.inf, 0.0]), [1.0, -1.0], None),
    ],
)
def test_a_vector_proves_what_it_should_and_nothing_else(problem, y, proof):
    assert infeasible(problem, np.array(y)).holds is proof
    if not proof:
        assert run(problem).status is icp.Status.SOLVED or problem.q[0] == -1.0


def test_what_one_rounding_makes_infeasible_is_not_called_so():
    """A = [[1, -1], [-1, 1 + ε]] has a solution for every q, if far away; with ε = 0 the sign of q₁ + q₂ decides."""
    eps = 2.0**-52
    far = icp.ICP([[1.0, -1.0], [-1.0, 1.0 + eps]], [-1.0, 0.0])
    assert run(far).status is not icp.Status.INFEASIBLE
    assert infeasible(far, np.ones(2)).holds is None
    for q2, proof, status in (
        (1.0, None, "SOLVED"),
        (1.0 + 2 * eps, None, "SOLVED"),
        (1.0 - eps, True, "PRECISION_LIMIT"),
        (1.0 - 1e-6, True, "INFEASIBLE"),
    ):
        problem = icp.ICP([[1.0, -1.0], [-1.0, 1.0]], [-1.0, q2])
        assert infeasible(problem, np.ones(2)).holds is proof
        assert run(problem, rtol=0.0).status.name == status


@pytest.mark.parametrize("n", [8, 64])
def test_where_a_ray_begins_the_lcp_is_solved_up_to_t(n):
    """A ring with condition 4e12: its smallest pivots count as zero, so that they end in a ray, with t about 0."""
    problem = icp.scenes.hard_singular(n=n).problem
    solution = run(problem)
    assert solution.solved
    assert solution.residual <= 1e-10 * problem.residual(np.zeros(n))


@given(SEEDS, st.integers(2, 40), st.booleans())
@example(56243, 20, True)  # a pivot of 1e-4 of its column, after which ties differ by 1e-11, and the pivots went round
@example(566, 19, True)
@example(203441, 2, False)  # the ray of the pivots is far from a combination, which lies next to it none the less
@example(391, 9, False)  # the multipliers of a linear program are no ray: (Aᵀy)_i < 0 where y_i > 0
@settings(max_examples=40)
def test_infeasible_problems_are_proved_to_be_so_and_feasible_ones_never(seed, n, whole):
    """One y with Aᵀy ≤ 0 and qᵀy < 0, or one z with z ≥ 0 and Az + q ≥ 0, is built in."""
    rng = np.random.default_rng(seed)
    A = rng.integers(-4, 5, (n, n)).astype(float) if whole else rng.normal(size=(n, n))
    y, q = rng.integers(0, 3, n).astype(float), rng.integers(-3, 4, n).astype(float)
    y[0] = 1.0
    bad, worse = A.copy(), q.copy()
    bad[0] -= np.maximum(A.T @ y, 0.0) + 1e-3
    worse[0] -= max(q @ y, 0.0) + 1.0
    solution = run(icp.ICP(bad, worse))
    assert solution.status is icp.Status.INFEASIBLE
    assert proves_in_fractions(bad, worse, np.zeros(n), solution.infeasible.witness)
    z = rng.random(n)
    feasible = icp.ICP(A, rng.random(n) - A @ z)
    assert feasible.solve("lemke", raise_on_failure=False).status is not icp.Status.INFEASIBLE
    y = multipliers(feasible)
    assert y is None or not infeasible(feasible, y).holds


def test_an_affine_obstacle_that_no_z_reaches_is_proved_to_be_infeasible_without_rounding():
    """A z + q ≥ 0 and (I − G)z ≥ c contradict each other: y, x ≥ 0, Aᵀy + (I − G)ᵀx = 0 and qᵀy < cᵀx."""
    rng, exact, proved = np.random.default_rng(3), np.vectorize(Fraction, otypes=[object]), 0
    for _ in range(40):
        n = int(rng.integers(1, 7))
        A, G, q, c = (
            rng.normal(size=(n, n)),
            rng.normal(size=(n, n)),
            rng.normal(size=n) - 0.5,
            rng.normal(size=n) + 0.5,
        )
        none = linprog(np.zeros(n), -np.vstack([A, np.eye(n) - G]), np.append(q, -c), bounds=(None, None)).status == 2
        solution = run(icp.ICP(A, q, icp.Affine(G, c)))
        assert (solution.status is icp.Status.INFEASIBLE) is none
        if none:
            y, x = np.split(exact(solution.infeasible.witness), 2)
            assert (y >= 0).all()
            assert (x >= 0).all()
            assert exact(q) @ y < exact(c) @ x
            assert not (exact(A).T @ y + x - exact(G).T @ x).any()
            proved += 1
    assert proved >= 10


def test_no_unknown_ends_below_its_obstacle():
    """Two rows that are nearly one: a step of refinement took z_0 to −5e-36, where z_0 ≥ 0 is one of the conditions."""
    A = np.array([[288.0000001, 384.0, 0.0], [384.0, 512.0000001, 0.0], [0.0, 0.0, 1e-7]])
    problem = icp.ICP(1e-6 * A, np.zeros(3), [0.0, -3.0, 1.0])
    many = icp.solve_many(problem.A, [problem.q], problem.psi)
    for z in (problem.solve().z, problem.solve("lemke").z, many.Z[0]):
        assert (problem.r(z) >= 0.0).all()


@pytest.mark.parametrize("n", [5, 30, 100])
def test_between_two_obstacles_every_path_ends_in_a_solution(n):
    """A continuous map has a solution in a box, whatever A is, and z does not leave the box along the path."""
    rng = np.random.default_rng(n)
    for _ in range(5):
        A = rng.normal(size=(n, n))
        q = np.sqrt(n) * rng.normal(size=n)
        width = rng.uniform(0.5, 2.0, n)
        for solution in (icp.ICP(A, q, 0.0, width).solve("lemke"), icp.solve_many(A, q[None], 0.0, upper=width)[0]):
            assert solution.solved
            assert np.clip(solution.z - A @ solution.z - q, 0.0, width) == pytest.approx(solution.z, abs=1e-6)


def test_between_obstacles_that_meet_in_some_rows_every_path_ends_in_a_solution():
    rng = np.random.default_rng(3)
    for _ in range(30):
        n = int(rng.integers(2, 30))
        width = rng.integers(0, 3, n) * 1.0
        problem = icp.ICP(rng.integers(-2, 3, (n, n)), rng.integers(-3, 4, n), 0.0, width)
        assert run(problem).solved


def solvable(rng, programs):
    """A monotone problem in integers with a solution, and rows between obstacles, below or above one, or without any.

    The matrix is that of `programs` with equations, or another positive semidefinite one.
    """
    n = int(rng.integers(2, 12))
    B = rng.integers(-2, 3, (n, n // 2)).astype(float)
    C = rng.integers(-2, 3, (n, n)).astype(float)
    equations = np.arange(n) >= n - n // 3
    if programs:
        C[equations[:, None] == equations] = 0.0
        B[equations] = 0.0
    low = rng.integers(-2, 1, n).astype(float)
    high = low + rng.integers(0, 3, n)
    low[rng.random(n) < 0.3] = -np.inf
    high[rng.random(n) < 0.3] = np.inf
    if programs:
        low[equations] = -np.inf
        high[equations] = np.inf
    inside = np.clip(rng.integers(-1, 2, n), low, high)
    z = np.where(rng.random(n) < 0.4, low, np.where(rng.random(n) < 0.5, high, inside))
    z = np.where(np.isfinite(z), z, inside)
    p = (z == low) * rng.integers(0, 3, n) - (z == high) * rng.integers(0, 3, n)
    A = B @ B.T + C - C.T
    return A, p - A @ z, low, high


@pytest.mark.parametrize("n", [1, 7, 40])
def test_the_compiled_call_for_few_unknowns_agrees_with_the_method(n):
    rng = np.random.default_rng(n)
    for _ in range(20):
        B = rng.normal(size=(n, n))
        G = rng.normal(size=(n, n)) / (4.0 * n)
        c = np.where(rng.random(n) < 0.2, -np.inf, rng.normal(size=n))
        for psi, upper in ((c, None), (c, 1.0 + np.maximum(c, 0.0)), (icp.Affine(G, c), None)):
            problem = icp.ICP(B @ B.T + np.eye(n), 3.0 * rng.normal(size=n), psi, upper)
            solution = problem.solve()
            assert solution.z == pytest.approx(problem.solve("lemke").z, abs=1e-9)
            assert solution.residual == pytest.approx(problem.residual(solution.z), abs=1e-12)
    with pytest.raises(icp.NotSolved):
        icp.ICP([[1.0]], [1.0], icp.Affine([[1.0]], 1.0)).solve()  # no z >= z + 1


@pytest.mark.parametrize("big", [1e4, 1e8, 1e15])
def test_a_large_obstacle_costs_the_answer_no_digits(big):
    for low, high in ((-np.inf, big), (-big, np.inf), (-big, 1.0), (-0.75, big)):
        problem = icp.ICP([[2.0, 1.0], [1.0, 2.0]], [-1.0, 0.5], low, high)
        for z in (problem.solve().z, icp.solve_many(problem.A, [problem.q], low, upper=high).Z[0]):
            assert z == pytest.approx([5 / 6, -2 / 3], rel=1e-14)


def test_two_obstacles_that_move_differently_are_no_box():
    """Also where both amount to fixed ones: psi = z/2, and upper = 3 - z/2, which is 2."""
    psi, upper = icp.Affine(0.5 * np.eye(2)), icp.Affine(-0.5 * np.eye(2), 3.0)
    assert icp.ICP(2.0 * np.eye(2), [-8.0, -8.0], psi, upper).solve("lemke").z.tolist() == [2.0, 2.0]


def test_restarts_begin_at_unknowns_without_upper_bound():
    """Games of two players, half of the strategies bounded: without such starts three of these have no answer."""
    for seed in range(60):
        rng = np.random.default_rng(seed)
        A, B = rng.integers(1, 9, (2, 6, 6)).astype(float)
        none = np.zeros((6, 6))
        upper = np.where(rng.random(12) < 0.5, 0.05, np.inf)
        problem = icp.ICP(np.block([[none, A], [B.T, none]]), -np.ones(12), 0.0, upper)
        assert problem.solve("restarts", tries=20, raise_on_failure=False).solved


@pytest.mark.parametrize("programs", [False, True])
@pytest.mark.parametrize("method", ["lemke", None])
def test_a_solution_is_found_where_some_rows_have_two_obstacles(method, programs):
    rng = np.random.default_rng(5)
    for _ in range(150):
        A, q, low, high = solvable(rng, programs)
        solution = icp.ICP(A, q, low, high).solve(method)
        assert np.clip(solution.z - A @ solution.z - q, low, high) == pytest.approx(solution.z, abs=1e-7)
        assert (low <= solution.z).all()
        assert (solution.z <= high).all()


@pytest.mark.parametrize("method", ["lemke", None])
@pytest.mark.parametrize("seed", range(20))
def test_equations_that_nearly_depend_on_others_make_no_multiplier_large(seed, method):
    """Linear programs whose last equation is the sum of the others but for 1e-9; one solution has multipliers of 2."""
    rng = np.random.default_rng(seed)
    rows = rng.integers(-2, 3, (2, 5)) * 1.0
    E = np.vstack([rows, rows.sum(axis=0) + 1e-9 * rng.integers(-2, 3, 5)])
    x = rng.integers(0, 3, 5) * (rng.random(5) < 0.5)
    cost = E.T @ rng.integers(-2, 3, 3) + rng.integers(0, 3, 5) * (x == 0)
    A = np.block([[np.zeros((5, 5)), -E.T], [E, np.zeros((3, 3))]])
    problem = icp.ICP(A, np.append(cost, -E @ x), np.append(np.zeros(5), np.full(3, -np.inf)))
    assert problem.solve(method).solved


def test_equations_that_need_all_other_rows_are_eliminated():
    chain = np.roll(np.eye(4), 1, axis=1)
    assert run(icp.ICP(chain, -np.ones(4), [-np.inf, 0.0, 0.0, 0.0])).z.tolist() == [1.0] * 4


def test_rows_that_depend_on_others_up_to_rounding_are_tried_as_independent_ones():
    """A linear program: rows change places, and one with an obstacle depends on others up to 1e-7."""
    A = np.zeros((5, 5))
    A[:2, 2:] = [[0.0, 2.0**24, -0.125], [-(2.0**35), 2.0**38, 4096.0]]
    A -= A.T
    q = [-64.0, -(2.0**20), -(2.0**17), 2.0**20, 2.0**-6]
    assert run(icp.ICP(A, q, [0.0, 0.0, 0.0, -np.inf, -np.inf])).solved
