"""Multilevel modulus Newton: its V-cycle, its fixed obstacles, its answers, and how it ends."""

from itertools import pairwise

import numpy as np
import pytest
import scipy.sparse as sp
from benchmarks.families import drawn
from hypothesis import given, settings
from hypothesis import strategies as st

import icpmodel as icp
from icpmodel import scenes
from icpmodel.algebra.hierarchy import Hierarchy, NoHierarchy
from icpmodel.algebra.subproblems import with_fixed_obstacle
from icpmodel.methods.multilevel import coarse_problem
from icpmodel.scenes.grid import five_point


def membrane(n=40**2, **options):
    return scenes.membrane(n=n, **options).problem


def disc(n, radius):
    """The free rows outside a disc in the middle of the square."""
    points = scenes.membrane(n=n).points
    return np.hypot(*(points - 0.5).T) > radius


class TestVCycle:
    @pytest.mark.parametrize("radius", [0.0, 0.1, 0.4])
    def test_it_halves_the_error_on_the_free_rows_and_leaves_the_others_at_zero(self, radius):
        """Steps x ← x + cycle(f − Ax) converge to the solution of A_FF x = f_F, in few steps whatever n is."""
        for n in (20**2, 80**2):
            A, free = membrane(n).A, disc(n, radius)
            hierarchy = Hierarchy(icp.ICP(A, np.zeros(A.shape[0])))
            hierarchy.restrict(free)
            f = np.random.default_rng(0).normal(size=n)
            exact = np.zeros(n)
            exact[free] = sp.linalg.spsolve(sp.csc_array(A[free][:, free]), f[free])
            x, errors = np.zeros(n), []
            for _ in range(8):
                x += hierarchy.cycle(np.where(free, f - A @ x, 0.0))
                errors.append(np.linalg.norm(x - exact))
            assert not x[~free].any()
            assert errors[-1] < 0.5**8 * np.linalg.norm(exact)

    def test_it_is_a_symmetric_operator_where_A_is_symmetric(self):
        n = 30**2
        hierarchy, free = Hierarchy(membrane(n)), disc(n, 0.2)
        hierarchy.restrict(free)
        f, g = np.random.default_rng(1).normal(size=(2, n)) * free
        assert g @ hierarchy.cycle(f) == pytest.approx(f @ hierarchy.cycle(g), rel=1e-10)

    @pytest.mark.parametrize("skew", [0.0, 0.5])
    def test_the_cycle_of_the_transposed_matrix_is_its_adjoint(self, skew):
        """⟨g, Bf⟩ = ⟨Bᵀg, f⟩ to rounding, on whatever rows are free."""
        n = 30**2
        hierarchy = Hierarchy(membrane(n, skew=skew))
        for free in (disc(n, 0.2), disc(n, 0.4)):
            hierarchy.restrict(free)
            f, g = np.random.default_rng(1).normal(size=(2, n)) * free
            assert g @ hierarchy.cycle(f) == pytest.approx(f @ hierarchy.transposed.cycle(g), rel=1e-10)
            assert (hierarchy.transposed is hierarchy) is (skew == 0.0)

    def test_a_small_matrix_is_solved_exactly(self):
        A = sp.csr_array(np.array([[2.0, -1.0, 0.0], [-1.0, 3.0, -1.0], [0.0, -1.0, 2.0]]))
        hierarchy = Hierarchy(icp.ICP(A, np.zeros(A.shape[0])))
        hierarchy.restrict(np.array([True, True, False]))
        assert hierarchy.cycle(np.array([1.0, 2.0, 7.0])) == pytest.approx([1.0, 1.0, 0.0])

    def test_interpolation_leaves_the_kept_points_alone(self):
        for level in Hierarchy(membrane()).levels[:-1]:
            assert abs(level.P[level.kept] - sp.eye_array(level.P.shape[1])).max() == 0

    def test_a_diagonal_that_is_not_positive_is_refused(self):
        with pytest.raises(NoHierarchy):
            Hierarchy(icp.ICP([[0.0, 1.0], [1.0, 1.0]], [0.0, 0.0]))


class TestFixedObstacle:
    @settings(deadline=None)
    @given(
        slope=st.floats(-0.99, 0.99),
        bend=st.floats(0.0, 0.99),
        c=st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=4),
        known=st.booleans(),
    )
    def test_psi_meets_z_at_the_fixed_obstacle(self, slope, bend, c, known):
        """r_i(c_i) = 0 to rounding, for ψ_i(z) = f(z_i) + c_i with |f′| ≤ ℓ < 1, with and without a derivative."""
        bend = min(bend, 0.99 - abs(slope))

        def f(z):
            return slope * z + bend * np.sin(z)

        n, steep = len(c), abs(slope) + bend
        psi = icp.Elementwise(f, (lambda z: slope + bend * np.cos(z)) if known else None, steep, np.array(c))
        problem = icp.ICP(np.eye(n), np.zeros(n), psi)
        fixed = with_fixed_obstacle(problem).psi.c
        size = np.abs(fixed).max() + np.abs(np.array(c)).max()
        assert np.abs(problem.r(fixed)).max() <= 1e-14 * size + 1e-320  # where size is subnormal, digits are few

    def test_a_derivative_saves_evaluations(self):
        calls = []

        def f(z):
            calls.append(1)
            return 0.9 * np.cos(z)

        for derivative, fewest, most in ((lambda z: -0.9 * np.sin(z), 3, 8), (None, 9, 100)):
            calls.clear()
            problem = icp.ICP(np.eye(3), np.zeros(3), icp.Elementwise(f, derivative, 0.9, [1.0, 2.0, 3.0]))
            with_fixed_obstacle(problem)
            assert fewest <= len(calls) <= most

    def test_rows_without_obstacle_stay_so(self):
        psi = icp.Affine([[0.5, 0.0], [0.0, -0.5]], [-np.inf, 3.0])
        fixed = with_fixed_obstacle(icp.ICP(np.eye(2), np.zeros(2), psi)).psi.c
        assert fixed.tolist() == [-np.inf, 2.0]

    def test_only_maps_that_move_row_by_row_and_by_less_than_z_have_one(self):
        for psi, expected in (
            (1.0, True),
            (icp.Elementwise(np.sin, lipschitz=0.99), True),
            (icp.Elementwise(np.sin, lipschitz=1.0), False),
            (icp.Elementwise(np.sin, np.cos), False),
            (icp.Affine([[0.0, 0.5], [0.0, 0.0]]), False),
            (icp.Affine([[0.5, 0.0], [0.0, 0.5]]), True),
            (icp.Function(np.sin, lipschitz=0.5), True),
            (np.sin, False),
        ):
            assert icp.ICP(np.eye(2), np.zeros(2), psi).facts.has_fixed_obstacle is expected

    def test_the_lcp_has_the_solutions_of_the_problem(self):
        problem = membrane().with_psi(
            icp.Elementwise(lambda z: 0.3 * np.sin(3 * z), lambda z: 0.9 * np.cos(3 * z), 0.9, membrane().psi.c)
        )
        z = with_fixed_obstacle(problem).solve("psor", rtol=1e-12).z
        assert problem.residual(z) < 1e-10


class TestCoarserLevels:
    @pytest.mark.parametrize("isolated", [True, False])
    def test_without_obstacle_each_level_of_a_tridiagonal_matrix_has_the_same_answer(self, isolated):
        """Pz_c + s is then the fine answer: no q is lost, not in rows without neighbour nor at a one-sided end."""
        n = 500
        rng = np.random.default_rng(0)
        left, right = -1.0 - 0.1 * rng.random((2, n - 1))
        left[-1] *= 2.0
        if isolated:
            right[0] = 0.0
        middle = 0.01 - np.concatenate([[0.0], left]) - np.concatenate([right, [0.0]])
        problem = icp.ICP(sp.diags_array([left, middle, right], offsets=[-1, 0, 1]), rng.normal(size=n), -np.inf)
        for level, coarser in pairwise(Hierarchy(problem).levels):
            coarse, shift = coarse_problem(problem, level, coarser)
            z, below = (sp.linalg.spsolve(sp.csc_array(one.A), -one.q) for one in (problem, coarse))
            assert level.P @ below + shift == pytest.approx(z, rel=1e-9, abs=1e-9)
            problem = coarse

    @pytest.mark.parametrize("kind", ["constant", "affine", "function", "intervention"])
    def test_psi_is_carried_down_to_the_points_that_are_kept(self, kind):
        """ψ_c(z) = ψ(Pz + s) there, through all levels, and so is its derivative."""
        rng, n = np.random.default_rng(1), 20**2
        G = sp.random_array((n, n), density=0.01, rng=rng).tocsr()
        psi = {
            "constant": rng.normal(size=n),
            "affine": icp.Affine(G, rng.normal(size=n)),
            "function": icp.Function(lambda z: G @ np.sin(z), lambda z: G * np.cos(z)),
            "intervention": icp.Intervention(-G),
        }[kind]
        problem = fine = icp.ICP(membrane(n).A, rng.normal(size=n), psi)
        up, kept = (lambda z: z), np.arange(n)
        for level, coarser in pairwise(Hierarchy(fine).levels):
            problem, shift = coarse_problem(problem, level, coarser)
            z, h = rng.normal(size=(2, problem.n))
            kept, up = kept[level.kept], lambda z, up=up, level=level, shift=shift: up(level.P @ z + shift)
            assert problem.psi.value(z) == pytest.approx(fine.psi.value(up(z))[kept], abs=1e-12)
            moved = fine.psi.jacobian(up(z)) @ (up(z + h) - up(z))
            assert problem.psi.jacobian(z) @ h == pytest.approx(moved[kept], abs=1e-10)


def harvest(n, shared):
    """Tridiagonal impulse control: growth with drift, jumps back to one of a few points or by a fixed length."""
    h = 1.0 / n
    left, right = -1.0 / h**2 - 2.0 / h, -1.0 / h**2 + 2.0 / h
    A = sp.diags_array([left, 2.0 / h**2 + 1.0, right], offsets=[-1, 0, 1], shape=(n, n))
    x = np.arange(n) * h
    rows = np.arange(n // 2, n)
    targets = [n // 10, n // 7, n // 5] if shared else [0]
    i = np.concatenate([rows for _ in targets])
    j = np.concatenate([np.full(rows.size, t) if shared else rows - n // 4 for t in targets])
    jumps = sp.csr_array((x[i] - x[j] - 0.05, (i, j)), shape=(n, n))
    return icp.ICP(A, -np.sin(2 * x), icp.Intervention(jumps))


class TestImpulseControl:
    def test_the_start_from_the_coarser_levels_needs_few_steps_at_any_size(self):
        """Policy iteration from 0 needs tens; from the levels below the best jumps are nearly known."""
        for n in (961, 6001, 25_601):
            scene = scenes.dividend(n=n)
            solution = scene.problem.solve("multilevel")
            assert solution.iterations <= 4
            assert max(scene.errors(solution.z).values()) <= 10 * scene.h**2 + 1e-8

    @pytest.mark.parametrize("shared", [True, False])
    def test_its_answer_is_that_of_policy_iteration(self, shared):
        problem = harvest(1200, shared)
        ours, other = problem.solve("multilevel"), problem.solve("newton")
        assert isinstance(ours.method, icp.Multilevel)
        assert (ours.r < ours.p).any()
        assert ours.z == pytest.approx(other.z, rel=1e-7)

    def test_the_start_nearly_solves_the_problem(self):
        problem = scenes.dividend(n=6001).problem
        start = icp.Multilevel().start(Hierarchy(problem), problem)
        assert problem.residual(start) <= 1e-6 * problem.residual(np.zeros(problem.n))

    def test_a_start_that_is_worse_than_none_is_not_taken(self):
        class Astray(icp.Multilevel):
            def start(self, hierarchy, problem):
                return np.full(problem.n, 1e6)

        problem = scenes.dividend(n=61).problem
        path = Astray().iterates(problem, np.zeros(61))
        next(path)
        assert not next(path)[0].any()

    def test_a_good_start_is_kept(self):
        problem = scenes.dividend(n=961).problem
        z = problem.solve("newton").z
        assert problem.solve("multilevel", z0=z).iterations == 0


class TestAnswers:
    @pytest.mark.parametrize("skew", [0.0, 0.5, -0.5, 1.0, -1.0])
    @pytest.mark.parametrize("psi", ["constant", "elementwise", "affine", "function"])
    def test_its_answer_is_that_of_another_method(self, skew, psi):
        """Symmetric and nonsymmetric A, ψ of every kind: the certified bounds of two methods' answers overlap."""
        problem = membrane(skew=skew)
        c, m = problem.psi.c, 40
        G = sp.kron(sp.eye_array(m), sp.diags_array([0.25, 0.25], offsets=[-1, 1], shape=(m, m)))
        maps = {
            "constant": c,
            "elementwise": icp.Elementwise(lambda z: -0.3 * np.sin(3 * z), lambda z: -0.9 * np.cos(3 * z), 0.9, c),
            "affine": icp.Affine(G, c - 0.2),
            "function": icp.Function(lambda z: 0.5 * G @ np.sin(z) + c, lambda z: 0.5 * G * np.cos(z), 0.5 * G),
        }
        problem = problem.with_psi(maps[psi])
        ours, other = problem.solve(icp.Multilevel(), rtol=1e-10), problem.solve("psor", rtol=1e-10)
        assert isinstance(ours.method, icp.Multilevel)
        assert ours.iterations <= 10
        assert np.abs(ours.z - other.z).max() <= ours.error_bound + other.error_bound <= 1e-5

    def test_a_psi_without_known_slope_bound_is_followed_by_its_derivative(self):
        """Where ψ falls as z grows, p and r have to be compared in like units, or the active set swings."""
        c = membrane().psi.c
        psi = icp.Elementwise(lambda z: -np.sin(z), lambda z: -np.cos(z), c=c)
        assert not membrane().with_psi(psi).facts.has_fixed_obstacle
        solution = membrane().with_psi(psi).solve(icp.Multilevel())
        assert isinstance(solution.method, icp.Multilevel)
        assert solution.iterations <= 8

    def test_the_steps_do_not_grow_with_the_grid(self):
        counts = [membrane(m * m).solve(icp.Multilevel()).iterations for m in (20, 60, 180)]
        assert max(counts) <= 6

    def test_scattered_active_rows(self):
        """Half of the rows active, at random: the free ones fall into pieces that no coarse grid sees."""
        A, rng = membrane().A, np.random.default_rng(2)
        exact = np.where(rng.random(A.shape[0]) < 0.5, 0.0, rng.random(A.shape[0]))
        force = np.where(exact == 0, rng.random(A.shape[0]), 0.0)
        solution = icp.ICP(A, force - A @ exact).solve(icp.Multilevel())
        assert isinstance(solution.method, icp.Multilevel)
        assert solution.z == pytest.approx(exact, abs=1e-5)

    def test_a_triangular_matrix_takes_one_look_in_either_direction(self):
        for skew in (1.0, -1.0):
            assert membrane(skew=skew).solve(icp.Multilevel()).iterations == 1

    def test_a_good_start_is_kept(self):
        problem = membrane()
        before = problem.solve(icp.Multilevel())
        near = problem.with_q(problem.q + 1e-6)
        assert near.solve(icp.Multilevel(), z0=before).iterations <= 3

    @pytest.mark.parametrize("n", [801, 4001])
    def test_a_start_that_is_smooth_and_far_away_does_not_lead_it_astray(self, n):
        """What sweeps leave has a small residual, and an active set that is wrong in many rows: the levels help."""
        problem = scenes.game_put(n=n).problem
        smooth = problem.solve("accelerated", max_iter=60, raise_on_failure=False).z
        assert problem.residual(smooth) <= 1e-2 * problem.residual(np.zeros(n))
        afresh, after = (problem.solve(icp.Multilevel(), z0=z) for z in (np.zeros(n), smooth))
        assert after.solved
        assert after.iterations <= afresh.iterations + 3

    @pytest.mark.parametrize("scale", [1e-100, 1e100])
    def test_units_of_z(self, scale):
        """The same steps whatever z is measured in."""
        problem = membrane()
        other = icp.ICP(problem.A, problem.q * scale, problem.psi.c * scale).solve(icp.Multilevel())
        assert other.z / scale == pytest.approx(problem.solve(icp.Multilevel()).z, rel=1e-10)

    def test_pieces_and_rows_that_stand_alone(self):
        A = sp.block_diag([membrane(20**2).A, sp.eye_array(50), membrane(15**2).A], format="csr")
        q = np.random.default_rng(3).normal(size=A.shape[0])
        problem = icp.ICP(A, q, -0.5)
        assert problem.solve(icp.Multilevel()).z == pytest.approx(problem.solve("psor", rtol=1e-12).z, abs=1e-6)

    def test_all_rows_active_and_all_rows_free(self):
        problem = membrane()
        assert icp.ICP(problem.A, 1.0 + 0 * problem.q).solve(icp.Multilevel()).z == pytest.approx(0.0)
        free = icp.ICP(problem.A, problem.q - 1.0, -np.inf).solve(icp.Multilevel(), rtol=1e-12).z
        assert problem.A @ free == pytest.approx(1.0, abs=1e-8)


class TestWhereItLeadsNowhere:
    def test_it_ends_after_a_few_looks_and_another_method_solves_the_problem(self):
        """A cyclic matrix is P, but nothing for multigrid."""
        problem = scenes.hand_cyclic().problem
        solution = problem.solve(icp.Multilevel(), raise_on_failure=False)
        assert solution.status is icp.Status.STAGNATED
        assert solution.iterations < 20
        assert problem.solve().solved

    def test_without_a_derivative_it_stands_still(self):
        """The status says that the iterates stand still."""
        A = scenes.hand_cyclic().problem.A
        psi = icp.Elementwise(lambda z: 0.1 * np.sin(z), lipschitz=0.1)
        solution = icp.ICP(A, [-1.0, -1.0, -1.0], psi).solve(icp.Multilevel(), raise_on_failure=False)
        assert solution.solved or solution.status in (icp.Status.STAGNATED, icp.Status.PRECISION_LIMIT)
        assert isinstance(solution.method, icp.Multilevel)

    def test_a_psi_that_fails_late_leaves_the_best_iterate(self):
        calls = []

        def psi(z):
            calls.append(1)
            if len(calls) > 12:
                raise RuntimeError("late")
            return 0.5 * np.sin(z)

        problem = membrane().with_psi(icp.Function(psi, lambda z: sp.diags_array(0.5 * np.cos(z))))
        solution = problem.solve(icp.Multilevel(), raise_on_failure=False)
        assert solution.status in (icp.Status.MAP_FAILED, icp.Status.SOLVED)
        assert np.isfinite(solution.z).all()

    def test_a_slope_that_is_not_finite_is_named(self):
        psi = icp.Elementwise(lambda z: 0 * z + 1.0, lambda z: np.full(z.shape, np.nan))
        solution = membrane().with_psi(psi).solve(icp.Multilevel(), raise_on_failure=False)
        assert solution.status is icp.Status.MAP_FAILED
        assert "psi's derivative is not finite" in solution.message


def test_for_the_best_of_several_jumps_it_is_newton_from_the_coarser_levels():
    problem = scenes.dividend(n=211).problem
    (_, _), *path = icp.Multilevel().iterates(problem, np.zeros(211))
    newton = icp.Newton().iterates(problem, path[0][0])
    assert all(np.array_equal(z, other) for (z, _), (other, _) in zip(path, newton, strict=True))
    assert problem.residual(path[0][0]) < problem.residual_at_0()


class TestMatricesThatMultigridIsNotMadeFor:
    """They cost a moment, not all time and memory: the method ends, and `solve` has others."""

    def test_coarsening_that_stalls(self):
        """Nothing is coupled: the coarsest level would be all of A, dense."""
        with pytest.raises(NoHierarchy):
            Hierarchy(icp.ICP(sp.eye_array(100_000), np.ones(100_000)))
        problem = icp.ICP(sp.eye_array(1000, format="csr"), -np.ones(1000))
        assert len(list(icp.Multilevel().iterates(problem, np.zeros(1000)))) == 1
        assert np.array_equal(problem.solve().z, np.ones(1000))

    def test_levels_that_fill_in(self):
        """A saddle point with random constraints: its Galerkin products are nearly dense."""
        rng = np.random.default_rng(0)
        K, n = five_point(100, 0.0), 10_000
        B = sp.random_array((3000, n), density=20 / n, rng=rng)
        A = sp.csr_array(sp.block_array([[K, -B.T], [B, sp.eye_array(3000)]]))
        with pytest.raises(NoHierarchy):
            Hierarchy(icp.ICP(A, np.ones(13_000)))

    def test_a_grid_in_three_dimensions_does_not_fill_in(self):
        line = sp.diags_array([-np.ones(19), 2.0 * np.ones(20), -np.ones(19)], offsets=[-1, 0, 1])
        eye = sp.eye_array(20)
        plane = sp.kron(line, eye) + sp.kron(eye, line)
        A = sp.csr_array(sp.kron(plane, eye) + sp.kron(sp.eye_array(400), line))
        assert len(Hierarchy(icp.ICP(A, np.ones(8000))).levels) > 3


def test_a_radius_whose_square_overflows_is_no_foreign_exception():
    assert icp.Multilevel().estimate(icp.ICP([[1e-200, 1.0], [1.0, 1e-200]], [1.0, 1.0]).facts, 1e-8).steps == np.inf


def test_units_in_which_a_length_underflows_are_no_foreign_exception():
    """Found by the fuzz: a cycle's direction whose norm is 0 while that of its image is not."""
    rows = icp.solve_many([[1e291, -1e-175], [-1e265, 1e-201]], [[0.0, 1.0]], [0.0, 0.0], raise_on_failure=False)
    assert len(rows.statuses) == 1
    upper = icp.Affine([[0.0, 0.0], [1.0, -0.1]], [1.0, -1.0])
    problem = icp.ICP([[1e-298, 1e-298], [0.0, 1.0]], [0.0, 0.0], 0.0, upper=upper)
    assert problem.solve("multilevel", raise_on_failure=False).status is icp.Status.CROSSED
    # the obstacles cross at (0, 0), and (1, 0) leaves 1e-298: whether a step comes to it is decided by the last digits,
    # which the kernels of OpenBLAS for different processors round differently
    assert problem.solve(z0=[1.0, 0.0]).z.tolist() == [1.0, 0.0]
    solution = problem.solve(raise_on_failure=False)
    if solution.solved:
        assert solution.z == pytest.approx([1.0, 0.0], abs=1e-15)
    else:
        assert solution.status is icp.Status.CROSSED


def test_krylov_steps_go_on_from_where_sweeps_left_z_though_the_active_set_is_the_one_before():
    """They went on with the residual from before the sweeps, and ended at five times the tolerance."""
    problem = drawn("option-cross", 1200, np.random.default_rng(4))
    assert problem.solve("multilevel", rtol=1e-10).solved
