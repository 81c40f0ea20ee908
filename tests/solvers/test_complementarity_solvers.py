"""PATH and IPOPT: the forms that they are given are right, convex or not, and their programs leave nothing behind."""

import os
import sys
import tempfile
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from known_answers import SEEDS
from test_foreign_solvers import solved
from test_two_sided_targets import box

import icpmodel as icp
from icpmodel.solvers import Target, ask, foreign_solvers
from icpmodel.solvers.path import mixed_problem

posix = pytest.mark.skipif(os.name != "posix", reason="makes an executable shell script")


@pytest.fixture(params=["ipopt", "path"])
def solver(request):
    found = foreign_solvers()[request.param]
    pytest.importorskip(found.package)
    return found


@pytest.mark.parametrize("seed", range(3))
def test_obstacles_that_do_not_move_alike_need_no_convexity(solver, seed):
    problem, z = box(seed, kind="apart")
    assert not Target(problem).parallel
    assert solved(solver.name, problem, solver.tight[0]) == pytest.approx(z, abs=1e-6)


def test_a_p_matrix_that_no_convex_program_takes_is_solved(solver):
    problem = icp.ICP([[1.0, 0.0], [6.0, 1.0]], [-1.0, -3.0])
    assert foreign_solvers()["osqp"].why_not(Target(problem)) is not None
    report = problem.crosscheck([1.0, 0.0], [solver])
    assert report.agrees, str(report)
    assert not problem.crosscheck([1.001, 0.0], [solver]).agrees


def test_what_has_no_solution_is_not_called_solved(solver):
    claim = ask(solver, Target(icp.scenes.hard_infeasible().problem), solver.tight[0], 20.0)
    assert not claim.solved
    assert claim.words in ("infeasible", "Diverging_Iterates")


@given(seed=SEEDS, kind=st.sampled_from(["symmetric", "skew", "alike", "apart"]))
def test_the_mixed_problem_has_the_solution_with_the_multipliers_of_what_moves(seed, kind):
    problem, z = box(seed, kind=kind)
    target = Target(problem)
    M, b, least, most = mixed_problem(target)
    p, moves = problem.p(z), not problem.psi.is_constant
    u, v = np.maximum(p, 0.0)[np.isfinite(target.c)], np.maximum(-p, 0.0)[np.isfinite(target.d)]
    x = np.concatenate([z, u, v]) if moves else z
    assert foreign_solvers()["path"].size(target) == b.size == x.size
    other = x + np.eye(x.size)[0]
    right, wrong = (np.abs(np.median([M @ y + b, y - least, y - most], axis=0)).max() for y in (x, other))
    assert right <= 1e-9
    assert wrong > 1e-6


def test_the_licence_counts_the_multipliers_as_well(monkeypatch):
    monkeypatch.setitem(sys.modules, "gamspy_base", SimpleNamespace(directory="nowhere"))
    path = foreign_solvers()["path"]
    assert path.why_not(Target(icp.ICP(4.0 * np.eye(1000), np.ones(1000)))) is None
    assert path.why_not(Target(icp.ICP(4.0 * np.eye(1001), np.ones(1001)))) == (
        "the demo licence of GAMS takes no model beyond n = 1000; this n is 1001"
    )
    moving = icp.ICP(4.0 * np.eye(600), np.ones(600), icp.Affine(0.1 * np.eye(600), 0.0))
    assert str(path.why_not(Target(moving))).endswith("this n is 600, and 600 further unknowns count as well")


def fake_gams(tmp_path, monkeypatch, script):
    """A program in the place of GAMS; returns the folder where temporary ones are made."""
    gams, folder = tmp_path / "gams", tmp_path / "temporary"
    gams.write_text(f"#!/bin/sh\necho $$ > {tmp_path}/pid\n{script}\n")
    gams.chmod(0o755)
    folder.mkdir()
    monkeypatch.setitem(sys.modules, "gamspy_base", SimpleNamespace(directory=str(tmp_path)))
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


@posix
def test_a_success_of_path_at_a_wrong_answer_is_recorded_and_not_believed(tmp_path, monkeypatch):
    folder = fake_gams(tmp_path, monkeypatch, "echo 0.25 > answer.txt; echo ' ** EXIT - solution found.'")
    row = icp.crosscheck(icp.ICP([[2.0]], [-1.0]), [0.5], ["path"]).rows[0]
    assert (row.verdict.value, row.claim) == ("loose", "solution found")
    assert list(folder.iterdir()) == []


@posix
def test_at_the_time_limit_gams_is_killed_and_its_folder_removed(tmp_path, monkeypatch):
    folder = fake_gams(tmp_path, monkeypatch, "exec sleep 60")
    claim = ask(foreign_solvers()["path"], Target(icp.ICP([[2.0]], [-1.0])), 1e-10, 0.5)
    assert (claim.words, claim.solved) == ("time limit", False)
    assert list(folder.iterdir()) == []
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "pid").read_text()), 0)


def test_ipopt_keeps_its_time_limit():
    pytest.importorskip("casadi")
    claim = ask(foreign_solvers()["ipopt"], Target(icp.scenes.membrane(n=100).problem), 1e-10, 1e-6)
    assert (claim.words, claim.solved) == ("Maximum_WallTime_Exceeded", False)


def test_ipopt_solves_the_nonlinear_form_whatever_the_answer_under_test():
    pytest.importorskip("casadi")
    problem = icp.ICP.nonlinear(lambda z: z**2 - [4, -1], psi=[0, 0])
    right = problem.crosscheck([2.0, 0.0], ["ipopt"])
    assert [(row.formulation, row.verdict.value) for row in right.rows] == [
        ("tangent MPEC", "agrees"),
        ("NLP", "agrees"),
    ]
    assert right.coverage().startswith("Confirmed: the whole problem by ipopt; with p replaced by its tangent")
    assert len(problem.crosscheck([2.0, 0.0], ["osqp"]).rows) == 1  # it takes no nonlinear p, and need not say so
    wrong = problem.crosscheck([3.0, 0.0], ["ipopt"]).rows[-1]
    assert (wrong.formulation, wrong.verdict.value) == ("NLP", "disagrees")
    assert wrong.difference == pytest.approx(1.0)


def test_ipopt_shortens_its_steps_where_f_has_no_value():
    pytest.importorskip("casadi")

    def root(z):
        if (z < 0).any():
            raise ValueError("no root")
        return np.sqrt(z) - [3.0, -1.0]

    scale = 1e6  # in the units of a user
    problem = icp.ICP.nonlinear(lambda z: scale * root(z), psi=[0.0, 1e-3])
    assert problem.crosscheck([9.0, 1e-3], ["ipopt"]).rows[-1].verdict.value == "agrees"


@pytest.mark.parametrize("name", ["radiating-membrane", "soft-contact"])
def test_ipopt_agrees_on_scenes_with_nonlinear_p(name):
    pytest.importorskip("casadi")
    problem = icp.scenes.scene(name).problem
    last = problem.crosscheck(solvers=["ipopt"]).rows[-1]
    assert last.formulation.endswith("NLP")
    assert last.verdict.value == "agrees"
