"""Reduction: what is left out is left out rightly, and the answer is one of the whole problem."""

from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from known_answers import attempt, sine
from runs import ended, run_on

import icpmodel as icp
from icpmodel.algebra.factor_costs import factor_costs
from icpmodel.algebra.schur import elimination, elimination_cost
from icpmodel.algebra.subproblems import blocks
from icpmodel.errors import OutOfTime
from icpmodel.numerics import work
from icpmodel.numerics.fill import factor_cost
from icpmodel.scenes.grid import five_point
from icpmodel.solve.choice import Ladder
from icpmodel.solve.reduction import solve_parts


def p_matrix(rng, n, skew=3.0):
    """Positive definite, and mostly far from an H-matrix."""
    B, C = rng.standard_normal((2, n, n))
    return B @ B.T + skew * (C - C.T) + 0.2 * np.eye(n)


def block_triangular(rng, sizes, coupling=0.0):
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
    run = run_on(problem, 1e-12)
    solution = ended(run, run.steps(Ladder(problem, 1e-12)))
    assert solution.residual <= 1e-9 * (1.0 + problem.residual_at_0())
    return solution.z


def solve_in_parts(problem, rtol=1e-11, **shown):
    """What the parts alone make of the problem."""
    run = run_on(problem, rtol, **shown)
    return ended(run, solve_parts(run, problem, share=1.0))


class TestBlocks:
    @pytest.mark.parametrize("seed", range(12))
    def test_every_row_of_the_answer_is_that_of_the_whole_problem(self, seed):
        """LCP with blocks of 1 to 9 rows, any couplings below them, rows without obstacle or with two, in any order of
        the rows; and with large blocks that follow one another."""
        rng, large = np.random.default_rng(seed), seed % 2
        sizes, coupling = ((90, 1, 80, 3, 100, 2), 0.05) if large else (rng.integers(1, 10, 20), 0.3)
        A, _ = block_triangular(rng, sizes, coupling)
        n = len(A)
        psi = np.where(rng.random(n) < 0.1, -np.inf, rng.standard_normal(n))
        upper = np.where(rng.random(n) < 0.5, np.maximum(psi, -1.0) + rng.random(n), np.inf) if seed % 3 else None
        problem = icp.ICP(A, 3.0 * rng.standard_normal(n), psi, upper)
        assert 270 <= blocks(problem).core <= n if large else blocks(problem).core == 0
        solution = solve_in_parts(problem)
        assert solution.residual == problem.residual(solution.z) <= solution.tolerance
        assert solution.solved
        assert solution.problem is problem
        assert np.abs(solution.z - plain(problem)).max() <= 1e-6 * (1.0 + np.abs(solution.z).max())

    @pytest.mark.parametrize("seed", range(6))
    def test_rows_that_follow_one_by_one_are_exact(self, seed):
        """Triangular A and G with small whole numbers: the rational answer, row by row, to rounding; G_ii counts."""
        rng = np.random.default_rng(seed)
        n = 30
        A, G = (np.tril(rng.integers(-2, 3, (n, n)) * (rng.random((n, n)) < share), -1) for share in (0.15, 0.1))
        A, G = A + np.diag(rng.integers(1, 4, n)), (G + np.diag(rng.integers(-2, 1, n))) / 2
        q, c = rng.integers(-4, 5, n), rng.integers(-4, 5, n)
        z: list[Fraction] = []
        for i in range(n):
            lifts = (Fraction(int(c[i])) + sum(Fraction(G[i, j]) * z[j] for j in range(i))) / (1 - Fraction(G[i, i]))
            free = -(Fraction(int(q[i])) + sum(int(A[i, j]) * z[j] for j in range(i))) / int(A[i, i])
            z.append(max(lifts, free))
        order = rng.permutation(n)
        problem = icp.ICP(A[np.ix_(order, order)], q[order], icp.Affine(G[np.ix_(order, order)], c[order]))
        assert blocks(problem).core == 0
        solution = solve_in_parts(problem, 1e-13)
        exact = np.array([float(x) for x in z])[order]
        assert np.allclose(solution.z, exact, rtol=1e-13, atol=1e-13 * np.abs(exact).max())

    def test_a_triangular_matrix_is_solved_in_one_pass_whatever_sweeps_would_need(self):
        """Upper triangular: the unknowns come in the order in which sweeps do not run, and errors grow before."""
        A = sp.diags_array([1.0, -1.5, -0.5], offsets=[0, 1, 2], shape=(500, 500))
        solution = icp.ICP(A, -(A @ np.ones(500))).solve()
        assert "500 follow one by one" in solution.why
        assert np.array_equal(solution.z, np.ones(500))

    @pytest.mark.parametrize("kind", ["affine", "two affine", "elementwise", "jumps"])
    def test_obstacles_that_move(self, kind):
        """ψ couples blocks as A does: the graph is that of both, and what is left out is the same for all maps."""
        rng = np.random.default_rng(5)
        sizes = [80, 1, 6, 1, 3, 1]
        A, order = block_triangular(rng, sizes)
        A += np.diag(np.abs(A).sum(axis=1))
        n, place = len(A), np.argsort(order)
        G = np.zeros((n, n))
        G[place[80], place[3]], G[place[83], place[80]], G[place[90], place[90]] = 0.5, -0.7, 0.4
        G[place[3], place[4]] = 0.1
        upper = None
        if "affine" in kind:
            c = rng.standard_normal(n)
            psi = icp.Affine(G, c)
            upper = icp.Affine(G, c + 0.1) if "two" in kind else None
        elif kind == "elementwise":
            psi = sine(0.5, rng.standard_normal(n))
        else:
            rows, columns = place[[80, 81, 2]], place[[3, 80, 90]]
            psi = icp.Intervention(sp.csr_array(([-0.1, -0.1, 5.0], (rows, columns)), shape=(n, n)))
        problem = icp.ICP(A, rng.standard_normal(n), psi, upper)
        found = blocks(problem)
        assert 80 <= found.core < n
        solution = solve_in_parts(problem)
        assert solution.residual == problem.residual(solution.z)
        assert np.abs(solution.z - plain(problem)).max() <= 1e-6

    @pytest.mark.parametrize("c", [0.0, -np.inf])
    def test_a_block_that_overflows_leaves_an_iterate_of_numbers(self, c):
        A = np.zeros((8, 8))
        A[2, 1:3] = -1e307, 1e307
        problem = icp.ICP(A, np.zeros(8), [0.0, 1000.0, c, *[0.0] * 5])
        assert np.isfinite(attempt(problem, family="modulus", max_iter=100).z).all()

    def test_a_part_of_its_own_gets_a_method_of_its_own(self):
        """A large membrane and a dense P-matrix: what serves one does not serve the other."""
        rng = np.random.default_rng(0)
        membrane = icp.scenes.membrane(n=6400).problem
        A = sp.csr_array(sp.block_diag([membrane.A, p_matrix(rng, 100)]))
        q, psi = np.append(membrane.q, rng.standard_normal(100)), np.append(membrane.psi.c, np.zeros(100))
        problem = icp.ICP(A, q, psi)
        assert [part.size for part in blocks(problem).parts] in ([6400, 100], [100, 6400])
        assert "2 parts do not interact" in repr(blocks(problem))
        solution = solve_in_parts(problem)
        assert np.abs(solution.z[:6400] - membrane.solve().z).max() <= 1e-6


class TestTheRun:
    """The loop, its limits and its callbacks see the whole problem."""

    def problem(self):
        rng = np.random.default_rng(2)
        A, _ = block_triangular(rng, [90, 1, 4, 85, 1], 0.3)
        return icp.ICP(A, rng.standard_normal(len(A)))

    def test_the_callback_sees_iterates_of_full_size_with_their_residual(self):
        problem, seen = self.problem(), []
        solve_in_parts(problem, callback=lambda state: seen.append((state.z.copy(), state.residual)))
        assert len(seen) > 2
        for z, residual in seen:
            assert z.shape == (problem.n,)
            assert residual == pytest.approx(problem.residual(z), rel=1e-9)

    def test_limits_hold_and_ctrl_c_leaves_the_best_iterate(self):
        problem = self.problem()

        def stop(state):
            if state.iteration == 2:
                raise KeyboardInterrupt

        stopped = attempt(problem, callback=stop)
        assert stopped.status is icp.Status.INTERRUPTED
        assert stopped.z.shape == (problem.n,)
        assert stopped.residual == problem.residual(stopped.z) < problem.residual(np.zeros(problem.n))
        assert attempt(problem, max_iter=1).iterations == 1


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
        solution = attempt(problem)
        assert solution.status is icp.Status.INFEASIBLE
        y = solution.infeasible.witness
        assert set(order[np.flatnonzero(y)]) == {0, 1}
        assert min(y) >= 0
        assert exact_value(problem, y, np.zeros(n), np.full(n, np.inf)) < 0

    @pytest.mark.parametrize("n", [20, 60, 80])
    @pytest.mark.parametrize(("b", "solvable"), [(-1.25, False), (-0.75, True), (-1.0, True)])
    def test_what_follows_from_a_block_with_one_answer_may_contradict_itself(self, n, b, solvable):
        """z_0 = 1/2, and z_1 - z_2 + 2 z_0 + b >= 0 with z_2 - z_1 >= 0 needs b >= -1; with z_0 free it has points."""
        A, q = np.eye(n), np.full(n, -1.0)
        A[:3, :3], q[:3] = [[2.0, 0.0, 0.0], [2.0, 1.0, -1.0], [0.0, -1.0, 1.0]], [-1.0, b, 0.0]
        problem = icp.ICP(A, q)
        assert (problem.p(np.r_[1.0, np.ones(n - 1)]) >= 0).all()
        solution = attempt(problem)
        if solvable:
            assert solution.status is not icp.Status.INFEASIBLE
            return
        assert solution.status is icp.Status.INFEASIBLE
        assert "with the proved values of other unknowns" in solution.infeasible.reason
        low, high = np.zeros(n), np.full(n, np.inf)
        low[0] = high[0] = 0.5
        assert exact_value(problem, solution.infeasible.witness, low, high) < 0

    def test_a_block_whose_pieces_have_no_solution_is_one_of_the_whole(self):
        """p_0 = 2 z_1 + 2 > 0, so that z_0 = 0, and then p_1 = -z_1 - 2 < 0 for all z_1 >= 1."""
        n = 80
        A, q = 3.0 * np.eye(n), np.full(n, -1.0)
        A[:2, :2], q[:2] = [[0.0, 2.0], [1.0, -1.0]], [2.0, -2.0]
        A[2:, 1] = 1.0
        psi = np.zeros(n)
        psi[1] = 1.0
        order = np.random.default_rng(0).permutation(n)
        problem = icp.ICP(A[np.ix_(order, order)], q[order], psi[order])
        solution = attempt(problem)
        assert solution.status is icp.Status.INFEASIBLE
        assert "alone: no z solves the problem: none of all 4 choices" in solution.infeasible.reason
        assert all(f"{int(np.flatnonzero(order == row)[0])}" in solution.infeasible.reason for row in (0, 1))

    def test_an_enumeration_is_made_with_the_data_as_given(self):
        """psi = z/2 is fixed, and an empty row is left out, before the first attempt."""
        moving = icp.Affine([[0.5, 0.0], [0.0, 0.5]], [0.0, 0.0])
        for problem, count in (
            (icp.ICP([[1.0, -1.0], [1.0, -2.0]], [2.0, -2.0], moving), 4),
            (icp.ICP([[1.0, -1.0, -1.0], [2.0, -2.0, -1.0], [0.0, 0.0, 0.0]], [2.0, -2.0, 1.0]), 8),
        ):
            assert f"none of all {count} choices" in attempt(problem).infeasible.reason

    def test_a_block_with_several_answers_proves_nothing_of_those_behind_it(self):
        """z_0 >= 0 is any number, z_1 (z_0 - 2) = 0 and z_0 >= 2."""
        solution = attempt(icp.ICP([[0.0, 0.0], [1.0, 0.0]], [0.0, -2.0]))
        assert solution.status is not icp.Status.INFEASIBLE


class TestElimination:
    """Rows without an obstacle are equations: the others see the Schur complement."""

    @pytest.mark.parametrize("kind", ["definite", "rounded", "signs", "box"])
    def test_the_matrix_that_is_left_is_the_schur_complement_and_the_answer_is_that_of_the_whole(self, kind):
        rng = np.random.default_rng(3)
        A = np.array(five_point(12, 0.0).toarray())
        n = len(A)
        bounded = np.isin(np.arange(n), rng.choice(n, 20, replace=False))
        if kind == "rounded":
            A[0, 1] *= 1.0 + 1e-16
            A[1, 50] = 1e-17
        if kind == "signs":  # equilibrium and constraints: [[A, B'], [-B, C]]
            A[n // 2 :, : n // 2] *= -1.0
            bounded &= np.arange(n) < n // 2
        psi = np.where(bounded, rng.standard_normal(n), -np.inf)
        problem = icp.ICP(
            A, rng.standard_normal(n), psi, upper=np.where(bounded, psi + 1.0, np.inf) if kind == "box" else None
        )
        found = elimination(problem, lambda: np.inf)
        assert elimination(problem.with_q(np.ones(n)), lambda: np.inf) is found
        assert np.array_equal(found.rows, np.flatnonzero(bounded))
        C, F = found.rows, np.flatnonzero(~bounded)
        S = A[np.ix_(C, C)] - A[np.ix_(C, F)] @ np.linalg.solve(A[np.ix_(F, F)], A[np.ix_(F, C)])
        assert np.allclose(found.reduced(problem).dense(), S, rtol=1e-12, atol=1e-12)
        z = found.extended(problem, rng.standard_normal(n))
        assert np.abs(problem.p(z)[F]).max() <= 1e-12
        solution = problem.solve()
        assert solution.solved
        assert np.abs(solution.z - plain(problem)).max() <= 1e-6

    @pytest.mark.parametrize("skew", [0.0, 1e-5])
    def test_the_products_of_many_rows_that_are_far_apart_are_counted_and_end_with_the_budget(self, skew):
        n = 20_000
        A = sp.diags_array([np.full(n - 1, -1.0), np.full(n, 2.5), np.full(n - 1, skew - 1.0)], offsets=[-1, 0, 1])
        psi = np.full(n, -np.inf)
        psi[np.random.default_rng(0).choice(n, 200, replace=False)] = 0.0
        problem = icp.ICP(A @ A, np.ones(n), psi)
        least = elimination_cost(problem, np.inf)
        assert least > work.COSTS.dense_flop * n * 200**2
        with pytest.raises(OutOfTime), work.work_limit(nanoseconds=0.5 * least):
            elimination(problem, lambda: np.inf)
        before = work.counter()
        assert elimination(problem, lambda: np.inf)
        assert work.counter() - before < 4.0 * least

    def test_no_elimination_follows_runs_that_cost_less(self):
        """However many problems share A: each one would have to solve with the factors."""
        n = 1728
        line = sp.diags_array([np.full(11, -1.0), np.full(12, 2.0), np.full(11, -1.0)], offsets=[-1, 0, 1])
        one = sp.eye_array(12)
        A = sum(sp.kron(sp.kron(a, b), c) for a, b, c in ((line, one, one), (one, line, one), (one, one, line)))
        psi = np.where(np.arange(n) < 20, -1.0, -np.inf)
        base = icp.ICP(sp.csr_array(A + 6.0 * sp.eye_array(n)), np.full(n, 0.1), psi)
        for step in range(60):
            assert "eliminated" not in base.with_q(np.cos(0.01 * np.arange(n) + 0.05 * step)).solve().why

    @pytest.mark.parametrize("method_runs", [False, True])
    def test_no_answer_is_worse_than_the_start_where_a_complement_is_interrupted(self, method_runs):
        n = 2500
        A = five_point(50, 0.0)
        psi = np.full(n, -np.inf)
        psi[np.random.default_rng(4).choice(n, 40, replace=False)] = 0.2
        base = icp.ICP(sp.csr_array(A @ A), np.ones(n), psi)
        assert "eliminated" in base.solve().why
        problem = base.with_q(1.3 * np.ones(n))

        def stop(now):
            return not method_runs or now.iteration > 0

        outcome = problem.solve(callback=stop, raise_on_failure=False)
        assert problem.residual(outcome.z) <= problem.residual_at_0()

    def test_sweeps_that_diverged_do_not_stand_against_the_elimination(self):
        rng = np.random.default_rng(2)
        n = 1600
        turn = sp.random_array((n, n), density=2 / n, rng=rng)
        psi = np.full(n, -np.inf)
        psi[rng.choice(n, 20, replace=False)] = -1.0
        solution = icp.ICP(five_point(40, 0.0) + 100.0 * (turn - turn.T), np.full(n, 0.1), psi).solve()
        assert solution.solved
        assert "eliminated" in solution.why

    def test_factors_that_are_inaccurate_leave_the_problem_to_other_methods(self):
        n = 1000
        second = sp.diags_array([np.ones(n - 1), -2.0 * np.ones(n), np.ones(n - 1)], offsets=[-1, 0, 1])
        psi = np.full(n, -np.inf)
        psi[n // 2 : n // 2 + 20] = -1.0
        beam = icp.ICP(second @ second, np.full(n, 1e-10), psi)
        for load in (1.0, 1.01, 1.02):
            solution = beam.with_q(load * beam.q).solve(raise_on_failure=False)
            assert solution.status is icp.Status.PRECISION_LIMIT
            assert solution.residual <= 1e-13

    def test_a_large_problem_with_few_obstacles_takes_one_factorisation_and_problems_that_share_A_none(self):
        rng = np.random.default_rng(4)
        membrane = five_point(100, 0.0)
        A = sp.csr_array(membrane @ membrane)  # a plate: multigrid is not made for it
        psi = np.full(10_000, -np.inf)
        psi[rng.choice(10_000, 60, replace=False)] = 0.2
        problem = icp.ICP(A, np.ones(10_000), psi)
        solution = problem.solve()
        assert "eliminated" in solution.why
        touches = solution.z <= psi
        rows = sp.diags_array(~touches * 1.0) @ A + sp.diags_array(touches * 1.0)
        expected = sp.linalg.spsolve(rows.tocsc(), np.where(touches, psi, -1.0))
        assert np.abs(solution.z - expected).max() <= 1e-8 * np.abs(expected).max()
        before = work.counter()
        again = problem.with_q(np.full(10_000, 1.1)).solve()
        assert "eliminated" in again.why
        assert work.counter() - before < factor_cost(factor_costs(problem.matrix).fill)

    def test_factors_that_fail_leave_the_problem_as_it_is(self):
        """p_F = 0 is singular, and still there are solutions."""
        n = 100
        A = sp.csr_array(
            sp.diags_array(
                [np.full(n - 1, -1.0), np.r_[1.0, np.full(n - 2, 2.0), 1.0], np.full(n - 1, -1.0)], offsets=[-1, 0, 1]
            )
        )
        A = sp.csr_array(sp.block_diag([A, five_point(10, 0.0)]))
        psi = np.full(2 * n, -np.inf)
        psi[-8:] = 1.0
        solution = icp.ICP(A, np.zeros(2 * n), psi).solve()
        assert solution.solved
        assert np.abs(solution.problem.p(solution.z)[:n]).max() <= 1e-8

    def test_a_diagonal_that_cancels_is_stored(self):
        """The Schur complement of parallel rows is 0: of its diagonal nothing but rounding is left, or nothing."""
        A = np.tile([0.0, 0.8414709848078965, 0.9092974268256817, 0.1411200080598672, -0.7568024953079282], (5, 1))
        A[4] *= 1e300
        problem = icp.ICP(A, [0.0, 0.0, 0.0, -1.0, 0.0], [0.0, 0.0, 0.0, 0.0, -np.inf])
        assert not attempt(problem, family="modulus", max_iter=100).solved


def test_no_iterate_that_was_shown_is_better_than_the_answer():
    """The best of the rows with an obstacle need not be the best of all rows: here it overflows with the others."""
    units = np.array([1e3, 1e12, 1.0, 1e300, 1e-8, 1e-150, 1.0])
    A = [
        [2645, -703, -333, 1000, -87, -1567, -110],
        [-703, 3037, 467, 100, -1975, -728, -167],
        [-333, 467, 1137, -100, -570, 442, -667],
        [1212, 100, -100, 0, 1000, -1000, -1000],
        [-87, -1975, -570, 1000, 2249, -140, 200],
        [-1567, -728, 442, -1000, -140, 3083, -508],
        [-110, -167, -667, -1000, 200, -508, 1062],
    ]
    q = [-4, -2, 1, 0, -3, 0, 0]
    problem = icp.ICP(units[:, None] * np.array(A), units * q, [0, -np.inf, 0, 0, 0, 0, 0])
    for family in (None, "modulus"):
        for max_iter in (1, 2, 40):
            shown = []
            record = lambda state, shown=shown: shown.append(state.residual)  # noqa: E731
            answer = problem.solve(family=family, raise_on_failure=False, max_iter=max_iter, callback=record)
            assert answer.residual <= np.nanmin(shown)


def test_a_part_behind_a_block_that_overflows_is_no_problem_of_its_own():
    """Its q would be infinite."""
    A = np.zeros((9, 9))
    A[[3, 4, 5, 6, 6, 7], [4, 5, 7, 5, 7, 6]] = [1e-320, 1e-320, 1e-320, -1e-320, 1e-320, -1e-320]
    solution = icp.ICP(A, [0, 0, 0, -1.0, 0, -1.0, 0, 0, 0]).solve(max_iter=100, raise_on_failure=False)
    assert not solution.solved
    assert np.isfinite(solution.z).all()


def test_constants_that_psi_contradicts_are_not_believed():
    """Each row depends on the mean of z, but a number says that it depends on its own unknown alone."""
    square = np.linspace(-1.0, 1.0, 20) ** 2
    hill = 0.5 - np.add.outer(square, square).reshape(-1)
    A = five_point(20)
    runs = [
        icp.ICP(A, np.full(400, 1 / 400), icp.Function(lambda z: hill - 0.3 * z.mean(), lipschitz=number)).solve()
        for number in (None, 0.3)
    ]
    assert runs[0].iterations == runs[1].iterations
    assert np.array_equal(runs[0].z, runs[1].z)


def test_a_solved_part_is_no_end_of_the_whole():
    """Where the other parts fail the run goes on, to the search."""
    rng = np.random.default_rng(255)
    A = rng.integers(1, 9, (15, 15)) * (rng.random((15, 15)) < 0.15)
    assert icp.ICP(A, rng.integers(-9, 9, 15)).solve().solved


def test_an_infeasible_part_is_no_proof_where_the_values_of_others_are_unknown():
    """z = (0, 4e317, -1, -4000), a solution beyond the floats: row 3 is infeasible for all z_1 that are none."""
    t = 1e-317
    A = [[1e5 * t, 2 * t, t, 0], [-1e5 * t, -t, -4 * t, 0], [2e5 * t, 3 * t, 2 * t, 0], [1e5 * t, 2 * t, -3 * t, 0]]
    problem = icp.ICP(A, [4.0, 4.0, 1.0, -2.0], [0.0, 2.0, -1.0, -4000.0])
    assert problem.solve(raise_on_failure=False).status is icp.Status.STAGNATED
