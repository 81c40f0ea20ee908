"""The choice: what the estimates promise, which families it keeps to, and that counted work decides alone."""

import ast
import math
import os
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from benchmarks.families import drawn, family_names

import icpmodel as icp
from icpmodel import methods, scenes
from icpmodel.numerics import work
from icpmodel.numerics.threads import threads_for
from icpmodel.solve.choice import FAMILIES, WEIGHTS
from icpmodel.solve.part import Part
from icpmodel.solve.reduced import ReducedTo, candidates
from icpmodel.solve.schedule import Schedule, Stage

HOUSE = Path(icp.__file__).parent
PROBLEMS = {name: scenes.scene(name, 60 if "n" in scenes.parameters(name) else None).problem for name in scenes.names()}
GRIDS = ("membrane", "bearing", "bai-nonsymmetric")

every_problem = pytest.mark.parametrize("name", PROBLEMS)
every_family = pytest.mark.parametrize("family", family_names())


def made(problem, **options):
    """All candidates of all stages, with what they are expected to cost."""
    return [one for stage in candidates(problem, 1e-8, **options) for one in stage.made()]


def solved_by(problem, **options):
    """The method that found z, and what took part."""
    solution = problem.solve(raise_on_failure=False, **options)
    return solution, {type(solution.method), type(solution.last_method)}


class TestEstimates:
    @every_problem
    def test_they_are_finite_and_positive_for_every_method_that_has_one(self, name):
        problem = PROBLEMS[name]
        for method in map(methods.named, methods.names()):
            if method.why_not(problem) is None and (found := method.estimate(problem.facts, 1e-8)) is not None:
                assert all(math.isfinite(x) and x >= 0.0 for x in found), method
                assert 0.0 < found.total < math.inf, method

    @every_problem
    def test_less_accuracy_never_costs_more(self, name):
        problem = PROBLEMS[name]
        for method in map(methods.named, methods.names()):
            if method.why_not(problem) is None and (found := method.estimate(problem.facts, 1e-10)) is not None:
                assert method.estimate(problem.facts, 1e-3).total <= found.total

    def test_they_are_in_products_with_a(self):
        """Ten products with A count a unit each; a step of sweeps is said to cost about one, for any n."""
        for n in (100, 10_000, 250_000):
            problem = scenes.membrane(n=n).problem
            assert problem.matrix.unit == work.product(problem.n, problem.nnz)
            before = work.done()
            for _ in range(10):
                problem.product(problem.q)
            assert work.done() - before in (0.0, pytest.approx(10.0 * problem.matrix.unit))
        assert 0.5 <= icp.PSOR().estimate(problem.facts, 1e-8).step <= 4.0

    def test_what_psi_reads_is_in_them(self):
        """A row of ψ that adds up all z costs as much as one of A that does, in a sweep and in a Newton step."""
        n = 289
        A, q = scenes.membrane(n=n, mu=4.0).problem.A, -np.ones(n)
        short, long = (icp.ICP(A, q, icp.Affine(G, 0.0)) for G in (0.1 * np.eye(n, k=1), np.full((n, n), 0.1 / n)))
        assert (short.facts.entries, long.facts.entries) == (A.nnz + n - 1, A.nnz + n * n)
        for method in (icp.PSOR(), icp.MNMGS(), icp.Newton()):
            little, much = (method.estimate(one.facts, 1e-8).step for one in (short, long))
            assert much - little >= 0.1 * n * n * work.COSTS.full_entry / short.matrix.unit, method

    def test_old_values_in_the_modulus_drag_rows_along_where_a_couples_them_and_not_where_psi_does(self):
        """1.5 times the sweeps of projected SOR are expected on a grid, and as many where each row waits for another
        one's obstacle; so it is."""
        shift = sp.csr_array(0.9 * np.eye(60)[np.random.default_rng(4).permutation(60)])
        waiting = icp.ICP(sp.eye_array(60, format="csr"), np.ones(60), icp.Affine(shift, 1.0))
        grid = scenes.membrane(n=400).problem
        near = grid.A.diagonal()[0] * sp.eye_array(400) - grid.A
        moving = icp.ICP(grid.A, grid.q, icp.Affine(near / (8.0 * near.max()), grid.psi.value(grid.q)))
        for problem, low, high in ((grid, 1.2, 1.9), (moving, 1.2, 1.9), (waiting, 0.9, 1.1)):
            ours, papers = (method.estimate(problem.facts, 1e-8).steps for method in (icp.PSOR(), icp.MNMGS()))
            assert low <= papers / ours <= high
            ours, papers = (problem.solve(method).iterations for method in (icp.PSOR(), icp.MNMGS()))
            assert low <= papers / ours <= high
        names = [{one.method.name for one, _ in made(one)} & {"psor", "mnmgs"} for one in (waiting, grid)]
        assert names == [{"mnmgs"}, {"psor"}]  # the paper's where it is expected to cost no more

    @every_problem
    def test_sweeps_are_expected_to_creep_and_what_learns_from_its_steps_is_not(self, name):
        for one, expected in made(PROBLEMS[name]):
            if one.method.name in ("psor", "mnmgs", "mnmj", "accelerated", "newton", "multilevel", "proximal"):
                assert expected.creeps == (one.method.name in ("psor", "mnmgs", "mnmj"))

    def test_a_pass_over_a_full_matrix_counts_as_a_product_with_it(self):
        """What facts cost is in products, and those with a full matrix cost a third as much an entry."""
        Q = np.random.default_rng(7).normal(size=(600, 600))
        for stage in candidates(icp.ICP(Q @ Q.T + 600.0 * np.eye(600), -np.ones(600)), 1e-8):
            assert stage.cost <= 45.0

    def test_every_method_that_may_be_picked_has_a_family(self):
        for name in methods.names():
            method = methods.named(name)
            families = [family for family, kinds in FAMILIES.items() if method.family in kinds]
            assert bool(families) == bool(method.family)
            assert not method.family or method.family in WEIGHTS


class TestFamilies:
    @every_problem
    def test_the_paper_s_members_alone_are_made_for_the_paper(self, name):
        assert {one.method.family for one, _ in made(PROBLEMS[name], family="paper")} <= {"paper"}

    @every_problem
    def test_no_shortcut_is_made_for_the_modulus_family(self, name):
        assert {one.method.family for one, _ in made(PROBLEMS[name], family="modulus")} <= {"paper", "modulus", ""}

    def test_a_run_keeps_to_its_family(self):
        for name in GRIDS:
            for family, kinds in (("paper", {"paper"}), ("modulus", {"paper", "modulus"})):
                solution, ran = solved_by(PROBLEMS[name], family=family)
                assert solution.solved
                assert {kind.family for kind in ran if kind is not ReducedTo} <= kinds

    def test_the_parts_of_a_problem_keep_to_it_as_well(self):
        """Two tridiagonal matrices that do not interact, and blocks that would be pivoted."""
        one = scenes.bearing(n=100).problem
        problem = icp.ICP(sp.block_diag([one.A, one.A]), np.tile(one.q, 2))
        (method,) = [one.method for one, _ in made(problem, family="modulus") if one.method.name == "reduced"]
        assert method.family_of_parts == "modulus"
        part = Part(one, np.arange(100), np.zeros(200), 1e-8, "modulus")
        while part.residual > 1e-8 * one.residual_at_0():
            part.step()
        assert {one.candidate.method.family for one in part.run.tried} <= {"paper", "modulus"}
        blocky = icp.ICP(np.kron(np.eye(40), [[2.0, -1.0], [-1.0, 2.0]]), -np.ones(80))
        names = [{one.method.name for one, _ in made(blocky, family=family)} for family in (None, "modulus")]
        assert ["reduced" in found for found in names] == [True, False]

    @every_problem
    def test_the_same_pivots_are_not_made_twice(self, name):
        """Josephy's first step is Lemke's problem where the obstacle is affine."""
        assert len({one.method.name for one, _ in made(PROBLEMS[name])} & {"lemke", "josephy"}) <= 1

    @every_problem
    def test_a_shortcut_begins_only_where_it_is_said_to_cost_half_at_most(self, name):
        """Half of the best modulus method, where all of them are asked."""
        asked = made(PROBLEMS[name])
        first = Schedule(iter([Stage(0.0, lambda: asked)])).turn()
        if first is not None and first.who.method.family == "shortcut":
            others = [expected.cost for one, expected in asked if one.method.family in ("paper", "modulus")]
            assert first.expected.cost <= 0.5 * min(others, default=math.inf)


class TestTheSameWay:
    """Nothing but the problem decides: counted work, no clock."""

    @pytest.mark.parametrize("name", GRIDS)
    def test_two_runs_count_the_same_work(self, name):
        def count():
            problem, before = scenes.scene(name, 2500).problem, work.done()
            problem.solve()
            return work.done() - before

        first = count()
        assert first > 0.0
        assert count() == pytest.approx(first, rel=1e-12)

    @pytest.mark.parametrize("mu", [4.0, 0.5])
    def test_any_number_of_threads_gives_the_same_bits(self, mu, monkeypatch):
        """A has so many entries that all cores are used for it."""

        def answer(cores):
            monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(cores)), raising=False)
            problem = scenes.membrane(n=460**2, mu=mu).problem
            assert threads_for(problem.nnz) == cores
            solution = problem.solve()
            return repr(solution.method), solution.iterations, solution.why, solution.residual, solution.z.tobytes()

        assert answer(1) == answer(2) == answer(3)


@every_family
def test_every_family_of_the_generator_is_solved(family):
    for n, seed in ((17, 5), (213, 6)):
        problem = drawn(family, n, np.random.default_rng([seed, n]))
        solution = problem.solve(raise_on_failure=False)
        assert solution.solved, solution.message
        assert problem.residual(solution.z) <= solution.tolerance


def thresholds(tree):
    """Where an n is compared with a number, or with a constant of the file."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare):
            sides = [node.left, *node.comparators]
            names = {getattr(side, "attr", getattr(side, "id", "")) for side in sides}
            numbers = [
                x for x in sides if isinstance(x, ast.Constant) and type(x.value) in (int, float) and x.value > 1
            ]
            if names & {"n", "nnz", "size"} and (numbers or any(name.isupper() for name in names)):
                yield ast.unparse(node)


#: what is no choice: a batch of small problems is pivoted at once
EXCEPTIONS = {
    "self.problem.n <= PIVOT_UP_TO": "solve/many.py: the rows of a batch share one compiled call, no method is chosen"
}


def test_no_number_of_unknowns_is_a_threshold():
    found = {
        text: str(path.relative_to(HOUSE))
        for room in ("solve", "methods")
        for path in sorted((HOUSE / room).rglob("*.py"))
        for text in thresholds(ast.parse(path.read_text()))
    }
    assert set(found) == set(EXCEPTIONS), found
