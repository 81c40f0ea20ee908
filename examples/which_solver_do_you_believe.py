r"""Three solvers say "optimal", and two of them are off by a factor of a thousand: which one do you believe?

A solver's "optimal" is said of its own scaled conditions, at its own tolerance. Here nobody warns.

Run: python examples/which_solver_do_you_believe.py       writes which_solver_do_you_believe.png and .svg here, and
the work-precision chart which_solver_race.png
"""

# %%
# ## The model
#
# The oil film of a journal bearing, with the thickness $H = 1 + \cos\theta/2$: the pressure $u$ is 0 where the
# film has torn, and elsewhere satisfies Reynolds' equation,
#
# $$-(H^3u')' + H' \ge 0, \qquad u \ge 0, \qquad \text{one of them } 0.$$
#
# On a grid of $n$ points with rows multiplied by $h^2$ this is $Az + q \ge 0$, $z \ge 0$, complementary. The entries
# of $A$ are near 1 and $q_i \approx h^2 H'$. $A$ is symmetric and positive definite, so that $z$ is also the solution
# of a quadratic program, which any QP solver takes:
#
# $$\min_{z \ge 0}\ \tfrac{1}{2} z^T A z + q^T z.$$
#
# What the bearing is built for is its load, $\left|\int u\,(\cos\theta, \sin\theta)\,d\theta\right| \approx 1.0759$.
# $n$ is `N`.

import cvxpy as cp
import matplotlib.pyplot as plt
import numpy as np

import icpmodel as icp

N = 2999  # 300 to 5000
SOLVERS = ("OSQP", "SCS", "CLARABEL")


def load(scene: icp.scenes.Scene, pressure: np.ndarray) -> float:
    theta = scene.points
    return scene.h * float(np.hypot(pressure @ np.cos(theta), pressure @ np.sin(theta)))


def as_it_comes(problem: icp.ICP, solver: str, **settings) -> tuple[np.ndarray, str]:
    """The quadratic program in CVXPY, at defaults but for the `settings`."""
    z = cp.Variable(problem.n)
    energy = cp.quad_form(z, cp.psd_wrap(problem.A)) / 2 + problem.q @ z
    model = cp.Problem(cp.Minimize(energy), [z >= 0])
    model.solve(solver=solver, **settings)
    return z.value, model.status


def answers(n: int) -> tuple[icp.scenes.Scene, dict[str, tuple[np.ndarray, str]]]:
    scene = icp.scenes.bearing(n=n)
    found = {name: as_it_comes(scene.problem, name) for name in SOLVERS}
    mine = scene.problem.solve(rtol=1e-10)
    return scene, {**found, "icpmodel": (mine.z, mine.status.value)}


# %%
# ## What is seen
#
# Each answer, what its solver says of it, and what `icp.certify` proves of it, whatever found it. OSQP and SCS answer
# with next to no pressure, since $z = 0$ satisfies their default tolerances: the entries of $q$ are that small.

scene, found = answers(N)
start = scene.problem.residual_at_0()
print(f"{'solver':>9} {'says':>8} {'load':>8} {'residual / Res(0)':>18}   proved")
for name, (z, says) in found.items():
    judged = icp.certify(scene.problem, z)
    proved = f"no pressure is off by more than {judged.error_bound:.1e}"
    print(
        f"{name:>9} {says:>8} {load(scene, z):8.4f} {judged.residual / start:18.1e} "
        f"  {proved}"
    )

# %%
# A cross-check has one judge for all: independent solvers in well-chosen units, asked for ten digits, and their
# "solved" is not believed either.

print("OSQP's answer, cross-checked:")
print(scene.problem.crosscheck(found["OSQP"][0], ["clarabel"]))
print("\nicpmodel's answer, cross-checked:")
report = scene.problem.crosscheck(found["icpmodel"][0], ["osqp", "clarabel"])
print(report)
assert report.agrees, "other solvers agree where they are asked for more"

# %%
# Time against accuracy, in those units: accuracy grows to the right, and a hollow marker says "solved" and is not. The
# seconds are those of the machine that drew it.

race = icp.race(
    icp.scenes.bearing(n=999).problem,
    methods=[],
    solvers=["osqp", "osqp, not polished", "scs", "clarabel"],
    tolerances=[10.0**-k for k in range(3, 11)],
    repeats=1,
    command="python examples/which_solver_do_you_believe.py",
)
race.plot("which_solver_race.png")

# %%
# ## Vary one thing
#
# `N`. On coarse grids all are right. The finer the grid, the smaller $q$, and from some $n$ on the default tolerance of
# a solver is larger than everything that drives the problem. A better grid makes the answer worse.

sizes, loads = (99, 299, 999, 2999), {name: [] for name in (*SOLVERS, "icpmodel")}
print(
    f"{'n':>5} "
    + " ".join(f"{name:>9}" for name in loads)
    + "     the largest entry of q"
)
for n in sizes:
    scene, found = answers(n)
    for name, (z, _) in found.items():
        loads[name].append(load(scene, z))
    row = " ".join(f"{seen[-1]:9.4f}" for seen in loads.values())
    print(f"{n:5d} {row}     {np.abs(scene.problem.q).max():.1e}")

figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
looks = (
    ("#D55E00", "--", "s", 10),
    ("#E69F00", ":", "^", 7),
    ("#0072B2", "-", "D", 7),
    ("black", "-", "o", 3),
)
for (name, seen), (colour, line, marker, size) in zip(
    loads.items(), looks, strict=True
):
    axes.semilogx(
        sizes, seen, line, marker=marker, color=colour, markersize=size, label=name
    )
axes.set_xticks(sizes, [str(n) for n in sizes])
axes.minorticks_off()
axes.set_xlabel("number of unknowns n")
axes.set_ylabel("load of the bearing, dimensionless")
axes.set_title('CVXPY at default settings: always "optimal"')
axes.legend(frameon=False, loc="center left")
for suffix in ("png", "svg"):
    figure.savefig(f"which_solver_do_you_believe.{suffix}", dpi=150)

# %%
# ## Exercises
#
# **1.** Multiply the energy by $1/h^2$, which changes no minimiser. Is OSQP right then?
#
# Answer: Yes. $q$ is now of size 1, and so is what the tolerances are compared with. Units are no detail: a tolerance
# without units means nothing.

scene = icp.scenes.bearing(n=2999)
scaled = icp.ICP(scene.problem.A / scene.h**2, scene.problem.q / scene.h**2)
z, says = as_it_comes(scaled, "OSQP")
print(f"{says}, load {load(scene, z):.4f}")

# %%
# **2.** Leave the energy as it is, and ask OSQP and SCS for tolerances of $10^{-9}$ instead. Better?
#
# Answer: SCS is right then. OSQP (as of version 1) says that the problem is unbounded. That is false, since $A$ is
# positive definite; the test behind it has a tolerance of its own, `eps_dual_inf`, and with that tightened OSQP is
# right. An "unbounded" or "infeasible" is to be believed as little as an "optimal", unless it comes with a witness that
# one can check.

for name, more in (("SCS", {}), ("OSQP", {}), ("OSQP", {"eps_dual_inf": 1e-12})):
    z, says = as_it_comes(scene.problem, name, eps_abs=1e-9, eps_rel=1e-9, **more)
    print(
        f"{name}: {says}, "
        + ("no answer" if z is None else f"load {load(scene, z):.4f}")
    )

# %%
# **3.** What does the certificate say of $z = 0$, which took no solver at all? Compare with the true error.
#
# Answer: The residual of $z = 0$ is tiny, and the bound of the error is not: it knows how large $A^{-1}$ is.

zero = icp.certify(scene.problem, np.zeros(scene.problem.n))
true = scene.problem.solve(rtol=1e-10).z.max()
print(
    f"residual {zero.residual:.1e}, proved error at most {zero.error_bound:.2f}, "
    f"true error {true:.2f}"
)
assert true <= zero.error_bound, "the certificate bounds the true error"
