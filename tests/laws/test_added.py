"""What is added outside the package is found by its name: a method, a foreign solver, a scene, a kind of psi."""

from installed import announce, run

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


SCRIPT = """
import contextlib, io, icpmodel as icp
from icpmodel.cli import main
def told(said):
    return " ".join(said.getvalue().lower().split())
problem = icp.scenes.scene("spring").problem
solution = problem.solve("steps", length=0.25)
print(solution.status.value, problem.residual(solution.z) < 1e-6)
print(problem.solve("newton").solved, abs(problem.solve("newton").z - solution.z).max() < 1e-6)
report = problem.crosscheck(solution, ["oracle"])
print([row.verdict.value for row in report.rows], report.agrees)
race = icp.race(icp.ICP([[2.0]], [-3.0]), ["steps"], ["oracle"], repeats=1, tolerances=[1e-3])
print(sorted({entry.name for entry in race.entries}))
solve = "solve spring --method steps --option length=0.25"
for command in ("scenes", solve, "crosscheck spring --solver oracle", "solve --help"):
    with contextlib.redirect_stdout(io.StringIO()) as said, contextlib.suppress(SystemExit):
        main(command.split())
    print([word for word in ("spring", "solved", "agrees", "restarts, steps, tridiagonal") if word in told(said)])
"""


def test_they_are_found_by_name_in_solve_crosscheck_race_and_on_the_command_line(tmp_path):
    (tmp_path / "springs.py").write_text(PLUGIN)
    announce(tmp_path, "springs", {"icpmodel": {"springs": "springs"}})
    ran = run("-c", SCRIPT, folder=tmp_path)
    assert ran.stdout.splitlines() == [
        "solved True",
        "True True",
        "['agrees'] True",
        "['oracle', 'solve()', 'steps']",
        "['spring']",
        "['solved']",
        "['solved', 'agrees']",
        "['restarts, steps, tridiagonal']",
    ], ran.stderr
