"""Recover an obstacle from noisy heights of the membrane that lies on it, and say where it cannot be recovered.

A membrane in a frame is pressed down by f per area onto ψ = table + Bθ, hills of 144 B-splines on a table; on the grid

    p = Az + h²f >= 0,    r = z - ψ >= 0,    p'r = 0,    n = 10 000,

and z is measured with noise of known size σ. Find θ >= 0 for which ½ |z - measured|²/σ² + ½ |Dθ|²/bend² is least; D is
the second difference between neighbouring splines, by which hills bend about so much. It teaches: the gradient in all
θ is one `adjoint`, one more linear solve after the solve for z; forward derivatives say how well each height is known.
Where nothing touches z does not depend on ψ: there the measurements are silent, and only the last term speaks.

To vary: PRESSURE. With 0 the membrane hangs from the hilltops and feels little more than these; with 60 it feels the
table.

Run: python examples/recover_obstacle.py      writes recover_obstacle.png and recover_obstacle.svg here
"""

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import scipy.sparse as sp
from scipy.interpolate import BSpline
from scipy.optimize import minimize

import icpmodel as icp

PRESSURE, TABLE, NOISE, BEND, SPLINES = 15.0, -0.2, 0.01, 0.1, 12

scene = icp.scenes.membrane(n=10_000)
(x, y), n, m = scene.points.T, 10_000, 100
hills = (0.36, 0.38, 0.5, 0.22), (0.68, 0.64, 0.4, 0.17), (0.32, 0.74, 0.3, 0.13)
truth = TABLE + sum(height * np.exp(-((x - a) ** 2 + (y - b) ** 2) / wide**2) for a, b, height, wide in hills)
problem = icp.ICP(scene.problem.A, np.full(n, PRESSURE * scene.h**2), truth)
measured = problem.solve(rtol=1e-12).z + NOISE * np.random.default_rng(1).standard_normal(n)

# cubic splines that are 0 at the frame: leave out the first one and the last one of a line
knots = np.concatenate([np.zeros(3), np.linspace(0, 1, SPLINES), np.ones(3)])
line = BSpline.design_matrix(np.arange(1, m + 1) / (m + 1), knots, 3)[:, 1:-1]
B = sp.kron(line, line, format="csr")
bends = sp.diags_array([1.0, -2.0, 1.0], offsets=[-1, 0, 1], shape=(SPLINES, SPLINES))
one = sp.eye_array(SPLINES)
D = sp.vstack([sp.kron(bends, one), sp.kron(one, bends)], format="csr") / BEND

last, certain = None, []


def misfit(theta: np.ndarray) -> tuple[float, np.ndarray]:
    """What is to be least, and its gradient. L-BFGS-B compares nearly equal values: z is solved to 12 digits."""
    global last
    last = problem.with_psi(TABLE + B @ theta).solve(z0=last, rtol=1e-12)  # starts from the answer before
    error, rough = (last.z - measured) / NOISE, D @ theta
    derivative = last.derivative()
    certain.append(derivative.certain)
    gradient = B.T @ derivative.adjoint(error / NOISE).psi + D.T @ rough
    return 0.5 * (error @ error + rough @ rough), gradient


# Begin too high rather than too low: splines that touch nothing would have no gradient to rise by.
start = np.maximum(np.linalg.lstsq(B.toarray(), measured - TABLE, rcond=None)[0], 0.0)
step = 1e-5 * np.random.default_rng(2).standard_normal(start.size)
differences, slope = misfit(start + step)[0] - misfit(start - step)[0], 2 * misfit(start)[1] @ step
assert abs(differences - slope) <= 1e-2 * abs(slope)

# It ends when a step gains less than 1e-5 of about n/2, .05; chance alone moves χ² by √(2n) = 141.
found = minimize(misfit, start, jac=True, method="L-BFGS-B", bounds=[(0, None)] * start.size, options={"ftol": 1e-5})
psi, solution = TABLE + B @ found.x, problem.with_psi(TABLE + B @ found.x).solve(z0=last, rtol=1e-12)
touches = solution.p > solution.r

# How well the heights are known: the curvature of what was made least, from one forward derivative per spline.
derivative = solution.derivative()
dz = np.column_stack([derivative.forward(dpsi=spline) for spline in B.T.toarray()])
curvature = dz.T @ dz / NOISE**2 + (D.T @ D).toarray()
expected = np.sqrt((B.toarray() * np.linalg.solve(curvature, B.toarray().T).T).sum(axis=1))
seen = expected < NOISE

print(f"{start.size} splines from {n} heights with noise {NOISE}: {found.nit} iterations, {found.nfev} adjoints")
print(f"mean squared misfit / noise²: {np.mean((solution.z - measured) ** 2) / NOISE**2:.3f}\n")
print(f"{'the membrane':>24} {'points':>7} {'error expected':>15} {'true error':>11}")
for words, where in (
    ("touches", touches),
    ("is near by, seen", seen & ~touches),
    ("hangs free, not seen", ~seen & ~touches),
):
    rms = [np.sqrt(np.mean(error[where] ** 2)) for error in (expected, psi - truth)]
    print(f"{words:>24} {where.sum():7d} {rms[0]:15.4f} {rms[1]:11.4f}")
print(f"\nThe derivative was certain at {sum(certain)} of {len(certain)} shapes on the way; at the last one:")
print(f"{derivative.reason}.")

plt.rcParams |= {"hatch.color": "0.8", "hatch.linewidth": 0.6}
figure, (heights, plan, section) = plt.subplots(1, 3, figsize=(13, 4.2), layout="constrained")
frame = {"extent": (0, 1, 0, 1), "origin": "lower", "vmin": TABLE, "vmax": truth.max(), "cmap": "cividis"}
heights.imshow(measured.reshape(m, m), **frame)
heights.set_title("The membrane, measured")
picture = plan.imshow(psi.reshape(m, m), **frame)
grid = scene.points.reshape(m, m, 2)
across, up = grid[..., 0], grid[..., 1]
unseen = np.where(seen, 0.0, 1.0).reshape(m, m)
plan.contourf(across, up, unseen, levels=[0.5, 1.5], colors="none", hatches=["////"])
plan.contour(across, up, touches.reshape(m, m).astype(float), levels=[0.5], colors="white", linewidths=1.5)
plan.set_title("The obstacle: touched (white), not seen (hatched)")
figure.colorbar(picture, ax=plan, label="height")
for axes in (heights, plan):
    axes.plot([0, 1], [0, 1], ":", color="white", linewidth=1)
    axes.set_xlabel("x, sides of the square")
heights.set_ylabel("y, sides of the square")

along = np.arange(m) * (m + 1)
at = x[along]
low, high = (psi - 2 * expected)[along], (psi + 2 * expected)[along]
section.fill_between(at, low, high, color="#D55E00", alpha=0.25, linewidth=0)
section.plot(at, measured[along], ".", color="0.6", markersize=4, label="measured")
section.plot(at, solution.z[along], color="#0072B2", label="membrane")
section.plot(at, psi[along], color="#D55E00", label="obstacle, ± 2 errors")
section.plot(at, truth[along], "--", color="black", linewidth=1, label="true obstacle")
section.set_xlabel("x = y, along the diagonal")
section.set_ylabel("height")
section.set_title("Known where it is touched")
section.legend(frameon=False, fontsize=9)
for suffix in ("png", "svg"):
    figure.savefig(f"recover_obstacle.{suffix}", dpi=150)
