"""A journal bearing: oil cannot pull, so its film tears. How much load does the rest of it carry?

It teaches: where Reynolds' equation alone would make the pressure negative, the film tears (cavitates); p >= 0 and the
equation's residual >= 0 are complementary, and nobody has to say beforehand where the film ends.

Run: python examples/journal_bearing.py       writes journal_bearing.png and journal_bearing.svg into the current folder
"""

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

import icpmodel as icp

n = 999
h = 2 * np.pi / (n + 1)
theta = h * np.arange(1, n + 1)
middles = h * (np.arange(n + 1) + 0.5)


def bearing(eccentricity: float) -> icp.ICP:
    """-(H^3 p')' + H' >= 0, p >= 0, complementary; H = 1 + eccentricity cos(theta) is the film's thickness."""
    H = 1 + eccentricity * np.cos(middles)
    cubes = H**3
    A = sp.diags_array([-cubes[1:-1], cubes[:-1] + cubes[1:], -cubes[1:-1]], offsets=[-1, 0, 1])
    return icp.ICP(A, h * np.diff(H))


def load(pressure: np.ndarray) -> float:
    """The size of the force on the shaft, per length of the bearing."""
    return h * float(np.hypot(pressure @ np.cos(theta), pressure @ np.sin(theta)))


figure, (curves, loads) = plt.subplots(1, 2, figsize=(9, 3.9), layout="constrained")
print(f"{'eccentricity':>12} {'highest pressure':>17} {'film tears at':>14} {'load':>9}")
for eccentricity, colour, line in ((0.3, "#0072B2", "-"), (0.5, "#D55E00", "--"), (0.7, "#009E73", "-.")):
    problem = bearing(eccentricity)
    pressure = problem.solve(rtol=1e-10).z
    tears = np.rad2deg(theta[pressure > 1e-9][-1])
    print(f"{eccentricity:12.1f} {pressure.max():17.4f} {tears:10.1f} deg {load(pressure):9.4f}")
    curves.plot(np.rad2deg(theta), pressure, line, color=colour, label=f"ε = {eccentricity}")
    if eccentricity == 0.5:
        linear = spsolve(problem.A.tocsc(), -problem.q)  # Reynolds' equation everywhere: the oil would have to pull
        curves.plot(np.rad2deg(theta), linear, ":", color="black", linewidth=1, label="ε = 0.5, no tearing")
        assert abs(pressure.max() - 0.745831366621) < 1e-5  # known to all these digits for the continuous problem

several = np.linspace(0.0, 0.9, 37)[1:]
loads.semilogy(several, [load(bearing(one).solve(rtol=1e-10).z) for one in several], color="#0072B2")
curves.set_xlabel("angle from the widest gap, degrees")
curves.set_ylabel("pressure / (6 viscosity · speed · radius / clearance²)", fontsize=9)
curves.set_xticks(range(0, 361, 60))
curves.set_title("Pressure in the oil film")
curves.legend(frameon=False)
loads.set_xlabel("eccentricity ε = offset of the shaft / clearance")
loads.set_ylabel("load, dimensionless")
loads.set_title("The nearer to the wall, the more it carries")
loads.grid(alpha=0.3)
for suffix in ("png", "svg"):
    figure.savefig(f"journal_bearing.{suffix}", dpi=150)
