r"""Can one recover a hidden obstacle from noisy heights of the membrane that lies on it, and where can one not?

The gradient in all parameters of the obstacle is one `adjoint`, one more linear solve after the solve for $z$.

Run: python examples/recover_obstacle.py      writes recover_obstacle.png and recover_obstacle.svg here
"""

# %%
# ## The model
#
# A membrane in a frame is pressed down by $f$ per area onto hills on a table, $\psi = \text{table} + B\theta$ with
# $B$-splines $B$; on the grid
#
# $$p = Az + h^2 f \ge 0, \qquad r = z - \psi \ge 0, \qquad p^T r = 0,$$
#
# and $z$ is measured with noise of known size $\sigma$. Wanted are the $\theta \ge 0$ for which
#
# $$\frac{1}{2} \left|\frac{z(\theta) - z^{\text{measured}}}{\sigma}\right|^2 + \frac{1}{2} |D\theta|^2$$
#
# is least; $D$ is the second difference between neighbouring splines over how much hills bend about. Where nothing
# touches, $z$ does not depend on $\psi$: there the measurements are silent, and only the last term speaks. $f$ is
# `PRESSURE`.

import functools

import matplotlib.pyplot as plt
import numpy as np
import scipy.sparse as sp
from scipy.interpolate import BSpline
from scipy.optimize import minimize

import icpmodel as icp

PRESSURE = 15.0  # 5 to 50
TABLE, NOISE, BEND, SPLINES, M = -0.2, 0.01, 0.1, 12, 50
n = M * M
scene = icp.scenes.membrane(n=n)
x, y = scene.points.T
hills = (0.36, 0.38, 0.5, 0.22), (0.68, 0.64, 0.4, 0.17), (0.32, 0.74, 0.3, 0.13)
bumps = [
    height * np.exp(-((x - a) ** 2 + (y - b) ** 2) / wide**2)
    for a, b, height, wide in hills
]
truth = TABLE + sum(bumps)

# cubic splines that are 0 at the frame: leave out the first one and the last one of a line
knots = np.concatenate([np.zeros(3), np.linspace(0, 1, SPLINES), np.ones(3)])
line = BSpline.design_matrix(np.arange(1, M + 1) / (M + 1), knots, 3)[:, 1:-1]
B = sp.kron(line, line, format="csr")
bends = sp.diags_array([1.0, -2.0, 1.0], offsets=[-1, 0, 1], shape=(SPLINES, SPLINES))
one = sp.eye_array(SPLINES)
D = sp.vstack([sp.kron(bends, one), sp.kron(one, bends)], format="csr") / BEND


def measure(pressure: float, seed: int = 1) -> tuple[icp.ICP, np.ndarray]:
    """The problem with the true obstacle, and noisy heights of its membrane."""
    problem = icp.ICP(scene.problem.A, np.full(n, pressure * scene.h**2), truth)
    noise = NOISE * np.random.default_rng(seed).standard_normal(n)
    return problem, problem.solve(rtol=1e-12).z + noise


def misfit(
    theta: np.ndarray, problem: icp.ICP, measured: np.ndarray
) -> tuple[float, np.ndarray]:
    """What is to be least, and its gradient."""
    solution = problem.with_psi(TABLE + B @ theta).solve(rtol=1e-12)
    error, rough = (solution.z - measured) / NOISE, D @ theta
    by_psi = solution.derivative().adjoint(error / NOISE).psi
    return 0.5 * (error @ error + rough @ rough), B.T @ by_psi + D.T @ rough


@functools.cache
def recover(pressure: float):
    """The problem, the data, what the optimiser found, and the membrane on that.

    It begins above all noise: splines that touch nothing have no gradient.
    It ends when a step gains less than 1e-5 of the objective, about n/2.
    Chance alone moves that by about the root of n/2.
    """
    problem, measured = measure(pressure)
    above = measured + 3 * NOISE - TABLE
    start = np.maximum(np.linalg.lstsq(B.toarray(), above, rcond=None)[0], 0.0)
    settings = {"jac": True, "method": "L-BFGS-B", "bounds": [(0, None)] * start.size}
    found = minimize(
        misfit, start, (problem, measured), options={"ftol": 1e-5}, **settings
    )
    return (
        problem,
        measured,
        found,
        problem.with_psi(TABLE + B @ found.x).solve(rtol=1e-12),
    )


def expected_error(solution: icp.Solution) -> np.ndarray:
    """Of every height, from the curvature of the objective."""
    derivative = solution.derivative()
    dz = np.column_stack([derivative.forward(dpsi=spline) for spline in B.T.toarray()])
    curvature = dz.T @ dz / NOISE**2 + (D.T @ D).toarray()
    return np.sqrt(
        (B.toarray() * np.linalg.solve(curvature, B.toarray().T).T).sum(axis=1)
    )


# %%
# ## What is seen
#
# Where the membrane touches, the obstacle is known several times better than one height is measured. Where it hangs
# free, the answer is a guess, and the expected error says so. (It counts noise. That splines cannot have quite the
# shape of the hills comes on top of it.)

problem, measured, found, solution = recover(PRESSURE)
psi, touches = TABLE + B @ found.x, solution.p > solution.r
expected = expected_error(solution)
seen = expected < NOISE
print(
    f"{SPLINES**2} splines from {n} heights with noise {NOISE}: {found.nit} "
    f"iterations, {found.nfev} adjoints"
)
print(
    "mean squared misfit / noise²: "
    f"{np.mean((solution.z - measured) ** 2) / NOISE**2:.3f}\n"
)
print(f"{'the membrane':>24} {'points':>7} {'error expected':>15} {'true error':>11}")
parts = {
    "touches": touches,
    "is near by, seen": seen & ~touches,
    "hangs free, not seen": ~seen & ~touches,
}
for words, where in parts.items():
    if where.any():
        rms = [np.sqrt(np.mean(error[where] ** 2)) for error in (expected, psi - truth)]
        print(f"{words:>24} {where.sum():7d} {rms[0]:15.4f} {rms[1]:11.4f}")
print(f"\nThe derivative is certain: {solution.derivative().certain}")

# %%
# Left the data, in the middle the recovered obstacle, right a section along the diagonal with two expected errors.

plt.rcParams |= {"hatch.color": "0.8", "hatch.linewidth": 0.6}
figure, (heights, plan, section) = plt.subplots(
    1, 3, figsize=(13, 4.2), layout="constrained"
)
frame = {
    "extent": (0, 1, 0, 1),
    "origin": "lower",
    "vmin": TABLE,
    "vmax": truth.max(),
    "cmap": "cividis",
}
heights.imshow(measured.reshape(M, M), **frame)
heights.set_title("The membrane, measured")
picture = plan.imshow(psi.reshape(M, M), **frame)
across, up = np.moveaxis(scene.points.reshape(M, M, 2), -1, 0)
unseen = np.where(seen, 0.0, 1.0).reshape(M, M)
plan.contourf(across, up, unseen, levels=[0.5, 1.5], colors="none", hatches=["////"])
edge = {"levels": [0.5], "colors": "white", "linewidths": 1.5}
plan.contour(across, up, touches.reshape(M, M).astype(float), **edge)
plan.set_title("The obstacle: touched (white), not seen (hatched)")
figure.colorbar(picture, ax=plan, label="height")
for axes in (heights, plan):
    axes.plot([0, 1], [0, 1], ":", color="white", linewidth=1)
    axes.set_xlabel("x, sides of the square")
heights.set_ylabel("y, sides of the square")

along = np.arange(M) * (M + 1)
low, high = (psi - 2 * expected)[along], (psi + 2 * expected)[along]
section.fill_between(x[along], low, high, color="#D55E00", alpha=0.25, linewidth=0)
section.plot(
    x[along], measured[along], ".", color="0.6", markersize=4, label="measured"
)
section.plot(x[along], solution.z[along], color="#0072B2", label="membrane")
section.plot(x[along], psi[along], color="#D55E00", label="obstacle, ± 2 errors")
section.plot(
    x[along], truth[along], "--", color="black", linewidth=1, label="true obstacle"
)
section.set_xlabel("x = y, along the diagonal")
section.set_ylabel("height")
section.set_title("Known where it is touched")
section.legend(frameon=False, fontsize=9)
for suffix in ("png", "svg"):
    figure.savefig(f"recover_obstacle.{suffix}", dpi=150)

# %%
# ## Vary one thing
#
# `PRESSURE`. With little of it the membrane hangs from the hilltops and feels little more than these; with much it
# feels the table.

print(
    f"{'pressure':>8} {'touches':>9} {'seen':>6} "
    f"{'true error where it touches':>28} {'elsewhere':>10}"
)
for pressure in sorted({0.0, 15.0, 60.0, PRESSURE}):
    *_, there = recover(pressure)
    on, wrong = there.p > there.r, there.problem.psi.value(there.z) - truth
    errors = [np.sqrt(np.mean(wrong[where] ** 2)) for where in (on, ~on)]
    known = np.mean(expected_error(there) < NOISE)
    print(
        f"{pressure:8.0f} {100 * on.mean():7.0f} % {100 * known:4.0f} % "
        f"{errors[0]:28.4f} {errors[1]:10.4f}"
    )

# %%
# ## Exercises
#
# **1.** Check the gradient in a random direction. Why is $z$ solved for to twelve digits?
#
# Answer: A difference of two nearly equal values shows the error of both, and so does the line search of the optimiser,
# which compares such values.

rng = np.random.default_rng(2)
theta, step = np.maximum(found.x, 0.05), 1e-6 * rng.standard_normal(found.x.size)
up_value, down_value = (
    misfit(theta + sign * step, problem, measured)[0] for sign in (1, -1)
)
slope = 2 * misfit(theta, problem, measured)[1] @ step
print(f"relative difference {abs((up_value - down_value) / slope - 1):.0e}")
assert np.isclose(up_value - down_value, slope, rtol=1e-2), (
    "differences give the same slope"
)

# %%
# **2.** Raise the true obstacle by 0.01 at one point that the membrane does not come near. What do the heights of the
# membrane say of it?
#
# Answer: Nothing at all: not a digit of $z$ changes as long as the point stays below the membrane, and the derivative
# of $z$ in that entry of $\psi$ is 0.

free = problem.solve(rtol=1e-12)
away = int(np.argmax(free.r))
raised = problem.with_psi(truth + 0.01 * (np.arange(n) == away)).solve(rtol=1e-12)
change = np.abs(
    free.derivative().forward(dpsi=(np.arange(n) == away).astype(float))
).max()
largest = np.abs(raised.z - free.z).max()
print(
    f"gap there {free.r[away]:.3f}; largest change of z {largest:.0e}, derivative "
    f"{change:.0e}"
)
assert change == 0, "the derivative is 0"
assert largest < 1e-10, "and z does not move"

# %%
# **3.** The mean squared misfit over the noise squared is near 1. What would 0.5 mean, and what 2?
#
# Answer: Much less than 1: the splines follow the noise. Much more: the model cannot follow the data. Chance moves it
# by about $\sqrt{2/n}$. Here are both: with a membrane that is free to be anything, and with a flat table.

follows = np.mean((measured - measured) ** 2) / NOISE**2
flat = problem.with_psi(np.full(n, TABLE)).solve(rtol=1e-12)
cannot = np.mean((flat.z - measured) ** 2) / NOISE**2
print(
    f"heights that are the data: {follows:.1f}; flat table: {cannot:.0f}; chance "
    f"moves it by {np.sqrt(2 / n):.3f}"
)
assert (
    abs(np.mean((solution.z - measured) ** 2) / NOISE**2 - 1)
    < 5 * np.sqrt(2 / n) + SPLINES**2 / n
), "the misfit is that of the noise"
