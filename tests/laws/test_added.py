"""What is added outside the package is found by its name: a method, a foreign solver, a scene, a kind of psi."""

import subprocess
import sys
from textwrap import dedent

import pytest

PLUGIN = '''
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy.sparse as sp

import icpmodel as icp
from icpmodel.methods.contract import Method
from icpmodel.problem.map import Map
from icpmodel.scenes import Scene, register
from icpmodel.solvers.foreign import Claim, ForeignSolver


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Steps(Method):
    """Projected Richardson steps."""

    name: ClassVar[str] = "steps"
    length: float = 0.2

    def iterates(self, problem, z):
        while True:
            yield z, None
            z = np.maximum(problem.psi.value(z), z - self.length * problem.p(z))


class Oracle(ForeignSolver):
    """Projected Richardson steps, as a stranger would make them."""

    name: ClassVar[str] = "oracle"
    package: ClassVar[str] = "numpy"
    forms: ClassVar[tuple[str, ...]] = ("mpec",)

    def set_up(self, target, tolerance, time_limit):
        return target.problem

    def run(self, model):
        z = np.zeros(model.n)
        for _ in range(10_000):
            z = np.maximum(model.psi.value(z), z - 0.1 * model.p(z))
        return Claim(z, "done", True)


class Half(Map):
    """psi(z) = z/2 - 1."""

    def bind(self, n):
        return self

    def value(self, z):
        return 0.5 * z - 1.0

    def jacobian(self, z):
        return sp.csr_array(0.5 * sp.eye_array(z.size))


@register
def spring() -> Scene:
    """Two springs on a floor that gives way."""
    problem = icp.ICP([[2.0, -1.0], [-1.0, 2.0]], [1.0, -2.0], Half())
    return Scene(problem=problem, models="Springs.", why_no_reference="It is made up.")
'''


@pytest.fixture(scope="module")
def plugin(tmp_path_factory):
    """A folder with a module and the metadata of an installed package that announces it."""
    folder = tmp_path_factory.mktemp("plugin")
    (folder / "springs.py").write_text(PLUGIN)
    metadata = folder / "springs-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: springs\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text("[icpmodel]\nsprings = springs\n")
    return folder


def run(plugin, *command):
    environment = {"PYTHONPATH": str(plugin)}
    import os

    found = subprocess.run(
        [sys.executable, *command], capture_output=True, text=True, check=False, env={**os.environ, **environment}
    )
    return found.stdout + found.stderr


def test_they_are_found_by_name_in_solve_crosscheck_and_race(plugin):
    code = """
        import icpmodel as icp
        problem = icp.scenes.scene("spring").problem
        solution = problem.solve("steps", length=0.25)
        print(solution.status.value, problem.residual(solution.z) < 1e-6)
        print(problem.solve("newton").solved, abs(problem.solve("newton").z - solution.z).max() < 1e-6)
        report = problem.crosscheck(solution, ["oracle"])
        print([row.verdict.value for row in report.rows], report.agrees)
        race = icp.race(icp.ICP([[2.0]], [-3.0]), ["steps"], ["oracle"], repeats=1, tolerances=[1e-3])
        print(sorted({entry.name for entry in race.entries}))
    """
    assert run(plugin, "-c", dedent(code)) == dedent("""\
        solved True
        True True
        ['agrees'] True
        ['oracle', 'solve()', 'steps']
    """)


def test_they_are_found_by_name_on_the_command_line(plugin):
    command = ("-m", "icpmodel")
    assert "spring" in run(plugin, *command, "scenes")
    told = run(plugin, *command, "solve", "spring", "--method", "steps", "--option", "length=0.25")
    assert "solved" in told, told
    told = run(plugin, *command, "crosscheck", "spring", "--solver", "oracle")
    assert "agrees" in told, told
