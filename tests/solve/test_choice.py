"""The choice: the bound of its rule, which methods it takes, and that counted work decides alone."""

import math

import numpy as np
import pytest
import scipy.sparse as sp
from benchmarks.families import drawn, family_names
from hypothesis import given, settings
from hypothesis import strategies as st

import icpmodel as icp
from icpmodel import scenes
from icpmodel.algebra.affine_lcp import dense_lcp, lcp_rows
from icpmodel.numerics import work
from icpmodel.solve.choice import Ladder
from icpmodel.solve.estimates import Estimate, estimate_of
from icpmodel.solve.goal import FAMILIES
from icpmodel.solve.jobs import Choice, Job, MethodSequence

PROBLEMS = {name: scenes.scene(name, 60 if "n" in scenes.parameters(name) else None).problem for name in scenes.names()}
PROBLEMS = {name: problem for name, problem in PROBLEMS.items() if problem.f is None}
GRIDS = ("membrane", "bearing", "bai-nonsymmetric")


def chosen(problem, family=None):
    """All methods of the ladder, with their estimates."""
    ladder, found = Ladder(problem, 1e-8, family), []
    while (job := ladder.next()) is not None:
        found.append(job.choice)
        ladder.end(job)
    return found


class TestRule:
    """What the docstring of `select_method` says."""

    def test_structures_go_at_once(self):
        line = np.diag(np.full(80, 2.0)) - np.eye(80, k=1) - np.eye(80, k=-1)
        square = np.kron(np.eye(9), line[:9, :9]) + np.kron(line[:9, :9], np.eye(9))
        moving = lambda z: 0.1 * np.sin(z[::-1])  # noqa: E731
        for problem, kind in (
            (icp.ICP(line, -np.ones(80)), icp.Tridiagonal),
            (icp.ICP(square[:64, :64], -np.ones(64)), icp.Lemke),
            (icp.ICP(square[:64, :64], -np.ones(64), icp.Elementwise(moving, lambda z: 0.1 * np.cos(z))), icp.Josephy),
            (icp.ICP(square[:64, :64], -np.ones(64), icp.Function(moving)), icp.PSOR),
            (icp.ICP(square + np.eye(81), -np.ones(81)), icp.PSOR),
        ):
            assert isinstance(icp.select_method(problem).method, kind)

    def test_pivots_begin_where_they_cost_no_more_than_sweeps(self):
        """Few sweeps do where A is dominant, and more unknowns take more pivots; the pivots need no diagonal."""
        rng = np.random.default_rng(0)
        for n, share, kind in ((100, 0.0, icp.Lemke), (100, 1.0, icp.PSOR), (300, 0.0, icp.PSOR)):
            B = sp.random_array((n, n), density=3.0 / n, rng=rng, format="csr")
            A = B @ B.T + share * sp.diags_array((abs(B) @ abs(B).T).sum(axis=1)) + 1e-3 * sp.eye_array(n)
            assert isinstance(icp.select_method(icp.ICP(A, -np.ones(n))).method, kind)
            assert isinstance(icp.select_method(icp.ICP(A, -np.ones(n)), warm_start=True).method, icp.PSOR)
        block = sp.block_array([[None, sp.eye_array(40)], [-sp.eye_array(40), None]])
        assert isinstance(icp.select_method(icp.ICP(block, np.ones(80))).method, icp.Lemke)

    def test_newton_s_method_does_not_wait_for_pivots_that_cost_more_than_expected(self):
        rng = np.random.default_rng(0)
        B = sp.random_array((100, 100), density=0.03, rng=rng, format="csr")
        for cost in (0.0, 1e12):
            ladder = Ladder(icp.ICP(B @ B.T + 1e-3 * sp.eye_array(100), -np.ones(100)), 1e-8)
            first = ladder.next()
            assert isinstance(first.method, icp.Lemke)
            assert not first.step(0.0, 1.0, 1e-8)
            assert first.step(cost, 1.0, 1e-8) == (cost > 0.0)
            if not cost:
                ladder.end(first)
            names = []
            while (job := ladder.next()) is not None:
                names.append(job.method.name)
                ladder.end(job)
            assert names.count("lemke") == (cost > 0.0)
            assert not cost or names.index("newton") < names.index("lemke") < names.index("restarts")

    def test_a_first_method_that_paused_may_go_on_after_multilevel(self):
        ladder = Ladder(scenes.membrane(n=500**2).problem, 1e-8, None, icp.Newton())
        names = []
        while (job := ladder.next()) is not None:
            names.append(job.method.name)
            if names.count(names[-1]) > 1:
                ladder.end(job)
            else:
                job.step(0.0, 1.0, 1e-8)
                job.step(1e12, 1.0, 1e-8)
        assert names[0] == "newton"
        assert "multilevel" in names
        assert names.count("newton") == 2

    def test_the_estimate_counts_the_rows_that_the_pivots_have(self):
        n = 70
        upper = np.where(np.arange(n) % 3, np.inf, 2.0)
        for above in (None, upper, np.full(n, 2.0)):
            problem = icp.ICP(np.eye(n), -np.ones(n), upper=above)
            assert lcp_rows(problem.facts) == len(dense_lcp(problem).q) == n
            if above is not None:
                moving = problem.with_psi(icp.Affine(0.5 * np.eye(n, k=1), -1.0))
                assert lcp_rows(moving.facts) == len(dense_lcp(moving).q) == n + np.isfinite(above).sum()

    def test_the_estimate_of_newton_s_steps_counts_the_entries_of_a_moving_obstacle(self):
        n = 200
        A = sp.diags_array([2.0 * np.ones(n), -np.ones(n - 1)], offsets=[0, 1], format="csr")
        G = 0.1 * sp.eye_array(n, k=-50) - 0.1 * sp.eye_array(n, k=50)
        fixed, moving = (icp.ICP(A, -np.ones(n), psi).facts for psi in (0.0, icp.Affine(G, 0.0)))
        assert fixed.equations is fixed.matrix
        assert ((moving.equations.sparse != 0) != (abs(A) + abs(G) != 0)).nnz == 0
        for method in (icp.Newton(), icp.Proximal(), icp.Interior()):
            assert estimate_of(method, moving, 1e-8).step > estimate_of(method, fixed, 1e-8).step

    def test_the_choice_is_made_for_what_is_left_when_the_equations_are_eliminated(self):
        problem = scenes.membrane(n=2500).problem
        problem = problem.with_psi(np.where(np.arange(2500) < 20, 0.0, -np.inf))
        assert isinstance(icp.select_method(problem).method, icp.PSOR)
        for shift in range(5):  # what these cost pays for the factors
            problem.with_q(problem.q - shift).solve()
        choice = icp.select_method(problem)
        assert isinstance(choice.method, icp.Lemke)
        assert choice.why.startswith("n = 2500 -> 20 rows")
        assert choice.why.endswith("n = 20 is small")
        assert choice.why in " ".join(str(problem.explain()).split())
        assert isinstance(problem.solve().method, icp.Lemke)

    def test_a_method_goes_on_where_no_global_search_can_follow(self):
        """ψ moves, and nothing is known of its derivative."""
        psi = lambda z: np.abs(z) @ [[-0.25, -0.25], [0.25, 0.125]] + 1.0  # noqa: E731
        assert icp.ICP([[1.0, 0.0], [2.0, 0.0]], [0.5, -4.0], psi).solve().solved

    def test_few_unknowns_are_enumerated_where_pivots_end_in_rays(self):
        solution = icp.ICP([[-1.0, 1.0], [0.0, 0.0]], [-3.0, 0.0], [1.0, 1.0]).solve()
        assert solution.solved
        assert isinstance(solution.method, icp.Enumerate)

    def test_a_sequence_takes_the_method_whose_hierarchy_its_matrix_keeps(self):
        """A trial of sweeps would save no set-up; where few sweeps do, or few unknowns are there, sweeps it is."""
        for n, mu, kind in ((100**2, 0.0, icp.Multilevel), (100**2, 4.0, icp.PSOR), (15**2, 0.0, icp.PSOR)):
            problem = scenes.membrane(n=n, mu=mu).problem
            assert isinstance(icp.select_method(problem, warm_start=True).method, kind)
            before = problem.solve()
            following = problem.with_q(problem.q - 0.01).solve(z0=before)
            assert isinstance(following.method, icp.Multilevel) == (kind is icp.Multilevel)
            assert following.error_bound < 1e-5

    def test_sweeps_are_left_out_where_the_radius_foretells_that_they_cost_more(self):
        problem = scenes.membrane(n=300**2).problem
        for target, name in ((1e-4, "accelerated"), (1e-12, "multilevel")):
            ladder = Ladder(problem, target)
            job = ladder.next()
            assert job.method.name == "psor"
            assert job.step(1e12, 1.0, target)
            assert ladder.next().method.name == name

    @pytest.mark.parametrize("family", FAMILIES)
    def test_a_ladder_keeps_to_its_family_and_its_estimates_are_numbers(self, family):
        kinds = {"paper": {"paper"}, "modulus": {"paper", "modulus"}, None: {"paper", "modulus", "shortcut"}}[family]
        for name, problem in PROBLEMS.items():
            for choice in chosen(problem, family):
                assert choice.method.family in kinds, name
                assert choice.estimate is None or all(math.isfinite(x) and x >= 0.0 for x in choice.estimate), name


class Ends(icp.PSOR):
    finite = True


@st.composite
def scripts(draw):
    """What a method says of its cost, and what it does: steps of one cost, its residual falling in turn."""
    falls = draw(st.lists(st.floats(-2.0, 2.0), min_size=1, max_size=6))
    return draw(st.booleans()), draw(st.floats(0.1, 1e3)), draw(st.floats(0.01, 10.0)), draw(st.integers(1, 300)), falls


class Rungs(MethodSequence):
    """Jobs, of which the one with the least left to do runs."""

    def next(self):
        return min(self.jobs, key=lambda job: job.remaining)


@given(st.lists(scripts(), min_size=1, max_size=5))
@settings(max_examples=200)
def test_the_total_is_at_most_nine_times_what_the_best_one_needs_or_says(candidates):
    """T + 8R: see `select_method`. Looks between steps add a step each."""
    rungs = Rungs()
    for ends, said, cost, steps, falls in candidates:
        job = Job(Choice((Ends if ends else icp.PSOR)(), "", Estimate(0.0, said, 1.0)))
        job.script = cost, steps, falls
        job.residuals.append(1.0)
        rungs.jobs.append(job)
    most, total, over = dict.fromkeys(rungs.jobs, 0.0), 0.0, False
    while not over:
        job = rungs.next()
        for one in rungs.jobs:
            most[one] = max(most[one], one.remaining)
        due = False
        while not (due or over):
            cost, steps, falls = job.script
            total += cost
            due = job.step(cost, job.residuals[-1] * math.exp(-falls[job.steps % len(falls)]), 1e-8)
            over = job.steps == steps
    needs = job.script[0] * job.script[1]
    bound = needs + 2.0 * (len(candidates) - 1) * max(most[job], needs) + sum(2.0 * one.script[0] for one in rungs.jobs)
    assert total <= bound * (1 + 1e-9)


class TestTheSameWay:
    """Nothing but the problem decides: counted work, no clock."""

    @pytest.mark.parametrize("name", GRIDS)
    def test_two_runs_count_the_same_work(self, name):
        def count():
            problem, before = scenes.scene(name, 2500).problem, work.counter()
            problem.solve()
            return work.counter() - before

        first = count()
        assert first > 0.0
        assert count() == pytest.approx(first, rel=1e-12)


def test_a_residual_that_is_rounded_to_0_ends_no_comparison():
    job = Job(Choice(icp.PSOR(), "", Estimate(0.0, 1.0, 1.0)))
    job.residuals.append(1.0)
    assert [job.step(1.0, residual, 1e-8) for residual in (0.5, 0.0)] == [False, True]
    assert math.isfinite(job.remaining)


def test_estimates_beyond_the_floats_end_no_run():
    A = sp.block_diag([np.eye(2), [[1e307, -1e300, 1e300], [-1e300, 2.0, -1.0], [1e300, -1.0, 2.0]]])
    assert icp.ICP(A, np.zeros(5), [0.0, 0.0, 0.0, 1.0, 0.0]).solve().solved


@pytest.mark.parametrize("share", range(8))
def test_every_family_of_the_generator_is_solved(share):
    for family in family_names()[share::8]:
        for n, seed in ((17, 5), (213, 6)):
            problem = drawn(family, n, np.random.default_rng([seed, n]))
            solution = problem.solve(raise_on_failure=False)
            assert solution.solved, (family, n, solution.message)
            assert problem.residual(solution.z) <= solution.tolerance


def test_no_fill_is_asked_for_where_pivots_cost_no_more_than_others_without_any(caplog):
    B = sp.random_array((65, 75), density=0.1, rng=np.random.default_rng(0))
    A = sp.block_array([[None, B], [-B.T, None]], format="csr")
    with caplog.at_level("DEBUG", "icpmodel"):
        solution = icp.ICP(A, np.ones(140)).solve()
    assert isinstance(solution.method, icp.Lemke)
    assert "Newton()" not in caplog.text
