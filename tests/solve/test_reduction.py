"""Reduction: what is left out is left out rightly, and the answer is one of the whole problem."""

import itertools
from dataclasses import fields
from fractions import Fraction
from itertools import chain

import numpy as np
import pytest
import scipy.sparse as sp

import icpmodel as icp
from icpmodel.algebra.resting import WORTH, Border, balance, rows_at_rest, widened
from icpmodel.algebra.subproblems import Blocks, blocks, resting, restricted, with_fixed_obstacle
from icpmodel.methods.contract import Method
from icpmodel.methods.multilevel import Multilevel
from icpmodel.scenes.grid import five_point
from icpmodel.solve.candidate import Candidate
from icpmodel.solve.choice import choose
from icpmodel.solve.driver import carry_out, solution_of
from icpmodel.solve.goal import RTOL, Goal, Limits
from icpmodel.solve.part import Part, advance
from icpmodel.solve.reduced import Reduced, ReducedTo, candidates, proved_of_earlier, structure
from icpmodel.solve.run import Run
from icpmodel.solve.schedule import Stage, in_turn
from icpmodel.theory.certificates.infeasible import Known, infeasible

LIMITS = Limits(rtol=1e-8, atol=0.0, max_iter=1000, time_limit=None)


def p_matrix(rng, n, skew=3.0):
    """Positive definite, and mostly far from an H-matrix."""
    B, C = rng.standard_normal((2, n, n))
    return B @ B.T + skew * (C - C.T) + 0.2 * np.eye(n)


def block_triangular(rng, sizes, coupling=0.3):
    """Diagonal blocks that are P-matrices, any entries below them: a P-matrix, permuted by the returned order."""
    n, at = sum(sizes), 0
    A = np.tril(rng.standard_normal((n, n)) * (rng.random((n, n)) < coupling), -1)
    for size in sizes:
        A[at : at + size, at : at + size] = p_matrix(rng, size)
        at += size
    order = rng.permutation(n)
    return A[np.ix_(order, order)], order


def plain(problem):
    """The answer without any reduction."""
    at_0 = problem.residual_at_0()
    run = Run(problem, np.zeros(problem.n), at_0, Goal(1e-12 * at_0), aim=1e-12, scale=at_0)
    carry_out(run, choose(problem, 1e-12))
    solution = solution_of(run, LIMITS)
    assert solution.residual <= 1e-9 * (1.0 + at_0)
    return solution.z


def landscape(m, seed, share=0.05):
    """A membrane on a floor, m × m, held down but for a few places."""
    rng = np.random.default_rng(seed)
    q = np.where(rng.random((m, m)) < share / 100, -200.0, 1.0)
    return icp.ICP(five_point(m, 0.0), q.ravel(), rng.uniform(-1.0, 1.0))


def later(stages):
    """The same stages, the first of which comes where those before have ended."""
    yield Stage(np.inf, next(stages).made)
    yield from stages


def run_of(problem):
    """A run to the usual share of Res(0)."""
    at_0 = problem.residual_at_0()
    return Run(problem, np.zeros(problem.n), at_0, Goal(RTOL * at_0), aim=RTOL, scale=at_0)


def against_the_sweeps(n, near=-1.5, far=-0.5):
    """Upper triangular, z* = 1: the unknowns come in the order in which sweeps do not run, and errors grow before."""
    A = sp.csr_array(sp.diags_array([np.ones(n), np.full(n - 1, near), np.full(n - 2, far)], offsets=[0, 1, 2]))
    return icp.ICP(A, -(A @ np.ones(n)))


class TestBlocks:
    @pytest.mark.parametrize("seed", range(12))
    def test_every_row_of_the_answer_is_that_of_the_whole_problem(self, seed):
        """LCP with blocks of 1 to 9 rows, any couplings below them, rows without obstacle, in any order of the rows."""
        rng = np.random.default_rng(seed)
        A, _ = block_triangular(rng, rng.integers(1, 10, 20))
        n = len(A)
        psi = np.where(rng.random(n) < 0.1, -np.inf, rng.standard_normal(n))
        problem = icp.ICP(A, 3.0 * rng.standard_normal(n), psi)
        found = blocks(problem)
        assert found.core == 0
        solution = problem.solve(Reduced())
        assert solution.solved
        assert solution.problem is problem
        assert np.abs(solution.z - plain(problem)).max() <= 1e-6 * (1.0 + np.abs(solution.z).max())

    @pytest.mark.parametrize("seed", range(6))
    def test_the_order_of_the_rows_changes_nothing(self, seed):
        rng = np.random.default_rng(seed)
        A, _ = block_triangular(rng, [1, 4, 1, 70, 2, 1, 5])
        q, order = rng.standard_normal(len(A)), rng.permutation(len(A))
        one, other = icp.ICP(A, q), icp.ICP(A[np.ix_(order, order)], q[order])
        assert blocks(one).core == blocks(other).core
        z = one.solve(Reduced(), rtol=1e-11).z
        assert np.abs(z[order] - other.solve(Reduced(), rtol=1e-11).z).max() <= 1e-6 * (1 + np.abs(z).max())

    @pytest.mark.parametrize("seed", range(6))
    def test_rows_that_follow_one_by_one_are_exact(self, seed):
        """Triangular A and G with small whole numbers: the rational answer, row by row, to rounding; G_ii counts."""
        rng = np.random.default_rng(seed)
        n = 30
        A = np.tril(rng.integers(-2, 3, (n, n)) * (rng.random((n, n)) < 0.15), -1) + np.diag(rng.integers(1, 4, n))
        G = (
            np.tril(rng.integers(-2, 3, (n, n)) * (rng.random((n, n)) < 0.1), -1) + np.diag(rng.integers(-2, 1, n))
        ) / 2
        q, c = rng.integers(-4, 5, n), rng.integers(-4, 5, n)
        z: list[Fraction] = []
        for i in range(n):
            lifts = (Fraction(int(c[i])) + sum(Fraction(G[i, j]) * z[j] for j in range(i))) / (1 - Fraction(G[i, i]))
            free = -(Fraction(int(q[i])) + sum(int(A[i, j]) * z[j] for j in range(i))) / int(A[i, i])
            z.append(max(lifts, free))
        order = rng.permutation(n)
        problem = icp.ICP(A[np.ix_(order, order)], q[order], icp.Affine(G[np.ix_(order, order)], c[order]))
        assert blocks(problem).core == 0
        solution = problem.solve(Reduced(), rtol=1e-13)
        exact = np.array([float(x) for x in z])[order]
        assert solution.iterations == 1
        assert np.allclose(solution.z, exact, rtol=1e-13, atol=1e-13 * np.abs(exact).max())

    def test_a_triangular_matrix_is_solved_in_one_pass_whatever_sweeps_would_need(self):
        """Upper triangular: the unknowns come in the order in which sweeps do not run."""
        solution = against_the_sweeps(500).solve()
        assert repr(solution.method) == "Reduced()"
        assert "500 follow one by one" in solution.why
        assert np.array_equal(solution.z, np.ones(500))

    @pytest.mark.parametrize("kind", ["affine", "elementwise", "jumps"])
    def test_obstacles_that_move(self, kind):
        """ψ couples blocks as A does: the graph is that of both, and what is left out is the same for all maps."""
        rng = np.random.default_rng(5)
        sizes = [80, 1, 6, 1, 3, 1]
        A, order = block_triangular(rng, sizes, coupling=0.0)
        A += np.diag(np.abs(A).sum(axis=1))
        n, place = len(A), np.argsort(order)
        G = np.zeros((n, n))
        G[place[80], place[3]], G[place[83], place[80]], G[place[90], place[90]] = 0.5, -0.7, 0.4
        G[place[3], place[4]] = 0.1
        if kind == "affine":
            psi = icp.Affine(G, rng.standard_normal(n))
        elif kind == "elementwise":
            psi = icp.Elementwise(lambda z: 0.5 * np.sin(z), lambda z: 0.5 * np.cos(z), 0.5, rng.standard_normal(n))
        else:
            rows, columns = place[[80, 81, 2]], place[[3, 80, 90]]
            psi = icp.Intervention(sp.csr_array(([-0.1, -0.1, 5.0], (rows, columns)), shape=(n, n)))
        problem = icp.ICP(A, rng.standard_normal(n), psi)
        found = blocks(problem)
        assert 80 <= found.core < n
        solution = problem.solve(Reduced(), rtol=1e-11)
        assert solution.residual == problem.residual(solution.z)
        assert np.abs(solution.z - plain(problem)).max() <= 1e-6

    def test_a_part_of_its_own_gets_a_method_of_its_own(self):
        """A large membrane and a dense P-matrix: what serves one does not serve the other."""
        rng = np.random.default_rng(0)
        membrane = icp.scenes.membrane(n=6400).problem
        A = sp.csr_array(sp.block_diag([membrane.A, p_matrix(rng, 100)]))
        q, psi = np.append(membrane.q, rng.standard_normal(100)), np.append(membrane.psi.c, np.zeros(100))
        problem = icp.ICP(A, q, psi)
        assert [part.size for part in blocks(problem).parts] in ([6400, 100], [100, 6400])
        assert "2 parts do not interact" in repr(blocks(problem))
        solution = problem.solve(Reduced())
        assert np.abs(solution.z[:6400] - membrane.solve().z).max() <= 1e-6

    def test_blocks_that_pivots_do_not_solve_go_to_the_core(self):
        """Rows without a unique answer, and blocks in units of their own, are left to the other methods."""
        rng = np.random.default_rng(1)
        wild = np.diag(10.0 ** np.array([-9, 9, 0])) @ p_matrix(rng, 3) @ np.diag(10.0 ** np.array([9, -9, 2]))
        A = sp.csr_array(sp.block_diag([wild, [[-1.0]], p_matrix(rng, 70)]))
        problem = icp.ICP(
            A, np.concatenate([10.0 ** np.array([-9, 9, 0]) * [-1, -2, 1], [2.0], rng.standard_normal(70)])
        )
        found = blocks(problem)
        _, solved = found.forward(np.zeros(74), found.before)
        assert not solved.all()
        wider = found.with_core(found.before & ~solved)
        assert wider.core > found.core
        assert problem.solve(Reduced()).solved

    @pytest.mark.parametrize(("first", "second", "worth"), [(625, 361, False), (529, 441, True)])
    def test_parts_are_solved_apart_where_none_is_nearly_the_whole(self, first, second, worth):
        """At most six tenths of it; one that is larger would be solved twice where it is not solved at once."""
        one, other = (icp.scenes.membrane(n=n).problem for n in (first, second))
        A, q = sp.csr_array(sp.block_diag([one.A, other.A])), np.append(one.q, other.q)
        problem = icp.ICP(A, q, np.append(one.psi.c, other.psi.c))
        assert (structure(problem, WORTH * problem.n) is not None) is worth
        assert structure(problem, problem.n - 1) is not None
        assert problem.solve().solved

    def test_one_block_is_no_reduction(self):
        membrane = icp.scenes.membrane(n=100).problem
        assert blocks(membrane) is None
        assert Reduced().why_not(membrane) is not None
        assert blocks(icp.ICP(np.eye(100), np.ones(100), np.sin)) is None

    def test_no_solution_is_never_called_one(self):
        """A block without a solution, above others that have one."""
        A = np.eye(80)
        A[0, 0], A[1, 0] = 0.0, -1.0
        q = np.full(80, -1.0)
        solution = icp.ICP(A, q).solve(raise_on_failure=False)
        assert not solution.solved
        assert solution.residual > solution.tolerance


class TestRest:
    @pytest.mark.parametrize("seed", range(3))
    def test_the_answer_is_that_of_the_whole_problem(self, seed):
        problem = landscape(110, seed)
        solution = problem.solve(Reduced(), rtol=1e-11)
        assert solution.solved
        assert "rest on the obstacle" in repr(rows_at_rest(problem))
        assert np.abs(solution.z - problem.solve(Multilevel(), rtol=1e-11).z).max() <= 1e-6

    def test_rows_that_are_opened_are_certain_to_leave_the_obstacle(self):
        """Started with too few open rows; wherever p < 0 opens one, the solution is off the obstacle there."""
        problem = landscape(110, 7)
        found = resting(problem, problem.p(problem.psi.c) < 0)
        exact = problem.solve(Multilevel(), rtol=1e-12).z
        rounds = 0
        while found is not None:
            (rows,) = found.parts
            z = np.where(found.open, 0.0, problem.psi.c)
            z[rows] = icp.solve(restricted(problem, rows, z), rtol=1e-12).z
            border = Border(found)
            p = border.p(z)
            seeds = border.rows[p < -1e-9]
            assert (exact[seeds] > problem.psi.c[seeds]).all()
            if not seeds.size:
                break
            found, rounds = border.opened(p), rounds + 1
            assert f"opened ({rounds} x)" in repr(found)
        assert rounds > 0
        assert np.abs(z - exact).max() <= 1e-6
        assert problem.solve(ReducedTo(blocks=resting(problem, problem.p(problem.psi.c) < 0))).solved

    @pytest.mark.parametrize("seed", range(3))
    def test_the_guess_is_a_near_one(self, seed):
        """Not less than four fifths of the rows that leave the obstacle, nor more than twice as many."""
        problem = landscape(110, seed)
        free = np.count_nonzero(problem.solve(Multilevel(), rtol=1e-11).z > problem.psi.c)
        assert 0.8 * free <= rows_at_rest(problem).core <= 2.0 * free

    @pytest.mark.parametrize("seed", range(20))
    def test_for_z_matrices_a_negative_p_proves_that_the_row_leaves_the_obstacle(self, seed):
        """All solutions of random whole-numbered LCPs, by trying all active sets with rational arithmetic."""
        rng = np.random.default_rng(seed)
        n = 5
        A = -rng.integers(0, 3, (n, n)) * (1 - np.eye(n, dtype=int)) + np.diag(rng.integers(1, 6, n))
        q = rng.integers(-3, 4, n)
        for free in itertools.product([False, True], repeat=n):
            rows = np.flatnonzero(free)
            y = np.zeros(n)
            if rows.size and abs(np.linalg.det(A[np.ix_(rows, rows)])) < 0.5:
                continue
            y[rows] = np.linalg.solve(A[np.ix_(rows, rows)], -q[rows])
            exact = [Fraction(float(x)).limit_denominator(10**6) for x in y]
            p = [int(q[i]) + sum(int(A[i, j]) * exact[j] for j in range(n)) for i in range(n)]
            if min(exact) >= 0 and min(p) >= 0 and all(x * w == 0 for x, w in zip(exact, p, strict=True)):
                assert all(exact[i] > 0 for i in range(n) if q[i] < 0)

    def test_a_wrong_guess_costs_time_and_no_truth(self):
        """Nothing is open at first: every look opens rows, in the end all of them, or the next method follows."""
        problem = landscape(110, 3, share=3.0)
        guess = resting(problem, np.arange(problem.n) < 5)

        class Guessed(Reduced):
            def found(self, problem):
                return guess

        alone = problem.solve(Guessed(), raise_on_failure=False)
        run = run_of(problem)
        carry_out(run, chain(in_turn(Candidate(ReducedTo(blocks=guess), "")), later(choose(problem, RTOL))))
        for solution in (alone, solution_of(run, LIMITS)):
            assert solution.solved
            assert solution.residual == problem.residual(solution.z) <= solution.tolerance
        assert run.tried[0].outcome == "stagnated"

    def test_the_residual_of_an_iterate_is_that_of_the_whole_problem(self):
        """It falls out of the parts and of the rows at rest next to them; more are opened where those weigh more."""
        problem = landscape(110, 7)
        path = ReducedTo(blocks=resting(problem, problem.p(problem.psi.c) < 0)).iterates(problem, problem.psi.c)
        seen = [(hint, problem.residual(z)) for z, hint in path]
        assert len(seen) > 1
        for hint, residual in seen[1:]:
            assert hint == pytest.approx(residual, rel=1e-9, abs=1e-13)

    def test_the_balance_opens_as_many_rows_as_it_takes_to_hold_the_load(self):
        """A point that pushes up with 10, rows that hold down with 1 each: ten of them."""
        problem = icp.ICP(five_point(20, 0.0), np.ones(400))
        p = np.ones(400)
        p[210] = -10.0
        assert balance(problem, p < 0, p) == pytest.approx(10.0)
        units = 10.0 ** np.arange(400).clip(0, 200)
        in_units = icp.ICP(sp.diags_array(units) @ problem.A, problem.q)
        assert balance(in_units, p < 0, units * p) == pytest.approx(10.0)
        wider = widened(problem, np.zeros(400, dtype=bool), p < 0, p, 1.0)
        assert np.count_nonzero(wider) == 5  # whole layers only: 4 neighbours, the next layer would be 8 more
        assert wider[[210, 209, 211, 190, 230]].all()

    def test_where_most_rows_leave_the_obstacle_nothing_is_looked_for(self):
        for scene in (icp.scenes.membrane(n=10_000), icp.scenes.ball(n=10_000)):
            assert rows_at_rest(scene.problem) is None

    def test_only_z_matrices_with_a_fixed_obstacle(self):
        problem = landscape(110, 0)
        assert rows_at_rest(problem) is not None
        A = problem.A.tolil()
        A[0, 5] = 1e-3
        assert rows_at_rest(icp.ICP(A.tocsr(), problem.q, problem.psi)) is None
        free = np.where(np.arange(problem.n) == 3, -np.inf, problem.psi.c)
        assert rows_at_rest(problem.with_psi(free)) is None


class TestTheRun:
    """The loop, its limits and its callbacks see the whole problem."""

    def problem(self):
        rng = np.random.default_rng(2)
        A, _ = block_triangular(rng, [90, 1, 4, 85, 1])
        return icp.ICP(A, rng.standard_normal(len(A)))

    def test_the_callback_sees_iterates_of_full_size_with_their_residual(self):
        problem, seen = self.problem(), []
        problem.solve(Reduced(), callback=lambda state: seen.append((state.z.copy(), state.residual)))
        assert len(seen) > 2
        for z, residual in seen:
            assert z.shape == (problem.n,)
            assert residual == pytest.approx(problem.residual(z), rel=1e-9)

    def test_limits_hold_and_ctrl_c_leaves_the_best_iterate(self):
        problem = self.problem()

        def stop(state):
            if state.iteration == 2:
                raise KeyboardInterrupt

        stopped = problem.solve(callback=stop, raise_on_failure=False)
        assert stopped.status is icp.Status.INTERRUPTED
        assert stopped.z.shape == (problem.n,)
        assert stopped.residual == problem.residual(stopped.z) < problem.residual(np.zeros(problem.n))
        assert problem.solve(max_iter=1, raise_on_failure=False).iterations == 1

    def test_a_named_method_gets_the_whole_problem(self):
        problem = against_the_sweeps(500)
        assert repr(problem.solve("lemke").method) == "Lemke()"
        assert repr(problem.solve().method) == "Reduced()"

    def test_where_reduction_fails_the_whole_problem_is_tried(self):
        """Blocks that are solved wrongly: the judge sees it, and the usual methods solve the problem."""

        class Rubbish(Blocks):
            def forward(self, z, wanted):
                return np.full(z.size, 7.0), wanted

        for near, far in ((-1.5, -0.5), (-1.0, -0.25)):
            problem = against_the_sweeps(100, near, far)
            found = blocks(problem)
            wrong = Rubbish(**{field.name: getattr(found, field.name) for field in fields(found)})
            run = run_of(problem)
            usual = later(choose(problem, RTOL))
            carry_out(run, chain(in_turn(Candidate(ReducedTo(blocks=wrong), "blocks")), usual))
            solution = solution_of(run, LIMITS)
            assert solution.solved
            assert solution.residual <= solution.tolerance
            assert "Reduced(): stagnated" in solution.why
        # here, with condition 6e8 instead of 2e25, a small residual tells z*
        assert np.abs(solution.z - 1.0).max() <= 1e-9

    def test_a_certified_error_is_that_of_the_whole_problem(self):
        A = np.tril(np.full((100, 100), -0.01), -1) + np.eye(100)
        solution = icp.ICP(A, np.linspace(-1.0, 1.0, 100)).solve(icp.Reduced(), accuracy=1e-9)
        assert repr(solution.method) == "Reduced()"
        assert solution.error_bound <= 1e-9
        assert solution.certificate.bound.componentwise.shape == (100,)

    @pytest.mark.parametrize("unit", [1e-100, 1e100])
    def test_units_of_rows_change_nothing(self, unit):
        rng = np.random.default_rng(4)
        A, _ = block_triangular(rng, rng.integers(1, 6, 30))
        q, scale = rng.standard_normal(len(A)), np.where(rng.random(len(A)) < 0.5, unit, 1.0)
        z = icp.ICP(A, q).solve().z
        scaled = icp.ICP(scale[:, None] * A, scale * q)
        answer, _ = blocks(scaled).forward(np.zeros(len(A)), blocks(scaled).before)
        again = icp.ICP(unit * A, unit * q)
        uniform, solved = blocks(again).forward(np.zeros(len(A)), blocks(again).before)
        assert solved.all()
        assert np.allclose(uniform, z, rtol=1e-9, atol=1e-9)
        alone = np.diff(blocks(scaled).starts) == 1
        rows = blocks(scaled).rows[np.repeat(alone, np.diff(blocks(scaled).starts))]
        assert np.isfinite(answer[rows]).all()


def test_a_restricted_problem_has_the_p_and_r_of_the_whole_one():
    rng = np.random.default_rng(3)
    A, G = rng.standard_normal((2, 9, 9))
    rows, z = np.array([1, 4, 5, 8]), rng.standard_normal(9)
    jumps = sp.csr_array((np.array([0.3, -0.2]), ([1, 5], [4, 8])), shape=(9, 9))
    for psi in (rng.standard_normal(9), icp.Affine(G, 1.0), icp.Intervention(jumps)):
        problem = icp.ICP(A, rng.standard_normal(9), psi)
        part = restricted(problem, rows, z)
        assert np.allclose(part.p(z[rows]), problem.p(z)[rows])
        assert np.allclose(part.r(z[rows]), problem.r(z)[rows])


def test_components_come_in_the_order_in_which_they_hang_on_each_other():
    """SciPy numbers them so, though it does not say it: every entry of A points to its own block or an earlier one."""
    for seed, sizes in itertools.product(range(5), ([1] * 30, [3, 1, 7, 1, 1, 12, 2], [5] * 8)):
        rng = np.random.default_rng(seed)
        A, _ = block_triangular(rng, sizes)
        found = blocks(icp.ICP(A, np.ones(len(A))))
        place = np.empty(len(A), dtype=int)
        place[found.rows] = np.repeat(np.arange(found.starts.size - 1), np.diff(found.starts))
        i, j = np.nonzero(A)
        assert (place[j] <= place[i]).all()


def test_a_million_rows_are_counted_and_nothing_is_made_dense():
    """A membrane on a floor, a few points of which are lifted: it is told how many rows were left open."""
    m = 1000
    q = np.ones((m, m))
    q[50::100, 50::100] = -100.0
    problem = icp.ICP(five_point(m, 0.0), q.ravel())
    found = rows_at_rest(problem)
    assert found.core < 0.05 * problem.n
    assert f"n = 1000000 -> {found.core} rows still open" in repr(found)
    solution = problem.solve(ReducedTo(blocks=found))
    assert np.count_nonzero(solution.z) < 0.1 * problem.n


def test_where_too_many_rows_leave_the_obstacle_the_reduction_ends():
    """Rows at rest in a problem where all of them leave: the whole problem goes to the usual method."""
    problem = icp.ICP(five_point(110, 0.0), np.full(110**2, -1.0))
    method = ReducedTo(blocks=resting(problem, np.arange(problem.n) < 50))
    assert 1 < len(list(itertools.islice(method.iterates(problem, np.zeros(problem.n)), 50))) < 50
    run = run_of(problem)
    carry_out(run, chain(in_turn(Candidate(method, "rows at rest")), later(choose(problem, RTOL))))
    assert solution_of(run, LIMITS).solved
    made = [candidate.method.name for stage in candidates(problem) for candidate, _ in stage.made()]
    assert made
    assert "reduced" not in made


def exact_value(problem, y, low, high):
    """The most that (Az + q)'y can be where low <= z <= high, in rational arithmetic."""
    y = [Fraction(x) for x in y]
    total = sum(weight * Fraction(float(b)) for weight, b in zip(y, problem.q, strict=True))
    for j, column in enumerate(problem.A.toarray().T):
        entry = sum(weight * Fraction(float(a)) for weight, a in zip(y, column, strict=True))
        end = high[j] if entry > 0 else low[j]
        if entry:
            if not np.isfinite(float(end)):
                return np.inf
            total += entry * Fraction(end)
    return total


class Halving(Method):
    """Every iterate halves the distance to 1."""

    def iterates(self, problem, z):
        while True:
            yield z, None
            z = 0.5 * (z + 1.0)


class TestParts:
    """A part goes through the same run as a whole problem."""

    def cyclic(self):
        return icp.scenes.hand_cyclic().problem

    def test_a_part_tries_the_candidates_of_the_whole_and_they_end_alike(self):
        """Where sweeps turn in a circle, and where no method finds a solution."""
        for problem in (self.cyclic(), icp.ICP([[-1.0]], [-1.0], icp.Function(lambda z: 0 * z, lambda z: [[0.0]]))):
            part = Part(problem, np.arange(problem.n), np.zeros(problem.n), RTOL)
            while not part.over:
                part.step()
            whole = run_of(problem)
            carry_out(whole, choose(problem, RTOL))
            ended = [(repr(one.candidate.method), one.outcome) for one in part.run.tried]
            other = [(repr(one.candidate.method), one.outcome) for one in whole.tried]
            if whole.ended.status is icp.Status.SOLVED:  # a part goes on to the last digit
                ended, other = ended[: len(other) - 1], other[:-1]
            assert ended == other
            assert part.residual == problem.residual(part.z)

    def test_methods_that_turn_in_a_circle_end_in_a_part_as_they_do_in_the_whole(self):
        problem = self.cyclic()
        whole = run_of(problem)
        carry_out(whole, in_turn(Candidate(icp.MNMGS(), ""), Candidate(icp.Newton(), "")))
        part = Part(problem, np.arange(3), np.zeros(3), RTOL)
        part.steps = part.run.steps(in_turn(Candidate(icp.MNMGS(), ""), Candidate(icp.Newton(), "")))
        while not part.over:
            part.step()
        assert [one.outcome for one in whole.tried] == ["cycled", "solved"]
        assert part.run.tried[0].outcome == "cycled"
        assert part.residual <= 1e-12

    def test_advancing_makes_steps_of_the_worst_part_until_all_are_better(self):
        problem = icp.ICP(np.eye(2), [-1.0, -1.0])
        one, other = (Part(icp.ICP([[1.0]], [-1.0]), np.array([k]), np.zeros(2), RTOL) for k in (0, 1))
        for part in (one, other):
            part.steps = part.run.steps(in_turn(Candidate(Halving(), "")))
        z = advance([one, other], np.zeros(2))
        assert problem.residual(z) <= 0.25 * np.sqrt(2.0)
        assert z.tolist() == [0.75, 0.75]

    def test_the_limits_of_the_run_hold_inside_blocks(self):
        rng = np.random.default_rng(2)
        A, _ = block_triangular(rng, [90, 1, 4, 85, 1])
        problem = icp.ICP(A, rng.standard_normal(len(A)))
        told = {"raise_on_failure": False, "rtol": 1e-13}
        for k in range(problem.solve(Reduced(), **told).iterations):
            limited = problem.solve(Reduced(), max_iter=k, **told)
            assert limited.status is icp.Status.ITERATION_LIMIT
            assert limited.iterations == k
        at_once = problem.solve(Reduced(), time_limit=0, **told)
        assert at_once.status is icp.Status.TIME_LIMIT
        assert at_once.iterations == 0
        seen = []
        stopped = problem.solve(
            Reduced(), callback=lambda state: seen.append(state.iteration) or len(seen) == 3, **told
        )
        assert stopped.status is icp.Status.STOPPED
        assert seen == [0, 1, 2]


class TestChains:
    """Large blocks that follow one another."""

    def chain(self, seed, sizes=(90, 1, 80, 3, 100, 2)):
        rng = np.random.default_rng(seed)
        A, _ = block_triangular(rng, sizes, coupling=0.05)
        return icp.ICP(A, rng.standard_normal(len(A)), rng.standard_normal(len(A)))

    @pytest.mark.parametrize("seed", range(6))
    def test_a_chain_is_solved_in_turn_and_the_answer_is_that_of_the_whole_problem(self, seed):
        problem = self.chain(seed)
        found = blocks(problem)
        assert [sum(part.size for part in stage) for stage in found.stages].count(0) == 0
        assert sorted(part.size for part in found.parts) == [80, 90, 100]
        assert len(found.stages) > 1
        assert f"3 parts in {len(found.stages)} stages follow one another" in repr(found)
        solution = problem.solve(Reduced(), rtol=1e-11)
        assert solution.residual == problem.residual(solution.z) <= solution.tolerance
        assert np.abs(solution.z - plain(problem)).max() <= 1e-6 * (1.0 + np.abs(solution.z).max())

    @pytest.mark.parametrize("seed", range(6))
    def test_a_stage_hangs_on_earlier_ones_and_the_blocks_between_only(self, seed):
        """Each row in exactly one place, and every entry of A leads to its own part or to what is known by then."""
        problem = self.chain(seed, (70, 1, 4, 80, 66, 1, 2, 90, 1, 1, 100, 3))
        found = blocks(problem)
        sizes = np.diff(found.starts)
        turn = np.full(problem.n, -1)

        def small(mask, at):
            rows = found.rows[np.repeat(mask, sizes)]
            assert (turn[rows] == -1).all()
            turn[rows] = at

        small(found.before, 0)
        part = np.full(problem.n, -1)
        for k, stage in enumerate(found.stages):
            for number, rows in enumerate(stage):
                assert (turn[rows] == -1).all()
                turn[rows], part[rows] = 2 * k + 1, number
            if k < len(found.between):
                small(found.between[k], 2 * k + 2)
        small(found.after, 2 * len(found.stages))
        assert (turn >= 0).all()
        i, j = np.nonzero(problem.A.toarray())
        assert (turn[j] <= turn[i]).all()
        same = (turn[i] == turn[j]) & (turn[i] % 2 == 1)
        assert (part[i] == part[j])[same].all()

    def test_a_chain_too_long_is_solved_at_once(self):
        problem = self.chain(0)
        found = blocks(problem, most_stages=0)
        assert len(found.stages) == 1
        assert found.between == ()
        assert problem.solve(ReducedTo(blocks=found)).solved

    def test_where_rows_are_dominant_one_method_takes_the_whole_chain(self):
        K, eye = five_point(10, 0.1), sp.eye_array(100)
        problem = icp.ICP(sp.block_array([[K, None], [-0.1 * eye, K]]), -np.ones(200))
        assert len(blocks(problem).stages) == 1
        assert len(blocks(icp.ICP(sp.block_array([[K, None], [-5.0 * eye, K]]), -np.ones(200))).stages) == 2

    def test_what_is_not_good_enough_is_gone_through_again_for_less(self):
        class Rough(Reduced):
            shares = (1e-2, 1e-5, 1e-9, 0.0)

        class Once(Reduced):
            shares = (1e-2,)

        K, eye = five_point(30, 0.3), sp.eye_array(900)
        problem = icp.ICP(sp.block_array([[K, None], [-5.0 * eye, K]]), -np.ones(1800))
        assert len(blocks(problem).stages) == 2
        assert problem.solve(Rough(), rtol=1e-8).solved
        assert not problem.solve(Once(), rtol=1e-8, raise_on_failure=False).solved

    def test_the_loop_sees_iterates_of_full_size_and_none_twice(self):
        problem = self.chain(2)
        before = None
        for z, _ in itertools.islice(Reduced().iterates(problem, np.zeros(problem.n)), 6):
            assert z is not before
            assert z.shape == (problem.n,)
            before = z


class TestInfeasible:
    """A block without a solution is one of the whole, where that is proved of the whole; else nothing is claimed."""

    def test_a_contradiction_in_the_first_block_is_one_of_the_whole(self):
        n = 100
        A = np.eye(n) + np.diag(np.full(n - 1, -0.1), -1)
        A[:2, :2], A[5, 0] = [[1.0, -1.0], [-1.0, 1.0]], 2.0
        q = np.full(n, -1.0)
        q[1] = 0.0
        order = np.random.default_rng(0).permutation(n)
        problem = icp.ICP(A[np.ix_(order, order)], q[order])
        solution = problem.solve(raise_on_failure=False)
        assert solution.status is icp.Status.INFEASIBLE
        y = solution.infeasible.witness
        assert set(order[np.flatnonzero(y)]) == {0, 1}
        assert min(y) >= 0
        assert exact_value(problem, y, np.zeros(n), np.full(n, np.inf)) < 0

    def test_so_is_one_of_a_block_whose_obstacle_moves(self):
        """Of (y, x), the weights of the rows of p and of r, both belong to the rows of the block."""
        n = 100
        A, G, c = np.eye(n) + np.diag(np.full(n - 1, -0.1), -1), np.zeros((n, n)), np.zeros(n)
        A[:2, :2], A[5, 0] = [[1.0, -0.5], [-0.5, 1.0]], 2.0
        G[:2, :2], c[:2] = [[2.0, 0.5], [0.0, 2.0]], 1.0
        order = np.random.default_rng(0).permutation(n)
        where = np.ix_(order, order)
        solution = icp.ICP(A[where], -np.ones(n), icp.Affine(G[where], c[order])).solve(
            "reduced", raise_on_failure=False
        )
        assert solution.status is icp.Status.INFEASIBLE
        y, x = np.split(solution.infeasible.witness, 2)
        assert set(order[np.flatnonzero(y)]) == set(order[np.flatnonzero(x)]) == {0, 1}

    @pytest.mark.parametrize("n", [3, 60, 80])
    @pytest.mark.parametrize(("b", "solvable"), [(-1.25, False), (-0.75, True), (-1.0, True)])
    def test_what_follows_from_a_block_with_one_answer_may_contradict_itself(self, n, b, solvable):
        """z_0 = 1/2, and z_1 - z_2 + 2 z_0 + b >= 0 with z_2 - z_1 >= 0 needs b >= -1; with z_0 free it has points."""
        A, q = np.eye(n), np.full(n, -1.0)
        A[:3, :3], q[:3] = [[2.0, 0.0, 0.0], [2.0, 1.0, -1.0], [0.0, -1.0, 1.0]], [-1.0, b, 0.0]
        problem = icp.ICP(A, q)
        assert (problem.p(np.r_[1.0, np.ones(n - 1)]) >= 0).all()
        solution = problem.solve(raise_on_failure=False)
        if solvable:
            assert solution.status is not icp.Status.INFEASIBLE
            return
        assert solution.status is icp.Status.INFEASIBLE
        assert "1 unknowns are proved to be what they are" in solution.infeasible.reason
        low, high = np.zeros(n), np.full(n, np.inf)
        low[0] = high[0] = 0.5
        assert exact_value(problem, solution.infeasible.witness, low, high) < 0

    def test_a_block_with_several_answers_proves_nothing_of_those_behind_it(self):
        """z_0 >= 0 is any number, z_1 (z_0 - 2) = 0 and z_0 >= 2."""
        solution = icp.ICP([[0.0, 0.0], [1.0, 0.0]], [0.0, -2.0]).solve(raise_on_failure=False)
        assert solution.status is not icp.Status.INFEASIBLE

    @pytest.mark.parametrize("seed", range(40))
    def test_no_problem_with_a_solution_is_ever_called_infeasible(self, seed):
        """Whole-numbered blocks, singular ones among them, with a solution put in; without it what is claimed holds."""
        rng = np.random.default_rng(seed)
        n = 6
        A = np.tril(rng.integers(-2, 3, (n, n)), -1) + np.diag(rng.integers(0, 3, n))
        A[4, 5] = rng.integers(-2, 3)
        active = rng.random(n) < 0.5
        z = np.where(active, 0, rng.integers(1, 4, n))
        q = np.where(active, rng.integers(0, 3, n), 0) - A @ z
        few = {"raise_on_failure": False, "max_iter": 30}
        assert icp.ICP(A, q).solve(**few).status is not icp.Status.INFEASIBLE
        other = icp.ICP(A, q - rng.integers(0, 3, n))
        if other.solve(**few).status is icp.Status.INFEASIBLE:
            assert not any(solves(other, free) for free in itertools.product([False, True], repeat=n))

    def test_an_interval_counts_with_its_worse_end(self):
        """p_1 = z_0 - 2 < 0 for z_0 in [1, 2), and for -z_0 + 2 it takes the lower end."""
        below, at = np.array([1.0, -np.inf]), np.array([2.0, np.inf])
        y = np.array([0.0, 1.0])
        up = icp.ICP([[1.0, 0.0], [1.0, 0.0]], [-1.0, -2.0])
        assert infeasible(up, y, Known(below, np.array([1.5, np.inf]), "")).holds
        assert infeasible(up, y, Known(below, at, "")).holds is None
        down = icp.ICP([[1.0, 0.0], [-1.0, 0.0]], [-1.0, 0.5])
        assert infeasible(down, y, Known(below, at, "")).holds
        assert infeasible(down, y, Known(np.array([0.5, -np.inf]), at, "")).holds is None


def solves(problem, free):
    """Whether some z with z_i = 0 off `free` and p_i = 0 on it has z >= 0, p >= 0: by HiGHS."""
    from scipy.optimize import linprog

    free, A = np.array(free), problem.A.toarray()
    found = linprog(
        np.zeros(problem.n),
        A_ub=-A,
        b_ub=problem.q,
        A_eq=A[free] if free.any() else None,
        b_eq=-problem.q[free] if free.any() else None,
        bounds=[(0, None if is_free else 0) for is_free in free],
    )
    return found.status == 0


def test_what_is_settled_holds_the_answer_and_says_nothing_of_the_rest():
    A = np.diag([2.0, 3.0, 1.0, 1.0])
    A[1, 0], A[2, 1] = -3.0, 5.0
    known = proved_of_earlier(icp.ICP(A, [-1.0, -1.0, 0.0, 0.0]), np.array([2]), np.array([0.5001, 0.8, 7.0, 7.0]))
    exact = np.array([1 / 2, 5 / 6])
    assert (known.low[:2] <= exact).all()
    assert (exact <= known.high[:2]).all()
    assert np.isinf(known.low[2:]).all()
    assert np.isinf(known.high[2:]).all()


def test_a_small_block_without_a_solution_behind_a_large_one():
    ring = 3.0 * np.eye(70) - np.roll(np.eye(70), 1, axis=0)
    A, q = np.eye(72), np.full(72, -1.0)
    A[:70, :70], A[70:, 70:], A[70, 5] = ring, [[1.0, -1.0], [-1.0, 1.0]], 10.0
    q[70:] = [-5.5, 0.0]  # z = 1/2 in the ring
    solution = icp.ICP(A, q).solve(Reduced(), raise_on_failure=False)
    assert solution.status is icp.Status.INFEASIBLE
    assert "70 unknowns are proved" in solution.infeasible.reason


def test_a_psi_that_is_nan_on_the_way_to_its_obstacle_fails_as_a_map_does():
    psi = icp.Elementwise(lambda t: np.where(np.abs(t) < 1e-9, 1e-9, np.nan), lipschitz=0.9)
    A = 4 * np.eye(40) - np.eye(40, k=7) - np.eye(40, k=13)
    with pytest.raises(icp.MapError, match="leads to nan where z_0 = psi_0"):
        with_fixed_obstacle(icp.ICP(A, np.ones(40), psi))
    solution = icp.ICP(A, np.ones(40), psi).solve(raise_on_failure=False)
    assert solution.status in (icp.Status.SOLVED, icp.Status.MAP_FAILED)
