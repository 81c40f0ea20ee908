r"""Which load makes a membrane touch the floor where that is wanted, and nowhere else?

Whether a point touches has no derivative. How firmly it does has one, and how far it is from touching has one as well.

Run: python examples/design_contact.py        writes design_contact.png and design_contact.svg into the current folder
"""

# %%
# ## The model
#
# A membrane in a frame hangs above a floor; pistons load it with $f = B\theta$ per area, $B$-splines within what the
# pistons can do, $|\theta_k| \le$ `MOST`:
#
# $$p = Az + h^2 B\theta \ge 0, \qquad r = z - \text{floor} \ge 0, \qquad p^T r = 0.$$
#
# Wanted is contact in the shape of a Ψ. Of $p$ and $r$ one is 0, so that the *margin*
#
# $$m = \frac{p/h^2}{\text{push}} - \frac{r}{\text{gap}},$$
#
# in units of the pressure and of the gap that are enough, is continuous where a point begins to touch. It is to be at
# least 1 inside the shape and at most $-1$ outside, and the mean square of what it falls short is made least. A cell or
# two on both sides of the edge may do what they like: somewhere there contact has to end. The gradient in all $\theta$
# is one `adjoint`.

import functools

import matplotlib.pyplot as plt
import numpy as np
import scipy.sparse as sp
from scipy.interpolate import BSpline
from scipy.ndimage import distance_transform_edt
from scipy.optimize import minimize

import icpmodel as icp

MOST = 12.0  # 3 to 40
FLOOR, PUSH, GAP, SPLINES, START, M = -0.1, 2.0, 0.002, 18, 5.0, 70
scene = icp.scenes.membrane(n=M * M)
(x, y), A, cell = 2 * scene.points.T - 1, scene.problem.A, scene.h**2

bowl, arms = (
    np.abs(np.hypot(x, y - 0.15) - 0.45) < 0.09,
    np.abs(np.abs(x) - 0.45) < 0.09,
)
stem = (np.abs(x) < 0.09) & (np.abs(y) < 0.72)
psi = stem | np.where(y < 0.15, bowl, arms & (y < 0.6))
letter = psi.reshape(M, M)
far = (distance_transform_edt(letter) > 1.0) | (distance_transform_edt(~letter) > 1.5)
side = np.where(far.ravel(), np.where(psi, 1.0, -1.0), 0.0)

knots = np.concatenate([np.zeros(3), np.linspace(0, 1, SPLINES - 2), np.ones(3)])
line = BSpline.design_matrix(np.arange(1, M + 1) / (M + 1), knots, 3)
B = sp.kron(line, line, format="csr")


def membrane(theta: np.ndarray) -> icp.Solution:
    return icp.ICP(A, cell * (B @ theta), FLOOR).solve(rtol=1e-10)


def shortfall(theta: np.ndarray) -> tuple[float, np.ndarray]:
    """The objective and its gradient: z moves p and r, and the load also p itself."""
    one = membrane(theta)
    missing = np.abs(side) * np.maximum(
        1 - side * (one.p / cell / PUSH - one.r / GAP), 0.0
    )
    by_p, by_r = -side * missing / (M * M * cell * PUSH), side * missing / (M * M * GAP)
    by_q = one.derivative().adjoint(A.T @ by_p + by_r).q + by_p
    return 0.5 * np.mean(missing**2), cell * (B.T @ by_q)


@functools.cache
def design(most: float):
    """The best load that pistons of this strength can make, from a uniform one."""
    start = np.full(SPLINES**2, min(START, most))
    limits = [(-most, most)] * start.size
    return minimize(shortfall, start, jac=True, method="L-BFGS-B", bounds=limits)


def counts(solution: icp.Solution) -> list[int]:
    """Inside: touch, do not; outside: touch, do not."""
    touches = solution.p > solution.r
    return [
        int(np.sum((side == s) & (touches == t)))
        for s in (1, -1)
        for t in (True, False)
    ]


# %%
# ## What is seen
#
# Under a uniform load the middle of the membrane lies on the floor. Contact comes and goes while the load is improved;
# at the end it has the wanted shape. The derivative is *certain* where it is proved of every point on which side it is.

found = design(MOST)
before, after = membrane(np.full(SPLINES**2, START)), membrane(found.x)
print(
    f"{'':>14} {'inside: touch':>14} {'do not':>7} {'outside: touch':>15} {'do not':>7}"
)
for words, solution in (("uniform load", before), ("chosen load", after)):
    a, b, c, d = counts(solution)
    print(f"{words:>14} {a:14d} {b:7d} {c:15d} {d:7d}")
strongest = np.sum(np.abs(found.x) == MOST)
print(f"after {found.nit} iterations and {found.nfev} adjoints; ", end="")
print(f"{strongest} of {found.x.size} pistons at their strongest")
print(f"the derivative at the chosen load is certain: {after.derivative().certain}")

# %%
# The pressure on the floor before and after, where it is touched, and the load; the line is the wanted shape.


def pressure(one: icp.Solution) -> np.ndarray:
    return np.where(one.p > one.r, one.p / cell, np.nan).reshape(M, M)


shade = {"extent": (-1, 1, -1, 1), "origin": "lower"}
touched = {"cmap": "cividis", "vmin": 0, "vmax": 0.9 * after.p.max() / cell}
figure, (first, load, last) = plt.subplots(
    1, 3, figsize=(13, 4.2), layout="constrained", sharey=True
)
first.imshow(pressure(before), **shade, **touched)
first.set_title(f"Contact under the uniform load {START:.0f}")
picture = load.imshow(
    (B @ found.x).reshape(M, M), **shade, cmap="RdBu_r", vmin=-MOST, vmax=MOST
)
figure.colorbar(picture, ax=load, label="load, force per area")
load.set_title("The load that was chosen")
picture = last.imshow(pressure(after), **shade, **touched)
figure.colorbar(picture, ax=last, label="pressure on the floor")
last.set_title("Contact under it")
edge = {"levels": [0.5], "colors": "black", "linewidths": 1}
for axes in (first, load, last):
    axes.contour(x.reshape(M, M), y.reshape(M, M), letter.astype(float), **edge)
    axes.set_xlabel("x, half sides of the square")
first.set_ylabel("y, half sides of the square")
for suffix in ("png", "svg"):
    figure.savefig(f"design_contact.{suffix}", dpi=150)

# %%
# ## Vary one thing
#
# `MOST`, the strength of the pistons. Weak ones cannot lift the membrane between the strokes of the letter, nor press
# it down at their ends.

print(
    f"{'strength':>8} {'shortfall':>10} {'inside, but does not touch':>27} "
    f"{'outside, but touches':>21}"
)
for most in sorted({3.0, 6.0, 12.0, MOST}):
    one = design(most)
    _, missed, extra, _ = counts(membrane(one.x))
    print(f"{most:8.1f} {one.fun:10.5f} {missed:27d} {extra:21d}")

# %%
# ## Exercises
#
# **1.** Check the gradient by a difference. Near a load at which a point begins to touch, does it jump?
#
# Answer: It has a continuous slope at every load at which no point is exactly at the floor without pressing. Where one
# is, $z$ has different derivatives to both sides, and so has the margin. Such loads are rare, and the check passes.

rng = np.random.default_rng(0)
theta, step = np.full(SPLINES**2, START), 1e-4 * rng.standard_normal(SPLINES**2)
difference = shortfall(theta + step)[0] - shortfall(theta - step)[0]
slope = 2 * shortfall(theta)[1] @ step
print(f"difference {difference:.6e}, slope {slope:.6e}")
assert np.isclose(difference, slope, rtol=1e-4), "differences give the same slope"

# %%
# **2.** Under a uniform load $f$ the membrane presses on the floor with which pressure inside the contact?
#
# Answer: With $f$: it is flat there, and $Az = 0$ away from the edge of the contact. All of the load above the contact
# goes straight to the floor.

touches = before.p > before.r
inside = touches & (A @ touches.astype(float) == 0)  # with all four neighbours
print(
    f"pressure inside the contact: {before.p[inside].min() / cell:.6f} to "
    f"{before.p[inside].max() / cell:.6f}"
)
assert np.allclose(before.p[inside] / cell, START), (
    "inside the contact the floor takes all of the load"
)

# %%
# **3.** Why not simply count the points that are on the wrong side, and make that least?
#
# Answer: The count is constant between loads at which a point begins or ends to touch, so that its derivative is 0
# wherever it has one: an optimiser that follows slopes does not move at all. The margin tells how far a point is from
# changing sides.

counted = [
    sum(counts(membrane(theta + size * step / 1e-4))[1:3])
    for size in (0.0, 1e-6, 1e-3, 1.0)
]
print(
    f"points on the wrong side after ever larger steps: {counted}; shortfall's "
    f"slope along them: {slope / 2e-4:.4f}"
)
assert counted[0] == counted[1], "a tiny step does not change the count"
