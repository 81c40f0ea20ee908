"""One model in three languages: a string over an obstacle in NumPy, in CVXPY and in Pyomo gives the same z.

It teaches: how A, q and psi look in each; whatever the language, the same problem is solved, judged and certified.

Run: python examples/three_front_ends.py      writes three_front_ends.png and .svg into the current folder
"""

import cvxpy as cp
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pyomo.environ as pyo
import scipy.sparse as sp
from pyomo.mpec import Complementarity, complements

import icpmodel as icp
import icpmodel.modelling.pyomo  # Pyomo's SolverFactory now knows "icpmodel"

# A string between two nails, pulled down by its weight, above a bump: -z'' + weight >= 0 and z >= bump, complementary.
n, weight = 100, 1.0
h = 1 / (n + 1)
s = h * np.arange(1, n + 1)
bump = 0.15 - 2 * (s - 0.6) ** 2

# 1. NumPy and SciPy: the matrix, the vector, the obstacle
A = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n, n))
in_numpy = icp.ICP(A, np.full(n, weight * h**2), bump).solve(rtol=1e-13)

# 2. CVXPY: expressions of a variable
z = cp.Variable(n, name="z")
string = cp.hstack([0, z, 0])
icp.Problem(icp.complements(2 * z - string[:-2] - string[2:] + weight * h**2, z - bump)).solve(rtol=1e-13)
in_cvxpy = z.value

# 3. Pyomo: one condition for every point
model = pyo.ConcreteModel()
model.z = pyo.Var(range(n + 2))
model.z[0].fix(0.0)
model.z[n + 1].fix(0.0)
model.contact = Complementarity(
    range(1, n + 1),
    rule=lambda m, i: complements(
        2 * m.z[i] - m.z[i - 1] - m.z[i + 1] + weight * h**2 >= 0, m.z[i] >= float(bump[i - 1])
    ),
)
pyo.assert_optimal_termination(pyo.SolverFactory("icpmodel", options={"rtol": 1e-13}).solve(model))
in_pyomo = np.array([model.z[i].value for i in range(1, n + 1)])

print(in_numpy)
for name, other in (("CVXPY", in_cvxpy), ("Pyomo", in_pyomo)):
    apart = np.abs(other - in_numpy.z).max()
    assert apart <= 1e-9
    print(f"{name} and NumPy: the same z to 1e-9; the largest difference is {apart:.1e}")
touches = in_numpy.p > in_numpy.r
print(f"{touches.sum()} of {n} points touch the bump, from s = {s[touches][0]:.3f} to s = {s[touches][-1]:.3f}")

figure, (shape, force) = plt.subplots(1, 2, figsize=(9, 3.9), layout="constrained")
shape.plot(s, bump, color="#D55E00", label="bump ψ")
shape.plot(s, in_numpy.z, color="#0072B2", label="string, NumPy")
shape.plot(s[2::8], in_cvxpy[2::8], "s", color="#E69F00", markersize=5, label="string, CVXPY")
shape.plot(s[6::8], in_pyomo[6::8], "x", color="black", markersize=5, label="string, Pyomo")
shape.set_ylim(-0.08, 0.22)
shape.set_xlabel("s, lengths between the nails")
shape.set_ylabel("height z")
shape.set_title("One string, written three times")
shape.legend(frameon=False, fontsize=9, ncols=2)
force.plot(s, in_numpy.p / h**2, color="#0072B2")
force.set_xlabel("s, lengths between the nails")
force.set_ylabel("force of the bump per length")
force.set_title("It presses only where they touch")
for suffix in ("png", "svg"):
    figure.savefig(f"three_front_ends.{suffix}", dpi=150)
