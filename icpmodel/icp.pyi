# For type checkers and editors: the verbs of ICP with their signatures, those of the rooms above it included.
from .crosscheck import check
from .derivatives.derivative import Derivative
from .explain import explanation
from .problem.data import ProblemData
from .solve import driver
from .solve.solution import Solution
from .solvers import cvxpy, pyomo
from .study import html_report
from .study.planes import Plane
from .study.race import race as race_of
from .study.stability_map import StabilityMap
from .theory.certificates import bounds, certificate

class ICP(ProblemData):
    __slots__ = ()

    solve = driver.solve
    crosscheck = check.crosscheck
    explain = explanation.explain
    certify = certificate.certify
    error_bound = bounds.error_bound
    race = race_of
    report = html_report.report
    to_pyomo = pyomo.to_pyomo
    to_cvxpy = cvxpy.to_cvxpy
    def derivative(self, solution: Solution) -> Derivative: ...
    def stability(
        self,
        plane: str | Plane = "relaxation",
        *,
        method: str | None = None,
        points: int = 25,
        n: int = 49,
        starts: int = 3,
        max_iter: int = 2000,
        rtol: float = 1e-8,
        time_limit: float | None = None,
        progress: bool = False,
        command: str = "",
    ) -> StabilityMap: ...
