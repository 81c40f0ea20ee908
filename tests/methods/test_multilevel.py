"""Multilevel modulus Newton: its V-cycle, its fixed obstacles, its answers, and how it ends."""

import numpy as np
import pytest
import scipy.sparse as sp

import icpmodel as icp
from icpmodel import scenes
from icpmodel.algebra.hierarchy import Hierarchy, NoHierarchy
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

    @pytest.mark.parametrize("shift", [-10.0, 100.0, 1e9])
    def test_the_levels_of_a_matrix_serve_for_another_diagonal(self, shift):
        """−Δ + d with the interpolation of −Δ: d smooth or with jumps, less negative than the least eigenvalue, 2π²."""
        for n in (20**2, 80**2):
            problem = membrane(n)
            h2 = 1.0 / (n**0.5 + 1.0) ** 2
            for where in (np.ones(n), disc(n, 0.3)):
                d = shift * h2 * where
                matrix = problem.matrix.plus_diagonal(d)
                hierarchy = Hierarchy(problem.with_matrix(matrix, problem.q))
                own = Hierarchy(icp.ICP(matrix.sparse, problem.q))
                assert [level.A.shape for level in hierarchy.levels[:2]] == [level.A.shape for level in own.levels[:2]]
                x = np.random.default_rng(0).normal(size=n)
                first = np.linalg.norm(x)
                for _ in range(8):
                    x -= hierarchy.cycle(matrix.sparse @ x)
                assert np.linalg.norm(x) < 0.5**8 * first

    def test_a_matrix_whose_origin_has_no_levels_has_its_own(self):
        problem = icp.ICP(membrane(900).A - sp.diags_array(np.full(900, 4.0)), np.zeros(900))
        matrix = problem.matrix.plus_diagonal(np.full(900, 4.0))
        assert len(Hierarchy(problem.with_matrix(matrix, problem.q)).levels) > 1


class TestImpulseControl:
    def test_the_start_from_the_coarser_levels_needs_few_steps_at_any_size(self):
        """Policy iteration from 0 needs tens; from the levels below the best jumps are nearly known."""
        for n in (961, 6001):
            scene = scenes.dividend(n=n)
            solution = scene.problem.solve("multilevel")
            assert solution.iterations <= 4
            assert max(scene.errors(solution.z).values()) <= 10 * scene.h**2 + 1e-8


class TestAnswers:
    @pytest.mark.parametrize(
        ("skew", "psi"),
        [(0.0, "constant"), (0.5, "elementwise"), (-0.5, "affine"), (1.0, "function"), (0.0, "function")],
    )
    def test_its_answer_is_that_of_another_method(self, skew, psi):
        """Symmetric A or not, ψ of every kind: the certified bounds of two methods' answers overlap."""
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
        counts = [membrane(m * m).solve(icp.Multilevel()).iterations for m in (20, 60, 120)]
        assert max(counts) <= 6

    def test_random_active_rows_are_found_to_the_accuracy_of_the_run(self):
        """Half of the rows active, at random: the free ones fall into pieces that no coarse grid sees."""
        A, rng = membrane().A, np.random.default_rng(2)
        exact = np.where(rng.random(A.shape[0]) < 0.5, 0.0, rng.random(A.shape[0]))
        force = np.where(exact == 0, rng.random(A.shape[0]), 0.0)
        solution = icp.ICP(A, force - A @ exact).solve(icp.Multilevel())
        assert isinstance(solution.method, icp.Multilevel)
        assert solution.z == pytest.approx(exact, abs=1e-5)

    def test_a_triangular_matrix_takes_one_iteration_in_either_direction(self):
        for skew in (1.0, -1.0):
            assert membrane(skew=skew).solve(icp.Multilevel()).iterations == 1

    def test_a_good_start_is_kept(self):
        problem = membrane()
        before = problem.solve(icp.Multilevel())
        near = problem.with_q(problem.q + 1e-8)
        assert near.solve(icp.Multilevel(), z0=before).iterations <= 3


class TestMatricesThatMultigridIsNotMadeFor:
    """They cost a moment, not all time and memory: the method ends, and `solve` has others."""

    def test_where_coarsening_stalls_there_is_no_hierarchy_and_solve_takes_another_method(self):
        """Nothing is coupled: the coarsest level would be all of A, dense."""
        with pytest.raises(NoHierarchy):
            Hierarchy(icp.ICP(sp.eye_array(100_000), np.ones(100_000)))
        problem = icp.ICP(sp.eye_array(1000, format="csr"), -np.ones(1000))
        assert len(list(icp.Multilevel().iterates(problem, np.zeros(1000)))) == 1
        assert np.array_equal(problem.solve().z, np.ones(1000))

    def test_where_the_levels_fill_in_there_is_no_hierarchy(self):
        """A saddle point with random constraints: its Galerkin products are nearly dense."""
        rng = np.random.default_rng(0)
        K, n = five_point(100, 0.0), 10_000
        B = sp.random_array((3000, n), density=20 / n, rng=rng)
        A = sp.csr_array(sp.block_array([[K, -B.T], [B, sp.eye_array(3000)]]))
        with pytest.raises(NoHierarchy):
            Hierarchy(icp.ICP(A, np.ones(13_000)))


def test_units_in_which_a_norm_underflows_raise_no_exception_of_numpy():
    """Found by the fuzz: a cycle's direction whose norm is 0 while that of its image is not."""
    upper = icp.Affine([[0.0, 0.0], [1.0, -0.1]], [1.0, -1.0])
    problem = icp.ICP([[1e-298, 1e-298], [0.0, 1.0]], [0.0, 0.0], 0.0, upper=upper)
    assert problem.solve("multilevel", raise_on_failure=False).status is icp.Status.CROSSED
