"""The choice: what the estimates promise, which families it keeps to, and that counted work decides alone."""

import math
import os

import numpy as np
import pytest
from benchmarks.families import drawn, family_names

from icpmodel import methods, scenes
from icpmodel.numerics import work
from icpmodel.numerics.threads import threads_for
from icpmodel.solve.choice import FAMILIES, WEIGHTS
from icpmodel.solve.reduced import ReducedTo, candidates

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
