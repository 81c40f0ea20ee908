"""The proximal method: monotone problems that are semidefinite or degenerate, and an end where there is no solution."""

import itertools

import hypothesis.strategies as st
import numpy as np
import pytest
import scipy.sparse as sp
from benchmarks.families import problem_of
from hypothesis import given, settings

import icpmodel as icp
from icpmodel import Status
from icpmodel.algebra.equations import ShiftedEquations
from icpmodel.methods.proximal import ProximalPath
from icpmodel.numerics import work


def run(problem, **options):
    return problem.solve("proximal", raise_on_failure=False, **options)


def complementary(rng, n, degenerate=0.3):
    """z*, p* ≥ 0 with z*ᵀp* = 0 where a share of the pairs is (0, 0)."""
    z, p = rng.uniform(0.5, 1.5, (2, n))
    kind = rng.random(n)
    z[kind < 0.5], p[kind >= 0.5] = 0.0, 0.0
    both = rng.random(n) < degenerate
    z[both] = p[both] = 0.0
    return z, p


def chain(rng, bodies, n):
    """Contacts of neighbours in a line between walls, most of them stated twice: A = JM⁻¹Jᵀ, q = Jv."""
    J = np.eye(bodies + 1, bodies) - np.eye(bodies + 1, bodies, k=-1)
    J = J[rng.integers(0, bodies + 1, n)]
    J = sp.csr_array(np.vstack([J, J[: n // 2]]))
    return icp.ICP(J @ sp.diags_array(rng.uniform(0.1, 10.0, bodies)) @ J.T, J @ np.round(rng.normal(size=bodies)))


def pile(rng, m, decades=1.0):
    """m × m bodies that move in two directions, each in contact with three neighbours in any direction: p = J·velocity.

    At rest nothing penetrates, so that there is a solution; the rows of J are dependent. Masses differ by `decades`.
    """
    index = np.arange(m * m).reshape(m, m)
    pairs = [(index[:, :-1], index[:, 1:]), (index[:-1], index[1:]), (index[:-1, :-1], index[1:, 1:])]
    i, j = (np.concatenate([pair[k].ravel() for pair in pairs]) for k in (0, 1))
    angle, rows = rng.uniform(0, 2 * np.pi, i.size), np.arange(i.size)
    x, y = np.cos(angle), np.sin(angle)
    places = np.tile(rows, 4), np.concatenate([2 * i, 2 * i + 1, 2 * j, 2 * j + 1])
    J = sp.csr_array(sp.coo_array((np.concatenate([-x, -y, x, y]), places)))
    mass = np.repeat(10.0 ** (decades * rng.uniform(-0.5, 0.5, m * m)), 2)
    return icp.ICP(J @ sp.diags_array(1.0 / mass) @ J.T, J @ rng.normal(size=2 * m * m))


def linear_program(rng, m, n):
    """Min cᵀx, Bx ≥ b, x ≥ 0 and its dual, with a solution of which many constraints hold by chance."""
    B = rng.integers(-2, 3, (m, n)).astype(float)
    A = np.block([[np.zeros((n, n)), -B.T], [B, np.zeros((m, m))]])
    z, p = complementary(rng, m + n)
    return icp.ICP(A, p - A @ z), B, (p - A @ z)[:n], z


@given(st.integers(0, 10**6), st.integers(1, 12), st.floats(0.0, 1.0), st.floats(0.0, 3.0), st.integers(-6, 6))
@settings(max_examples=60, deadline=None)
def test_every_monotone_problem_with_a_solution_is_solved_in_any_units(seed, n, rank, skew, decades):
    rng = np.random.default_rng(seed)
    E, K = rng.normal(size=(n, max(round(rank * n), 1))), skew * rng.normal(size=(n, n))
    A, (z, p), units = E @ E.T + K - K.T, complementary(rng, n), 10.0 ** (decades * rng.uniform(-1, 1, n))
    problem = icp.ICP(units[:, None] * A * units, units * (p - A @ z))
    # that rounding allows no more is true, too
    assert run(problem).status in (icp.Status.SOLVED, icp.Status.PRECISION_LIMIT)


@pytest.mark.parametrize("seed", range(6))
def test_redundant_and_degenerate_contacts_are_solved_with_the_velocities_that_are_unique(seed):
    """Az is the same for all solutions z where A is symmetric and semidefinite."""
    problem = chain(np.random.default_rng(seed), 60, 80)
    solution = run(problem, rtol=1e-11)
    assert solution.solved
    assert problem.p(solution.z) == pytest.approx(problem.p(problem.solve("lemke").z), abs=1e-8)


@pytest.mark.parametrize("seed", range(3))
def test_redundant_contacts_in_two_dimensions_are_solved_by_signs_and_through_the_interior(seed):
    rng = np.random.default_rng(seed)
    for problem in (pile(rng, 10), linear_program(rng, 30, 40)[0]):
        assert run(problem).solved
        interior = ProximalPath(problem, np.zeros(problem.n)).interior()
        residuals = []
        while len(residuals) < 25 and interior.advance():
            residuals.append(problem.residual(interior.z))
        assert min(residuals) < 1e-8 * problem.residual_at_0()


@pytest.mark.parametrize("family", ["graph-directed", "market-leontief", "market-leontief+elementwise"])
def test_matrices_that_fill_up_and_are_not_symmetric_are_not_factorised(family):
    problem = problem_of(family, 3, 1500)
    before = work.done()
    assert run(problem).solved
    assert work.done() - before < problem.matrix.factor_cost


def test_where_factors_are_beyond_the_time_limit_a_larger_mu_leads_on():
    """Skew, on a graph without geometry: factors take ten seconds, steps few where the shift is not small."""
    rng, n = np.random.default_rng(5), 10_000
    S = sp.random_array((n, n), density=8 / n, rng=rng, data_sampler=rng.standard_normal)
    problem, f = icp.ICP(sp.csr_array(S - S.T), np.zeros(n)), rng.normal(size=n)
    equations = ShiftedEquations(problem)
    with work.within(5.0):
        assert problem.matrix.factor_cost > work.nanoseconds_left()
        for shift, found in ((0.5, True), (1e-9, False), (0.5, True)):
            x = equations.solve(np.ones(n, bool), np.full(n, shift), f, 1e-6, briefly=False)
            assert (x is not None) is found
            if found:
                assert np.linalg.norm(problem.product(x) + shift * x - f) <= 1e-3 * np.linalg.norm(f)


@pytest.mark.parametrize("family", ["grid-3d-anisotropic", "option-two"])
@pytest.mark.parametrize("seed", range(4))
def test_steps_are_those_of_newton_once_the_first_problem_has_gone_quickly(family, seed):
    """μ that falls by a fifth at a time takes two to three times as many."""
    problem = problem_of(family, seed, 400)
    solution = run(problem)
    assert solution.solved
    assert solution.iterations <= problem.solve("newton").iterations + 3


@pytest.mark.parametrize("seed", [2, 4, 7])
def test_a_path_that_creeps_goes_through_the_interior_before_it_has_cost_much_more(seed):
    """Plates, on which signs alone take 65 to 75 steps."""
    solution = run(problem_of("plate", seed, 3000))
    assert solution.solved
    assert solution.iterations <= 50


@pytest.mark.parametrize("seed", [1, 2, 3, 5])
def test_what_the_interior_has_to_reduce_is_its_own_residual(seed):
    """Masses over eight decades: it begins above what the signs have come to, and is below it after 20 steps."""
    solution = run(pile(np.random.default_rng(seed), 14, decades=8.0))
    assert solution.solved
    assert solution.iterations <= 120


@pytest.mark.parametrize("seed", [0, 2, 3, 4])
def test_one_step_with_signs_that_have_settled_ends_the_way_through_the_interior(seed):
    """Rows where both are 0 at the solution: the interior alone comes nearer by a factor, and takes twice as long."""
    problem = problem_of("contact-pile", seed, 1500)
    path, wanted = ProximalPath(problem, np.zeros(problem.n)), 1e-12 * problem.residual_at_0()
    interior, alone, steps = path.interior(), 1, 1
    while interior.advance() and problem.residual(interior.z) > wanted:
        alone += 1
    path.inside = path.interior()
    while path.advance() and path.residual > wanted:
        steps += 1
    assert path.residual <= wanted
    assert steps <= 0.7 * alone


def test_a_step_with_settled_signs_leaves_the_path_where_it_went_inside():
    """The path comes back there where the interior leads nowhere."""
    problem = problem_of("contact-pile", 1, 1500)
    path = ProximalPath(problem, np.zeros(problem.n))
    assert path.advance()
    centre, shift, path.inside = path.centre, path.shift, path.interior()
    while path.inside.same < 1:
        assert path.advance()
    assert path.centre is centre
    assert path.shift == shift


@pytest.mark.parametrize("seed", range(4))
def test_the_interior_leads_on_where_rows_have_no_diagonal(seed):
    """Traffic: A is not symmetric, and towards the end its pivots on the diagonal come to nothing."""
    problem = problem_of("market-traffic", seed, 1500)
    path = ProximalPath(problem, np.zeros(problem.n))
    interior, residuals = path.interior(), []
    while len(residuals) < 60 and interior.advance():
        residuals.append(problem.residual(interior.z))
    assert min(residuals) < 1e-9 * problem.residual_at_0()


def convex_regression(rng, knots):
    """min ½‖x − y‖² with slopes that do not fall, and its multipliers; knots are as near as chance has it."""
    gaps = np.diff(np.sort(rng.random(knots)) * knots) + 1e-3
    slopes = sp.diags_array(1 / gaps, offsets=0, shape=(knots - 1, knots - 1)) @ np.diff(np.eye(knots), axis=0)
    G, at = np.diff(slopes, axis=0), np.append(0.0, np.cumsum(gaps)) / knots
    y = 3.0 * (at - 0.5) ** 2 + 0.3 * rng.standard_normal(knots)
    A = sp.block_array([[sp.eye_array(knots), -G.T], [G, None]])
    q, psi = np.concatenate([-y, np.zeros(knots - 2)]), np.repeat([-np.inf, 0.0], [knots, knots - 2])
    return icp.ICP(A, q, psi)


@pytest.mark.parametrize("seed", range(3))
def test_the_interior_does_not_creep_where_a_is_small_against_what_is_added(seed):
    """Smooth multipliers move fitted values next to nothing: by 1e-12 for 500 knots, where 1e-7 is added at first."""
    problem = convex_regression(np.random.default_rng(seed), 500)
    interior = ProximalPath(problem, np.zeros(problem.n)).interior()
    for _ in range(50):
        if problem.residual(interior.z) <= 1e-9 * problem.residual_at_0():
            break
        assert interior.advance()
    assert problem.residual(interior.z) <= 1e-9 * problem.residual_at_0()
    assert interior.steady < interior.first_steady
    assert run(problem).solved


def test_more_is_added_where_factors_are_rough_and_what_was_too_little_is_not_tried_again():
    """Equations without a diagonal of their own, one of them twice: there, next to nothing is not enough."""
    B = np.array([[1.0, 2.0, 3.0], [1.0, 2.0, 3.0], [0.0, 1.0, 1.0]])
    A = np.block([[np.zeros((3, 3)), -B.T], [B, np.zeros((3, 3))]])
    problem = icp.ICP(A, [1.0, 1.0, 1.0, -6.0, -6.0, -2.0], [0.0, 0.0, 0.0, -np.inf, -np.inf, -np.inf])
    interior = ProximalPath(problem, np.zeros(6)).interior()
    interior.steady = 1e-30
    assert interior.advance()
    added = interior.steady
    assert 1e-30 < added <= interior.first_steady
    for _ in range(30):
        if problem.residual(interior.z) <= 1e-8 * problem.residual_at_0():
            break
        assert interior.advance()
        assert interior.steady >= added
    assert problem.residual(interior.z) <= 1e-8 * problem.residual_at_0()


def power_flow(rng, nodes):
    """Generators of half of the nodes, free angles, lines of random ends, and demand that may be shed at a price."""
    ends = np.concatenate([np.arange(1, nodes), rng.integers(0, nodes, nodes)])
    others = np.concatenate([(rng.random(nodes - 1) * np.arange(1, nodes)).astype(int), rng.integers(0, nodes, nodes)])
    lines, own = ends.size, nodes // 2
    at, both = np.tile(np.arange(lines), 2), np.concatenate([ends, others])
    B = sp.csr_array((np.repeat([1.0, -1.0], lines), (both, at)), shape=(nodes, lines))
    of = sp.csr_array((np.ones(own), (rng.choice(nodes, own, replace=False), np.arange(own))), shape=(nodes, own))
    angles = sp.diags_array(rng.uniform(1.0, 10.0, lines)) @ B.T
    E = sp.block_array([[of, None, -B, sp.eye_array(nodes)], [None, angles, -sp.eye_array(lines), None]])
    demand = rng.random(nodes)
    most = np.concatenate([rng.uniform(0.0, 4.0, own), np.full(nodes, np.inf), np.full(lines, 2.0), demand])
    least = np.where(np.isinf(most), -np.inf, np.where(np.arange(most.size) < most.size - nodes, -most, 0.0))
    least[:own] = 0.0
    cost = np.concatenate([rng.uniform(5.0, 35.0, own), np.zeros(nodes + lines), np.full(nodes, 1000.0)])
    rows = E.shape[0]
    q = np.concatenate([cost, -demand, np.zeros(lines)])
    psi, upper = np.append(least, np.full(rows, -np.inf)), np.append(most, np.full(rows, np.inf))
    return icp.ICP(sp.block_array([[None, -E.T], [E, None]]), q, psi, upper=upper)


def test_the_interior_is_not_too_dear_where_a_look_at_the_fill_was_given_up():
    """That foresees ten times what its steps cost here; with half as many nodes it was four times, and 178 others, and
    46 s, led there in place of 42."""
    problem = power_flow(np.random.default_rng(0), 8000)
    look = problem.matrix.look
    foreseen, needed = (work.factor_cost(fill) for fill in (look.fill, look.to_the_end().fill))
    assert not look.fill.seen
    assert foreseen > 3.0 * needed
    path = ProximalPath(problem, np.zeros(problem.n))
    path.spent = 10.0 * needed
    assert not path.is_dear
    path.spent = 20.0 * needed
    assert path.is_dear


def support_vectors(rng, points):
    """The dual of support vector regression with a kernel whose entries fall to 1e-40, and its free multiplier."""
    x = np.sort(rng.uniform(0.0, 30.0, points))
    K, o = np.exp(-((x[:, None] - x) ** 2) / 2.0), np.ones((points, 1))
    y = np.sin(x) + 0.1 * rng.standard_normal(points)
    A = np.block([[K, -K, -o], [-K, K, o], [o.T, -o.T, np.zeros((1, 1))]])
    q = np.concatenate([0.1 - y, 0.1 + y, [0.0]])
    return icp.ICP(A, q, np.append(np.zeros(2 * points), -np.inf), upper=np.append(np.full(2 * points, 10.0), np.inf))


@pytest.mark.parametrize("seed", range(4))
def test_entries_that_are_next_to_nothing_do_not_decide_the_units(seed):
    """W by means of logarithms reaches from 1e-42 to 1e15 here, and no step leads anywhere."""
    assert run(support_vectors(np.random.default_rng(seed), 120)).solved


def test_where_the_interior_leads_nowhere_the_path_goes_on_from_its_centre():
    problem = pile(np.random.default_rng(7), 6)
    path = ProximalPath(problem, np.zeros(problem.n))
    assert path.advance()
    path.inside = path.interior()
    path.inside.s[:] = np.nan
    while path.advance() and path.residual > 1e-8 * problem.residual_at_0():
        assert path.inside is None
    assert path.residual <= 1e-8 * problem.residual_at_0()


@pytest.mark.parametrize("seed", range(6))
def test_a_linear_program_and_its_dual_come_to_the_value_that_is_known(seed):
    problem, _, c, exact = linear_program(np.random.default_rng(seed), 15, 20)
    solution = run(problem, rtol=1e-11)
    assert solution.solved
    assert c @ solution.z[:20] == pytest.approx(c @ exact[:20], abs=1e-7)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_shortest_path_has_its_length_however_far_that_is_from_the_data(seed):
    """A path of 1000 arcs of length 1 to 3: the residual creeps for 35 steps, while s comes to p in all of them."""
    n, rng = 1000, np.random.default_rng(seed)
    low, arcs = np.arange(n), np.arange(2 * n)
    start, end = np.concatenate([low, low + 1]), np.concatenate([low + 1, low])
    signs = np.repeat([-1.0, 1.0], 2 * n)
    B = sp.csr_array((signs, (np.concatenate([start, end]), np.tile(arcs, 2))), shape=(n + 1, 2 * n))
    lengths, demand = rng.uniform(1.0, 3.0, 2 * n), np.zeros(n + 1)
    demand[[0, -1]] = -1.0, 1.0
    problem = icp.ICP(sp.block_array([[None, -B.T], [B, None]]), np.concatenate([lengths, -demand]))
    assert comes_inside(problem, 1e-8, most=50)
    prices = run(problem).z[2 * n :]
    assert prices[-1] - prices[0] == pytest.approx(lengths[:n].sum())


def test_units_have_no_influence_on_the_steps_where_a_is_symmetric():
    rng = np.random.default_rng(1)
    problem, units = chain(rng, 40, 60), 2.0 ** rng.integers(-20, 20, 90)
    S = sp.diags_array(units)
    scaled = icp.ICP(S @ problem.A @ S, units * problem.q)
    paths = (icp.Proximal().iterates(one, np.zeros(90)) for one in (problem, scaled))
    for (z, _), (y, _) in itertools.islice(zip(*paths, strict=False), 8):
        assert units * y == pytest.approx(z, rel=1e-9, abs=1e-9)


def test_the_answer_is_nearer_than_the_start_to_every_solution():
    """The resolvent is nonexpansive, and the solutions are its fixed points; here they are a triangle."""
    A, q = np.ones((3, 3)), -np.ones(3)
    z = run(icp.ICP(A, q), z0=[2.0, 0.0, 0.0]).z
    for solution in np.eye(3):
        assert np.linalg.norm(z - solution) <= np.linalg.norm(np.array([2.0, 0.0, 0.0]) - solution)


def test_the_cyclic_p_matrix_on_which_newton_s_plain_steps_go_round_is_solved():
    problem = icp.ICP([[1, 0, 2], [2, 1, 0], [0, 2, 1]], [-1, -1, -1])
    assert run(problem, z0=[1, 0, 0]).z == pytest.approx(np.full(3, 1 / 3))


@pytest.mark.parametrize("psi", [0.0, -np.inf])
def test_zero_rows_and_rows_without_obstacle_are_solved(psi):
    A = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    solution = run(icp.ICP(A, [1.0, -1.0, 2.0], [psi, 0.0, 1.0]))
    assert solution.z == pytest.approx([1.0, 1.0, 1.0])


def test_an_obstacle_that_moves_with_its_own_unknown_is_fixed_first():
    psi = icp.Elementwise(lambda z: 0.5 * np.sin(z), lambda z: 0.5 * np.cos(z), lipschitz=0.5, c=1.0)
    problem = icp.ICP(np.ones((3, 3)), [-1.0, -2.0, 3.0], psi)
    assert run(problem).z == pytest.approx(problem.solve("newton").z)


def moving(rng, above):
    """A solvable problem with a monotone A and affine obstacles that move with all unknowns."""
    n = int(rng.integers(5, 60))
    B, S = rng.normal(size=(n, int(rng.integers(1, n + 1)))), rng.normal(size=(n, n))
    A = B @ B.T + rng.choice([0.0, 0.3]) * (S - S.T)
    G = rng.uniform(-1.0, 1.0, (n, n))
    G *= 0.8 / np.abs(G).sum(axis=1, keepdims=True)
    (r, p), z = complementary(rng, n), rng.normal(size=n)
    q, psi, upper = p - A @ z, icp.Affine(G, z - r - G @ z), None
    if above:  # in every third row z is on it, and p below 0
        high = np.arange(n) % 3 == 0
        q, psi = q - np.where(high, p + rng.random(n), 0.0), icp.Affine(G, z - np.where(high, 1.0, r) - G @ z)
        upper = icp.Affine(G, z + np.where(high, 0.0, 1.0) - G @ z)
    return icp.ICP(A, q, psi, upper=upper)


@pytest.mark.parametrize("above", [False, True])
@pytest.mark.parametrize("seed", range(15))
def test_obstacles_that_move_are_followed_where_a_is_monotone(seed, above):
    """Nothing is proved of them; Newton's method ends without a solution on one in forty of these."""
    assert run(moving(np.random.default_rng(seed), above)).solved


def comes_inside(problem, wanted, most):
    """Whether so many steps through the interior come to this residual, and none of them fails."""
    interior = ProximalPath(problem, np.zeros(problem.n)).interior()
    for _ in range(most):
        if problem.residual(interior.z) <= wanted:
            break
        assert interior.advance()
    return problem.residual(interior.z) <= wanted


@pytest.mark.parametrize("above", [False, True])
def test_obstacles_that_move_are_followed_through_the_interior(above):
    """Nothing is proved of that either; 6 to 26 steps were measured."""
    for seed in range(15):
        problem = moving(np.random.default_rng(seed), above)
        assert comes_inside(problem, 1e-8 * problem.residual_at_0(), most=40)


@pytest.mark.parametrize("q", [5.0, -1.0 - 1e-9])
@pytest.mark.parametrize("above", [False, True])
def test_the_interior_begins_with_room_where_nothing_pulls_at_an_obstacle_that_moves(q, above):
    """p at ψ(0) is positive there, or as good as 0, and ψ(0) not yet ψ at itself."""
    G = [[0.0, 0.5], [0.5, 0.0]]
    problem = icp.ICP(np.eye(2), [q, q], icp.Affine(G, [1.0, 1.0]), upper=icp.Affine(G, [3.0, 3.0]) if above else None)
    assert comes_inside(problem, 1e-9, most=12)


@pytest.mark.parametrize("seed", [1, 3])
def test_the_interior_is_quicker_where_signs_creep_after_an_obstacle_that_moves(seed):
    """Piles, on which signs alone took 96 steps and 1025."""
    solution = run(problem_of("contact-pile+affine", seed, 2500))
    assert solution.solved
    assert solution.iterations <= 60


def failing(value):
    """A problem whose ψ, which moves with the other unknown, is `value`, or raises where that is None, once for every
    entry of the list that comes with it."""
    fails = []

    def psi(z):
        if fails:
            fails.pop()
            if value is None:
                raise ValueError("out of the domain")
            return np.full(2, value)
        return 0.3 * np.cos(z[::-1])

    moves = icp.Function(psi, lambda z: sp.csr_array(np.fliplr(np.diag(-0.3 * np.sin(z[::-1])))))
    return icp.ICP([[1.0, 0.5], [0.5, 1.0]], [-1.0, 0.2], moves), fails


@pytest.mark.parametrize("value", [np.nan, None])
def test_the_interior_ends_at_a_step_at_which_psi_fails(value):
    problem, fails = failing(value)
    interior = ProximalPath(problem, np.array([2.0, -1.0])).interior()
    assert interior.advance()
    fails.append(True)
    assert not interior.advance()
    assert not fails


def test_a_moving_obstacle_without_derivative_is_refused_with_the_reason():
    problem = icp.ICP(np.eye(2), [1, 1], icp.Function(lambda z: 0.5 * np.sin(z[::-1])))
    with pytest.raises(icp.NotApplicable, match=r"no derivative"):
        problem.solve("proximal")


@pytest.mark.parametrize("value", [np.nan, None])
def test_a_step_at_which_psi_fails_is_taken_back_and_a_shorter_one_tried(value):
    problem, fails = failing(value)
    path, other = (ProximalPath(problem, np.array([2.0, -1.0])) for _ in range(2))
    assert all(one.advance() and one.made == 1 for one in (path, other))
    assert other.advance()
    fails.append(True)
    assert path.advance()
    assert not fails
    assert path.shift > other.shift
    assert np.array_equal(path.centre[0], other.centre[0])
    while path.residual > 1e-8 * problem.residual_at_0():
        assert path.advance()


@pytest.mark.parametrize("seed", range(5))
def test_a_problem_without_a_solution_ends_with_the_proof(seed):
    """x ≥ 0 with eᵀx ≤ −1 does not exist; the rest of the program does not matter."""
    rng = np.random.default_rng(seed)
    problem, B, *_ = linear_program(rng, 6, 8)
    B = np.vstack([B, -np.ones(8)])
    A, q = np.block([[np.zeros((8, 8)), -B.T], [B, np.zeros((7, 7))]]), np.append(problem.q, -1.0)
    solution = run(icp.ICP(A, q))
    assert solution.status is Status.INFEASIBLE
    y = np.array([float(x) for x in solution.infeasible.witness])
    assert (y >= 0).all()
    assert (A.T @ y <= 1e-12).all()
    assert q @ y < 0


def test_what_is_not_monotone_may_fail_but_ends():
    rng = np.random.default_rng(3)
    for _ in range(5):
        A = rng.normal(size=(20, 20))
        problem = icp.ICP(A + A.T, rng.normal(size=20))
        path = icp.Proximal().iterates(problem, np.zeros(20))
        assert sum(1 for _ in itertools.islice(path, 5000)) < 5000


def test_a_path_has_the_residual_of_its_iterates():
    """Where few rows leave the obstacle as well."""
    rng = np.random.default_rng(5)
    i, j = np.divmod(np.arange(400), 20)
    E = sp.coo_array((np.ones(800), (np.tile(np.arange(400), 2), np.append(i, 20 + j))), shape=(400, 40)).tocsr()
    problem = icp.ICP(E @ sp.diags_array(rng.uniform(0.5, 2, 40)) @ E.T, rng.uniform(-5, 10, 400), rng.normal(size=400))
    few = 0
    for z, residual in itertools.islice(icp.Proximal().iterates(problem, np.zeros(400)), 1, 12):
        assert residual == pytest.approx(problem.residual(z), rel=1e-9, abs=1e-12)
        few += np.count_nonzero(z != problem.psi.c) < 100
    assert few
    assert run(problem).solved


def test_the_interior_steps_of_a_problem_without_any_obstacle_are_newton_steps():
    """Nothing is bounded, so that there is no longest step and no complementarity to measure."""
    A = [
        [48321256.05119265, -136944226.83382624, 102118537.92098375],
        [-136944226.83382624, 441599818.28677034, -304245947.0949065],
        [102118537.92098375, -304245947.0949065, 219925488.61771172],
    ]
    assert run(icp.ICP(A, [-0.3597688079966724, 0.2148426585980065, 0.9585910347869577], -np.inf)).solved
