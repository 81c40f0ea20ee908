r"""How much load does a torn film of oil carry?

Oil in a bearing cannot pull: where it would have to, the film tears, and nobody has to say beforehand where.

Run: python examples/journal_bearing.py       writes journal_bearing.png and journal_bearing.svg into the current folder
"""

# %%
# ## The model
#
# A shaft turns in a bearing that is a little wider, out of its middle by the fraction $\varepsilon$ of the clearance:
# at the angle $\theta$ the film of oil between them has the thickness $H = 1 + \varepsilon\cos\theta$. The shaft drags
# oil into the narrowing gap, which builds up the pressure $u$. Reynolds' equation says that the flow $H - H^3 u'$ is
# the same everywhere. Where the film tears, $u = 0$ and the flow need not fill the gap:
#
# $$-(H^3 u')' + H' \ge 0, \qquad u \ge 0, \qquad \text{one of them } 0, \qquad u(0) = u(2\pi) = 0.$$
#
# With $H$ in the middle between grid points, $h$ apart, and rows multiplied by $h^2$,
#
# $$p_i = H^3_{i-1/2}(z_i - z_{i-1}) + H^3_{i+1/2}(z_i - z_{i+1}) + h\,(H_{i+1/2} - H_{i-1/2}) \ge 0, \qquad
#   z \ge 0, \qquad p^T z = 0.$$
#
# The load that the film carries is $\left|\int u\,(\cos\theta, \sin\theta)\,d\theta\right|$; $\varepsilon$ is
# `ECCENTRICITY`.

import itertools

import matplotlib.pyplot as plt
import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

import icpmodel as icp

ECCENTRICITY, N = 0.5, 999  # ECCENTRICITY from 0.1 to 0.9


def bearing(eccentricity: float, n: int = N) -> icp.ICP:
    h = 2 * np.pi / (n + 1)
    H = 1 + eccentricity * np.cos(h * (np.arange(n + 1) + 0.5))
    cubes = H**3
    A = sp.diags_array(
        [-cubes[1:-1], cubes[:-1] + cubes[1:], -cubes[1:-1]], offsets=[-1, 0, 1]
    )
    return icp.ICP(A, h * np.diff(H))


def angles(z: np.ndarray) -> np.ndarray:
    return 2 * np.pi * np.arange(1, z.size + 1) / (z.size + 1)


def load(z: np.ndarray) -> float:
    """The size of the force on the shaft, per length of the bearing."""
    theta = angles(z)
    return theta[0] * float(np.hypot(z @ np.cos(theta), z @ np.sin(theta)))


# %%
# ## What is seen
#
# Reynolds' equation alone, without tearing, has a pressure below zero behind the narrowest gap, as large as the one
# before it. With tearing the film ends somewhat behind the narrowest gap, and the pressure reaches further.

problem = bearing(ECCENTRICITY)
torn = problem.solve(rtol=1e-10).z
linear = spsolve(problem.A.tocsc(), -problem.q)
print(f"without tearing: pressure from {linear.min():.4f} to {linear.max():.4f}")
print(f"with tearing:    pressure from {torn.min():.4f} to {torn.max():.4f},", end=" ")
print(
    f"film ends at {np.rad2deg(angles(torn)[torn > 1e-9][-1]):.1f} degrees, load "
    f"{load(torn):.4f}"
)

# %%
# The pressure for three eccentricities, and the load for all.

figure, (curves, loads) = plt.subplots(1, 2, figsize=(9, 3.9), layout="constrained")
for eccentricity, colour, line in (
    (0.3, "#0072B2", "-"),
    (0.5, "#D55E00", "--"),
    (0.7, "#009E73", "-."),
):
    z = bearing(eccentricity).solve(rtol=1e-10).z
    curves.plot(
        np.rad2deg(angles(z)), z, line, color=colour, label=f"ε = {eccentricity}"
    )
words = f"ε = {ECCENTRICITY}, no tearing"
curves.plot(
    np.rad2deg(angles(linear)), linear, ":", color="black", linewidth=1, label=words
)
several = np.linspace(0.0, 0.9, 37)[1:]
loads.semilogy(
    several,
    [load(bearing(one).solve(rtol=1e-10).z) for one in several],
    color="#0072B2",
)
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

# %%
# ## Vary one thing
#
# `ECCENTRICITY`. A loaded shaft moves out of the middle until the film carries it: read the table from right to left.

print(
    f"{'eccentricity':>12} {'highest pressure':>17} {'film tears at':>14} {'load':>9}"
)
for eccentricity in sorted({0.1, 0.3, 0.5, 0.7, 0.9, ECCENTRICITY}):
    z = bearing(eccentricity).solve(rtol=1e-10).z
    tears = np.rad2deg(angles(z)[z > 1e-9][-1])
    print(f"{eccentricity:12.1f} {z.max():17.4f} {tears:10.1f} deg {load(z):9.4f}")

# %%
# ## Exercises
#
# **1.** An old rule solves Reynolds' equation alone and puts 0 where the pressure is negative. For $\varepsilon = 0.5$,
# by how much is its load wrong, and which law does it break?
#
# Answer: It is too small. Where it cuts, the slope of the pressure jumps from a negative value to 0, and with it the
# flow $H - H^3u'$: oil is lost. In the complementarity problem $u$ and $u'$ both end at 0.

one = bearing(0.5)
right, cut = one.solve(rtol=1e-10).z, np.maximum(spsolve(one.A.tocsc(), -one.q), 0)
print(
    f"load {load(cut):.4f} instead of {load(right):.4f}: "
    f"{100 * (1 - load(cut) / load(right)):.0f} % too small"
)
lost = [max(-one.p(z).min(), 0) / angles(z)[0] for z in (cut, right)]
print(
    f"flow lost in one point: {lost[0]:.3f} where it was cut, {lost[1]:.0e} by the "
    "answer"
)
assert load(cut) < load(right), "a film that is cut off carries less"
assert one.p(cut).min() < -1e-4, "and loses oil where it is cut"

# %%
# **2.** Compute the flow $H - H^3u'$ in each cell. Where is it constant, and what is it where the film has torn?
#
# Answer: Constant as far as the film is whole. Behind, $u' = 0$ and $H - H^3u'$ is $H$, which is more than comes: the
# gap is filled only in part.

n, z = N, np.concatenate([[0.0], right, [0.0]])
H = 1 + 0.5 * np.cos(2 * np.pi / (n + 1) * (np.arange(n + 1) + 0.5))
flow = H - H**3 * np.diff(z) / (2 * np.pi / (n + 1))
last = int(np.flatnonzero(right > 1e-9)[-1])
print(
    f"flow in the film: {flow[: last + 1].min():.6f} to "
    f"{flow[: last + 1].max():.6f}; at the end {flow[-1]:.6f}"
)
assert np.ptp(flow[: last + 1]) < 1e-6 < flow[-1] - flow[0], (
    "the flow is constant in the film, and larger behind it"
)

# %%
# **3.** The continuous problem with $\varepsilon = 0.5$ has the highest pressure 0.745831366621. By which factor does
# the error fall where the grid is made three times as fine?
#
# Answer: About 9, $3^2$: the scheme is of second order, in spite of the free boundary. Not exactly, since the error
# depends as well on where between two grid points the film ends. The parabola through the three highest points gives
# the highest pressure between grid points.


def top(z: np.ndarray) -> float:
    k = int(np.argmax(z))
    a, b, c = z[k - 1 : k + 2]
    return float(b + (a - c) ** 2 / (8 * (2 * b - a - c)))


errors = [
    abs(top(bearing(0.5, n).solve(rtol=1e-9).z) - 0.745831366621)
    for n in (299, 899, 2699)
]
print("errors " + ", ".join(f"{one:.2e}" for one in errors), end="; factors ")
print(", ".join(f"{a / b:.1f}" for a, b in itertools.pairwise(errors)))
assert all(5 < a / b < 15 for a, b in itertools.pairwise(errors)), (
    "three times the points divide the error by about nine"
)
