"""Every foreign solver finds what is known, and says why it does not."""

import sys
from dataclasses import replace

import numpy as np
import pytest

import icpmodel as icp
from icpmodel.solvers import Claim, ForeignSolver, Target, ask, chosen_solvers, foreign_solvers
from icpmodel.solvers.typical_units import in_typical_units

NATIVE = ("osqp", "osqp, not polished", "clarabel", "piqp", "scs", "highs", "ipopt", "path")
NAMES = (*NATIVE, "cvxpy-clarabel", "cvxpy-highs", "pyomo-highs")


def solved(name, problem, tolerance=1e-11):
    """The solver's z for `problem` in its own units, or the reason why it has none."""
    scaled, unit = in_typical_units(problem)
    solver, target = foreign_solvers()[name], Target(scaled)
    if solver.package is not None and name in NATIVE:
        pytest.importorskip(solver.package)
    reason = solver.why_not(target)
    if reason is not None:
        return reason
    claim = ask(solver, target, tolerance, 20.0)
    assert claim.solved, claim.words
    assert claim.setup is not None
    assert 0 <= claim.setup <= claim.seconds
    return np.asarray(claim.z) * unit


@pytest.mark.parametrize("solver", [name for name in NATIVE if name != "osqp, not polished"])
@pytest.mark.parametrize("name", ["hand-lcp", "hand-free", "hand-degenerate", "hand-negative", "hand-affine"])
def test_a_solver_finds_what_was_found_by_hand(solver, name):
    scene = icp.scenes.scene(name)
    z = solved(solver, scene.problem)
    # where p = r = 0 an interior point is off by the root of its tolerance
    assert z == pytest.approx(scene.z_exact, abs=1e-5 if name == "hand-degenerate" else 1e-6)


# --- the contract ------------------------------------------------------------------------------------------------


def test_every_solver_of_the_room_is_found_by_name_and_asked_by_those_that_it_names():
    known = foreign_solvers()
    assert set(NAMES) <= set(known)
    assert list(known) == sorted(known)

    def asked(asker):
        return {one.name for one in chosen_solvers(None, asker)} & set(NAMES)

    through = {name for name in NAMES if name.startswith(("cvxpy", "pyomo"))}
    assert asked("crosscheck") == {"osqp", "ipopt", "path", *through}
    assert asked("race") == {*NATIVE} - {"ipopt"}


class Exact(ForeignSolver):
    """A solver from outside of the package: it knows the answer of z ↦ 2z − 1, in any units."""

    name, forms, used_by = "test-exact", ("mpec",), ()
    tight = (1e-3,)

    def set_up(self, target, tolerance, time_limit):
        return target.problem

    def run(self, model):
        return Claim(-model.q / model.A.diagonal(), "by heart", True)


def test_a_solver_from_outside_is_found_by_its_name():
    assert isinstance(foreign_solvers()["test-exact"], Exact)
    assert [one.name for one in chosen_solvers(["test-exact", "osqp", "test-exact"])] == ["test-exact", "osqp"]
    row = icp.crosscheck(icp.ICP([[2.0]], [-1.0]), [0.5], ["test-exact"]).rows[0]
    assert (row.solver, row.formulation, row.claim, row.verdict.value) == ("test-exact", "MPEC", "by heart", "agrees")
    assert "test-exact" not in {row.solver for row in icp.crosscheck(icp.ICP([[2.0]], [-1.0]), [0.5]).rows}


def test_an_unfinished_solver_leaves_the_others_alone():
    class Unfinished(ForeignSolver):
        name, used_by = "test-unfinished", ()

        def set_up(self, target, tolerance, time_limit):
            return None

    assert "test-unfinished" not in foreign_solvers()


@pytest.mark.parametrize("name", ["osqp", "highs", "cvxpy-clarabel", "pyomo-highs", "ipopt", "path"])
def test_a_missing_package_is_a_sentence(name, monkeypatch):
    solver = foreign_solvers()[name]
    assert solver.package is not None
    monkeypatch.setitem(sys.modules, solver.package, None)
    reason = solver.why_not(Target(icp.ICP([[2.0]], [-1.0])))
    brings = solver.package if solver.extra is None else f'"icpmodel[{name}]"'
    assert reason == f"{solver.package} is not installed: pip install {brings}"


class Picky(Exact):
    """Succeeds at the last of its tolerances only, as HiGHS, which calls a problem infeasible at a tight one."""

    tight = (1e-12, 1e-9, 1e-6)
    asked: list[float]

    def set_up(self, target, tolerance, time_limit):
        self.asked = [*getattr(self, "asked", []), tolerance]
        return target.problem, tolerance

    def run(self, model):
        problem, tolerance = model
        found = super().run(problem)
        return found if tolerance == 1e-6 else replace(found, words="infeasible", solved=False)


def test_a_failure_at_a_tight_tolerance_is_repeated_more_loosely_and_reported():
    solver = Picky()
    report = icp.crosscheck(icp.ICP([[2.0]], [-1.0]), [0.5], [solver])
    assert solver.asked == [1e-12, 1e-9, 1e-6]
    assert report.agrees
    assert report.rows[0].claim == "by heart, at 1e-06"
