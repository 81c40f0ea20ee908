"""Five firms on one market: how much does each produce, if none can gain by changing its output alone?

It teaches: the firms' optimality conditions together are one complementarity problem. Firm i chooses x_i to maximise
x_i (price - cost_i), 0 <= x_i <= capacity_i, where price = demand - slope * (sum of all x); y_i is what one unit more
of capacity would be worth to it:

    cost - price + slope * x + y >= 0,  x >= 0,      capacity - x >= 0,  y >= 0,      each pair complementary.

The model is written three times, in NumPy, CVXPY and Pyomo; the answers are the same.

Run: python examples/nash_cournot.py          writes nash_cournot.png and nash_cournot.svg into the current folder
"""

import cvxpy as cp
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pyomo.environ as pyo
from pyomo.mpec import Complementarity, complements

import icpmodel as icp
import icpmodel.modelling.pyomo

cost = np.array([10.0, 15.0, 20.0, 30.0, 45.0])
capacity = np.array([15.0, 20.0, 30.0, 30.0, 30.0])
demand, slope, n = 100.0, 1.0, cost.size

# 1. NumPy: z = (x, y)
one, eye = np.ones((n, n)), np.eye(n)
A = np.block([[slope * (one + eye), eye], [-eye, 0 * eye]])
in_numpy = icp.ICP(A, np.concatenate([cost - demand, capacity])).solve(rtol=1e-12)

# 2. CVXPY
x, y, asked = cp.Variable(n, name="x"), cp.Variable(n, name="y"), cp.Parameter(name="asked", value=demand)
market = icp.Problem(
    [icp.complements(cost - (asked - slope * cp.sum(x)) + slope * x + y, x), icp.complements(capacity - x, y)]
)
market.solve(rtol=1e-12)
in_cvxpy = np.concatenate([x.value, y.value])

# 3. Pyomo
model = pyo.ConcreteModel()
model.x, model.y = pyo.Var(range(n)), pyo.Var(range(n))
model.price = pyo.Expression(expr=demand - slope * sum(model.x[j] for j in range(n)))
model.output = Complementarity(
    range(n),
    rule=lambda m, i: complements(cost[i] - m.price + slope * m.x[i] + m.y[i] >= 0, m.x[i] >= 0),
)
model.limit = Complementarity(range(n), rule=lambda m, i: complements(m.x[i] <= capacity[i], m.y[i] >= 0))
pyo.assert_optimal_termination(pyo.SolverFactory("icpmodel", options={"rtol": 1e-12}).solve(model))
in_pyomo = np.array([pyo.value(v) for v in (*model.x.values(), *model.y.values())])

apart = max(np.abs(in_numpy.z - in_cvxpy).max(), np.abs(in_numpy.z - in_pyomo).max())
assert apart <= 1e-9
print(f"NumPy, CVXPY and Pyomo give the same z: the largest difference is {apart:.1e}\n")

output, worth = in_numpy.z[:n], in_numpy.z[n:]
price = demand - slope * output.sum()
best = np.clip((price + slope * output - cost) / (2 * slope), 0, capacity)  # each one's best answer to the others
assert np.abs(best - output).max() <= 1e-9
print(f"{'firm':>4} {'cost':>6} {'capacity':>9} {'output':>8} {'best answer':>12} {'capacity is worth':>18}")
for i in range(n):
    print(f"{i + 1:4d} {cost[i]:6.1f} {capacity[i]:9.1f} {output[i]:8.3f} {best[i]:12.3f} {worth[i]:18.3f}")
print(f"price {price:.3f}, sold {output.sum():.3f}")

levels, outputs = np.linspace(0, 200, 201), []
for asked.value in levels:  # one compiled model; every solve starts from the answer before
    market.solve(rtol=1e-12)
    outputs.append(x.value)
figure, axes = plt.subplots(figsize=(6.4, 4), layout="constrained")
looks = ("#0072B2", "-"), ("#D55E00", "--"), ("#009E73", "-."), ("#CC79A7", ":"), ("#E69F00", (0, (5, 1, 1, 1, 1, 1)))
for i, (colour, line) in enumerate(looks):
    axes.plot(levels, np.array(outputs)[:, i], linestyle=line, color=colour, label=f"firm {i + 1}, cost {cost[i]:.0f}")
axes.set_xlabel("highest price that anyone would pay")
axes.set_ylabel("output, units")
axes.set_title("Firms enter by cost and end at capacity")
axes.legend(frameon=False)
for suffix in ("png", "svg"):
    figure.savefig(f"nash_cournot.{suffix}", dpi=150)
