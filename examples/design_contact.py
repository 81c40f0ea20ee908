"""Choose the load on a membrane so that it touches the floor where that is wanted, and nowhere else.

A membrane in a frame hangs above a floor; pistons load it with f per area, 484 B-splines Bθ within what they can do,

    p = Az + h²Bθ >= 0,    r = z - floor >= 0,    p'r = 0,    n = 10 000.

Wanted is contact in the shape of a Ψ. It teaches: whether a point touches has no derivative, but how firmly it does, p,
and how far it is from it, r, have one, and one of them is 0. So the margin p/push - r/gap, in units of the pressure and
the gap that are enough, is continuous where a point begins to touch; it is to be at least 1 inside the shape and at
most -1 outside, and the mean square of what it falls short is made least, with its gradient by one `adjoint`.
Contact comes and goes on the way; at each load the derivative says whether it is certain, that is, whether it is proved
of every point on which side it is.

To vary: MOST, the strength of the pistons; with 5 the letter loses its ends. Or another shape: any mask will do.

Run: python examples/design_contact.py        writes design_contact.png and design_contact.svg into the current folder
"""

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import scipy.sparse as sp
from scipy.interpolate import BSpline
from scipy.ndimage import distance_transform_edt
from scipy.optimize import minimize

import icpmodel as icp

FLOOR, MOST, PUSH, GAP, SPLINES, START = -0.1, 12.0, 2.0, 0.002, 22, 5.0

scene = icp.scenes.membrane(n=10_000)
(x, y), A, cell, m = 2 * scene.points.T - 1, scene.problem.A, scene.h**2, 100
bowl, arms = np.abs(np.hypot(x, y - 0.15) - 0.45) < 0.09, np.abs(np.abs(x) - 0.45) < 0.09
psi = ((np.abs(x) < 0.09) & (np.abs(y) < 0.72)) | np.where(y < 0.15, bowl, arms & (y < 0.6))
# a cell or two on both sides of its edge may do what they like: somewhere there contact has to end
letter = psi.reshape(m, m)
far = (distance_transform_edt(letter) > 1.5) | (distance_transform_edt(~letter) > 2.0)
side = np.where(far.ravel(), np.where(psi, 1.0, -1.0), 0.0)

knots = np.concatenate([np.zeros(3), np.linspace(0, 1, SPLINES - 2), np.ones(3)])
line = BSpline.design_matrix(np.arange(1, m + 1) / (m + 1), knots, 3)
B = sp.kron(line, line, format="csr")
last, certain = None, []


def shortfall(theta: np.ndarray) -> tuple[float, np.ndarray]:
    """What is to be least, and its gradient: z moves p and r, and the load also p itself."""
    global last
    last = icp.ICP(A, cell * (B @ theta), FLOOR).solve(z0=last, rtol=1e-10)  # starts from the answer before
    missing = np.abs(side) * np.maximum(1 - side * (last.p / cell / PUSH - last.r / GAP), 0.0)
    by_p, by_r = -side * missing / (m * m * cell * PUSH), side * missing / (m * m * GAP)
    derivative = last.derivative()
    by_q = derivative.adjoint(A.T @ by_p + by_r).q + by_p
    certain.append(derivative.certain)
    return 0.5 * np.mean(missing**2), cell * (B.T @ by_q)


theta = np.full(SPLINES**2, START)
step = 1e-4 * np.random.default_rng(0).standard_normal(theta.size)
differences, slope = shortfall(theta + step)[0] - shortfall(theta - step)[0], 2 * shortfall(theta)[1] @ step
assert abs(differences - slope) <= 1e-4 * abs(slope)
before = last
certain.clear()
found = minimize(shortfall, theta, jac=True, method="L-BFGS-B", bounds=[(-MOST, MOST)] * theta.size)
shortfall(found.x)
after = last

print(f"{'':>14} {'inside: touch':>14} {'do not':>7} {'outside: touch':>15} {'do not':>7}")
for words, solution in (("uniform load", before), ("chosen load", after)):
    touches = solution.p > solution.r
    counts = [np.sum((side == s) & (touches == t)) for s in (1, -1) for t in (True, False)]
    print(f"{words:>14} {counts[0]:14d} {counts[1]:7d} {counts[2]:15d} {counts[3]:7d}")
strongest = np.sum(np.abs(found.x) == MOST)
print(
    f"after {found.nit} iterations and {found.nfev} adjoints; {strongest} of {theta.size} pistons at their strongest\n"
)
print(f"The derivative was certain at {sum(certain)} of {len(certain)} loads on the way; at the last one:")
print(f"{after.derivative().reason}.")

shade = {"extent": (-1, 1, -1, 1), "origin": "lower"}
touched = {"cmap": "cividis", "vmin": 0, "vmax": 0.9 * after.p.max() / cell}


def pressure(solution: icp.Solution) -> np.ndarray:
    return np.where(solution.p > solution.r, solution.p / cell, np.nan).reshape(m, m)


figure, (first, load, last_one) = plt.subplots(1, 3, figsize=(13, 4.2), layout="constrained", sharey=True)
first.imshow(pressure(before), **shade, **touched)
first.set_title(f"Contact under the uniform load {START:.0f}")
picture = load.imshow((B @ found.x).reshape(m, m), **shade, cmap="RdBu_r", vmin=-MOST, vmax=MOST)
figure.colorbar(picture, ax=load, label="load, force per area")
load.set_title("The load that was chosen")
picture = last_one.imshow(pressure(after), **shade, **touched)
figure.colorbar(picture, ax=last_one, label="pressure on the floor")
last_one.set_title("Contact under it")
for axes in (first, load, last_one):
    axes.contour(
        *(one.reshape(m, m) for one in (x, y)), letter.astype(float), levels=[0.5], colors="black", linewidths=1
    )
    axes.set_xlabel("x, half sides of the square")
first.set_ylabel("y, half sides of the square")
first.annotate("black line: where contact is wanted", (0, -0.9), ha="center", fontsize=9)
for suffix in ("png", "svg"):
    figure.savefig(f"design_contact.{suffix}", dpi=150)
