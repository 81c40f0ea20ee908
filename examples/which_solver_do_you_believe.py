"""Which solver do you believe? Three say "optimal"; two of them are off by a factor of a thousand.

It teaches: a solver's "optimal" is said of its own scaled conditions, at its own tolerance. The oil film of a journal
bearing, given to CVXPY as it stands, is right on a coarse grid and, on a finer one, has a load of almost nothing: the
entries of q shrink with the square of the grid spacing, until z = 0 satisfies the default tolerances. Nobody warns.

Run: python examples/which_solver_do_you_believe.py       writes which_solver_do_you_believe.png and .svg here, and
the work-precision chart which_solver_race.png
"""

import cvxpy as cp
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import icpmodel as icp

SOLVERS = ("OSQP", "SCS", "CLARABEL")


def load(scene: icp.scenes.Scene, pressure: np.ndarray) -> float:
    """The force that the film carries: what the bearing is built for."""
    return scene.h * float(np.hypot(pressure @ np.cos(scene.points), pressure @ np.sin(scene.points)))


def as_it_comes(problem: icp.ICP, solver: str) -> tuple[np.ndarray, str]:
    """A is symmetric and psi = 0: z minimises z'Az/2 + q'z over z >= 0. Every setting is the default."""
    z = cp.Variable(problem.n)
    model = cp.Problem(cp.Minimize(cp.quad_form(z, cp.psd_wrap(problem.A)) / 2 + problem.q @ z), [z >= 0])
    model.solve(solver=solver)
    return z.value, model.status


sizes, loads = (99, 299, 999, 2999), {name: [] for name in (*SOLVERS, "icpmodel")}
said_optimal = 0
print(f"{'n':>5} {'solver':>9} {'says':>8} {'load':>8} {'residual / Res(0)':>18}   proved")
for n in sizes:
    scene = icp.scenes.bearing(n=n)
    solution = scene.problem.solve(rtol=1e-10)
    start = scene.problem.residual_at_0()
    answers = {name: as_it_comes(scene.problem, name) for name in SOLVERS}
    said_optimal += sum(says == "optimal" for _, says in answers.values())
    for name, (z, says) in {**answers, "icpmodel": (solution.z, solution.status.value)}.items():
        loads[name].append(load(scene, z))
        judged = icp.certify(scene.problem, z)  # works for every z, whatever found it
        proved = f"no pressure is off by more than {judged.error_bound:.1e}"
        print(f"{n:5d} {name:>9} {says:>8} {loads[name][-1]:8.4f} {judged.residual / start:18.1e}   {proved}")

# One judge for all: independent solvers in well-chosen units and asked for ten digits; their "solved" is not believed.
print("\nOSQP's answer, cross-checked:")
print(scene.problem.crosscheck(answers["OSQP"][0], ["clarabel"]))
print("\nicpmodel's answer, cross-checked:")
report = scene.problem.crosscheck(solution, ["osqp", "cvxpy-clarabel", "cvxpy-osqp", "clarabel"])
print(report)
assert report.agrees

# Time against accuracy in those units: accuracy grows to the right, a hollow marker says "solved" and is not.
race = icp.race(
    icp.scenes.bearing(n=999).problem,
    methods=[],
    solvers=["osqp", "osqp, not polished", "scs", "clarabel"],
    tolerances=[10.0**-k for k in range(3, 11)],
    repeats=1,
    command="python examples/which_solver_do_you_believe.py",
)
race.plot("which_solver_race.png")
wrong = {entry.name for entry in race.entries if entry.wrong}
print(
    '\nIn the race these said "solved" at ten times the residual they were asked for, or more:',
    *sorted(wrong),
    sep="\n  ",
)

figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
looks = ("#D55E00", "--", "s", 10), ("#E69F00", ":", "^", 7), ("#0072B2", "-", "D", 7), ("black", "-", "o", 3)
for (name, seen), (colour, line, marker, size) in zip(loads.items(), looks, strict=True):
    axes.semilogx(sizes, seen, line, marker=marker, color=colour, markersize=size, label=name)
axes.set_xticks(sizes, [str(n) for n in sizes])
axes.minorticks_off()
axes.set_xlabel("number of unknowns n")
axes.set_ylabel("load of the bearing, dimensionless")
axes.set_title(f'CVXPY at default settings: {said_optimal} times "optimal"')
axes.legend(frameon=False, loc="center left")
for suffix in ("png", "svg"):
    figure.savefig(f"which_solver_do_you_believe.{suffix}", dpi=150)
