"""A user's script that names every public name; it is checked by `mypy --strict`, and never run."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, assert_type

import cvxpy as cp
import numpy as np
from numpy.typing import NDArray

import icpmodel as icp
from icpmodel.crosscheck import Report, Verdict
from icpmodel.explain import Explanation
from icpmodel.present import Table

A = np.array([[2.0, -1.0], [-1.0, 2.0]])
z0: NDArray[np.float64] = np.zeros(2)
version: str = icp.__version__


# a problem, its maps, its verbs
problem = icp.ICP(A, [1.0, -2.0], psi=icp.Affine(0.1 * np.eye(2), -1.0), upper=icp.Constant(3.0))
assert_type(problem.with_q([1.0, 2.0]).with_psi(icp.Elementwise(np.tanh, lipschitz=1.0)), icp.ICP)
assert_type(icp.ICP.vertical(A, [1.0, -2.0], np.eye(2), z0), icp.ICP)
assert_type(problem.with_upper(icp.Function(np.sin)).n, int)
moving: icp.Map = icp.Intervention([[(1, 0.5)], [(0, 0.5)]])
solution = problem.solve(
    "mnmsor", z0=z0, rtol=1e-9, time_limit=1.0, callback=lambda state: state.iteration > 9, theta1=1.1
)
assert_type(solution, icp.Solution)
assert_type(icp.solve(problem, accuracy=1e-6, family="paper"), icp.Solution)
assert_type(solution.z, NDArray[np.float64])
assert_type(solution.status is icp.Status.SOLVED, bool)
assert_type(solution.status.advice, str)
assert_type(solution.history, icp.History)
assert_type(solution.certificate, icp.Certificate)
assert_type(solution.certificate.bound, icp.ErrorBound)
assert_type(solution.polish().error_bound, float | None)
assert_type(icp.certify(problem, solution, sharp=True, rigorous=True), icp.Certificate)
assert_type(icp.error_bound(problem, z0).unique, bool)
assert_type(problem.certify(z0).residual, float)
assert_type(problem.error_bound(z0).value, float | None)
assert_type(problem.explain("mnmgs", accuracy=1e-3), Explanation)
assert_type(icp.explain(problem, icp.MNMGS(), thorough=True), Explanation)
assert_type(problem.crosscheck(solution, ["osqp"], time_limit=9.0), Report)
assert_type(icp.crosscheck(problem, solution).rows[0].verdict, Verdict)
assert_type(icp.comparison_matrix(A), Any)


def seen(state: icp.Progress) -> bool:
    return state.residual < 1e-3 and bool(state.z.any())


# the choice, every solution, contradictions, contact
assert_type(icp.select_method(problem), icp.Choice | None)
several: icp.SolutionSet = icp.all_solutions(problem)
faces: tuple[icp.Face, ...] | list[icp.Face] = several.faces
found: icp.Contradiction | None = icp.contradiction(problem)
state: icp.ContactState = icp.contact_state(solution)
searches: list[icp.Method] = [icp.Enumerate(), icp.Restarts(), icp.MixedInteger(), icp.NewtonJosephy()]


# rows
many = icp.solve_many(A, [[1, -2], [0, 3]], time_limit=1.0)
assert_type(many, icp.Solutions)
assert_type(many[0], icp.Solution)
assert_type(many[1:], list[icp.Solution])
assert_type(iter(many), Iterator[icp.Solution])

# methods
methods: list[icp.Method] = [
    icp.Accelerated(of="mnmgs", history_size=3),
    icp.Josephy(),
    icp.Lemke(),
    icp.MMS(),
    icp.MNMAOR(theta1=1.2, theta2=1.0, phi=0.5),
    icp.MNMGS(),
    icp.MNMJ(),
    icp.MNMMOD(theta1=2.0),
    icp.MNMOD(),
    icp.MNMSOR(theta1="auto"),
    icp.Modulus(splitting=icp.AOR(1.0, 0.5)),
    icp.Multilevel(),
    icp.NMMS(),
    icp.Newton(),
    icp.PSOR(omega=1.3),
    icp.ProjectionFixedPoint(),
    icp.Interior(),
    icp.Proximal(),
    icp.Tridiagonal(),
    icp.methods.named("psor", omega=1.2),
]

# studies, pictures, tables
race = icp.race(problem, ["mnmgs", icp.Newton()], ["osqp"], z_exact=z0, repeats=1)
assert_type(race, icp.study.Race)
assert_type(problem.race(["mnmgs"], repeats=1), icp.study.Race)
assert_type(icp.stability("relaxation", problem, points=5), icp.study.StabilityMap)
assert_type(problem.stability("shift", points=5), icp.study.StabilityMap)
page: str = icp.report(solution, title="mine")
page = problem.report(title="mine")
assert_type(race.table(), Table)
assert_type(race.table().to_latex(), str)
race.plot("race.pdf")
race.to_dataframe()
solution.plot(Path("z.png"), points=z0)
icp.study.sensitivity(solution)
derivative = icp.Derivative(solution)
assert_type(derivative.forward(dq=z0, dpsi=1.0), NDArray[np.float64])
assert_type(derivative.adjoint(z0), icp.derivatives.Gradient)
assert_type(derivative.one_sided(dA=A), icp.derivatives.OneSided)
assert_type(derivative.certain, bool)
axes: Any = icp.study.figure(solution).axes
problem.stability().plot(ax=axes[0])

# the gallery, theory, foreign solvers
scene = icp.scenes.membrane(n=900, mu=4.0)
assert_type(scene, icp.scenes.Scene)
scene.plot()
assert_type(icp.scenes.scene("bearing", n=99).errors(z0), dict[str, float])
assert_type(icp.scenes.names(), list[str])
rows = icp.scenes.by_rows("membrane", n=10**9)
assert_type(rows, icp.ByRows)
assert_type(rows.local_rows(0, 9), icp.LocalRows)
print(icp.distributed.by_rows(rows))
assert_type(icp.theory.check("4.1", problem, icp.MNMGS()).holds, bool | None)
assert_type(icp.solvers.foreign_solvers()["osqp"], icp.solvers.ForeignSolver)

# modelling languages and files
z = cp.Variable(2)
pair = icp.complements(A @ z - 1, z, upper=3)
assert_type(pair, icp.Complementarity)
model = icp.Problem([pair])
assert_type(model.solve(), icp.Solution)
icp.cvxpy_solver()
program: icp.ProgramSolution = icp.solve_qp(np.eye(2), [1.0, -1.0], lb=0.0)
print(program.x, program.status, icp.qpsolvers_solver, icp.solve_avi(A, [1.0, -1.0]).error_bound)
squares: icp.LeastSquares = icp.solve_lsq(A, [1.0, -1.0], lb=0.0)
print(squares.cost, icp.solve_nnls(A, [1.0, -1.0])[1])
icp.pyomo_solver()
problem.to_cvxpy("qp")
problem.to_pyomo()
icp.save_problem(problem, "problem.npz")
icp.save_solution(solution, "answer.npz")
assert_type(icp.load_problem("problem.npz"), icp.ICP)
assert_type(icp.load_solution("answer.npz"), icp.Solution)

# errors
try:
    problem.solve(raise_on_failure=True)
except (icp.InputError, icp.MapError, icp.SingularOperator, icp.NotApplicable, icp.FileError) as error:
    print(error)
except icp.NotSolved as error:
    print(error.solution)
except icp.IcpError:
    pass
except icp.Interrupted as error:
    print(error.report)

# what is misspelt is told before it runs
icp.race(problem, repeat=3)  # type: ignore[call-arg]
problem.race(repeat=3)  # type: ignore[call-arg]
problem.stability(point=3)  # type: ignore[call-arg]
icp.certify(problem, z0, sharply=True)  # type: ignore[call-arg]
icp.scenes.membrane(m=3)  # type: ignore[call-arg]
icp.MNMGS(theta1=1.0)  # type: ignore[call-arg]
icp.MNMGSS()  # type: ignore[attr-defined]
many["0"]  # type: ignore[call-overload]
