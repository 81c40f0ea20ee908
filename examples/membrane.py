r"""Where does a membrane that is stretched over a hill touch it, and how hard does it press there?

The curve along which it leaves the hill is part of the answer: a *free boundary*.

Run: python examples/membrane.py        writes membrane.png and membrane.svg into the current folder
"""

# %%
# ## The model
#
# A membrane is held at height 0 along the edge of the unit square, and a paraboloid lifts it from below. Its height
# $u$ is at least that of the hill, it pulls with $-\Delta u$ per area, and it pulls only on what it touches:
#
# $$-\Delta u \ge 0, \qquad u \ge \psi, \qquad (-\Delta u)(u - \psi) = 0, \qquad
#   \psi(x, y) = \tfrac{1}{2} - c\left((x - \tfrac{1}{2})^2 + (y - \tfrac{1}{2})^2\right).$$
#
# On a grid of $m \times m$ points with spacing $h = 1/(m + 1)$ the five-point formula replaces $-h^2\Delta$,
#
# $$p_{ij} = 4 z_{ij} - z_{i-1,j} - z_{i+1,j} - z_{i,j-1} - z_{i,j+1} \ge 0, \qquad r = z - \psi \ge 0, \qquad
#   p^T r = 0,$$
#
# so that $p/h^2$ is the pressure, force per area. The curvature $c$ of the hill is `CURVATURE`.

import matplotlib.pyplot as plt
import numpy as np

import icpmodel as icp

CURVATURE, M = 4.0, 100  # CURVATURE from 2 to 20


def stretched(
    curvature: float, m: int = M
) -> tuple[np.ndarray, np.ndarray, icp.Solution]:
    """The coordinates of the grid, and the membrane on it."""
    scene = icp.scenes.membrane(n=m * m)  # its A is the five-point formula
    x, y = scene.points.T
    psi = 0.5 - curvature * ((x - 0.5) ** 2 + (y - 0.5) ** 2)
    return x, y, icp.ICP(scene.problem.A, np.zeros(m * m), psi).solve(rtol=1e-10)


# %%
# ## What is seen
#
# Of $p$ and $r$ the larger one, which is not zero, says on which side a point lies. Where the membrane lies on the hill
# it has its shape, and presses with $-\Delta\psi = 4c$; it leaves the hill on a curve that nobody prescribed.

x, y, solution = stretched(CURVATURE)
h = 1 / (M + 1)
contact = solution.p > solution.r
pressure = solution.p[contact] / h**2
print(solution)
print(
    f"\n{contact.sum()} of {M * M} points touch; median force per area there: "
    f"{np.median(pressure):.6g}"
)
print(f"(minus the Laplacian of the paraboloid is {4 * CURVATURE:g})")

# %%
# Left a section through the middle, right the height seen from above, with the edge of the contact in white.


def square(values: np.ndarray) -> np.ndarray:
    return values.reshape(M, M)


middle = M // 2
figure, (profile, plan) = plt.subplots(1, 2, figsize=(9, 3.9), layout="constrained")
along = np.arange(1, M + 1) * h
profile.plot(
    along,
    square(solution.problem.psi.value(solution.z))[middle],
    color="#D55E00",
    label="obstacle ψ",
)
profile.plot(along, square(solution.z)[middle], color="#0072B2", label="membrane z")
profile.set_ylim(-0.05, 0.6)
profile.set_xlabel("x, sides of the square")
profile.set_ylabel("height")
profile.set_title("Section through the middle")
profile.legend(frameon=False, loc="upper right")
field = plan.pcolormesh(
    square(x),
    square(y),
    square(solution.z),
    cmap="cividis",
    shading="nearest",
    rasterized=True,
)
plan.contour(
    square(x),
    square(y),
    square(contact).astype(float),
    levels=[0.5],
    colors="white",
    linewidths=1.2,
)
plan.annotate("contact", (0.5, 0.5), color="black", ha="center", va="center")
plan.set_aspect("equal")
plan.set_xlabel("x, sides of the square")
plan.set_ylabel("y, sides of the square")
plan.set_title("Height and contact set")
figure.colorbar(field, ax=plan, label="height z")
for suffix in ("png", "svg"):
    figure.savefig(f"membrane.{suffix}", dpi=150)

# %%
# ## Vary one thing
#
# `CURVATURE`. The sharper the hill, the smaller the contact and the higher the pressure; their product, the force with
# which the membrane presses on the whole hill, falls slowly.

print(f"{'curvature':>10} {'area of contact':>16} {'pressure':>9} {'whole force':>12}")
for curvature in sorted({2.5, 4.0, 8.0, 16.0, 32.0, CURVATURE}):
    _, _, one = stretched(curvature, m=60)
    touches = one.p > one.r
    force = f"{np.median(one.p[touches]) * 61**2:9.2f} {one.p.sum():12.4f}"
    print(f"{curvature:10.1f} {touches.sum() / 61**2:16.4f} {force}")

# %%
# ## Exercises
#
# **1.** The five-point formula is an approximation. Why is the pressure inside the contact $4c$ to all digits, on every
# grid?
#
# Answer: Its error has fourth derivatives of $u$ as a factor, and where $u = \psi$ is a paraboloid these are 0. Points
# at the edge of the contact have a free neighbour, which lies above the paraboloid: there the pressure is smaller.

inside = square(contact).copy()
for axis, shift in ((0, 1), (0, -1), (1, 1), (1, -1)):
    inside &= np.roll(square(contact), shift, axis)
within = square(solution.p)[inside] / h**2
print(
    f"inside {within.min():.9f} to {within.max():.9f}; smallest at the edge "
    f"{pressure.min():.4f}"
)
assert np.allclose(within, 4 * CURVATURE, rtol=1e-8), (
    "inside the contact the pressure is that of the formula"
)
assert pressure.max() <= 4 * CURVATURE * (1 + 1e-8), "and nowhere larger"

# %%
# **2.** Add up all equations $p = Az$. What carries the force with which the membrane presses on the hill?
#
# Answer: The frame. In the sum every inner coupling cancels. What is left is one $z$ for each side that a point has to
# the frame, whose height is 0: the pull on the frame.

frame = square(solution.z)
pull = frame[0].sum() + frame[-1].sum() + frame[:, 0].sum() + frame[:, -1].sum()
print(f"force on the hill {solution.p.sum():.9f}, pull on the frame {pull:.9f}")
assert np.isclose(solution.p.sum(), pull, rtol=1e-7), (
    "the edge pulls as much as the hill pushes"
)

# %%
# **3.** Put a table of height ½ in the place of the hill, a disc of radius 0.2 in the middle. Where does the membrane
# press on it?
#
# Answer: Only at its rim. It lies on the whole table, and inside it is flat, so that it touches without pressing:
# $p = 0$ and $r = 0$.

radius = np.hypot(x - 0.5, y - 0.5)
table = np.where(radius <= 0.2, 0.5, -1.0)  # far below the membrane elsewhere
A = solution.problem.A
flat = icp.ICP(A, np.zeros(M * M), table).solve(rtol=1e-10)
touched, pressing = flat.r < 1e-8, flat.p > 1e-8
print(
    f"{touched.sum()} points touch, {pressing.sum()} of them press, none nearer to "
    "the middle than",
    end=" ",
)
print(f"{radius[pressing].min():.3f}")
assert pressing.sum() < touched.sum() / 4, "few of the points that touch press"
assert radius[pressing].min() > 0.18, "and none of them in the middle"
