"""Prices that clear markets, where the law keeps the wage above a floor that moves with the other prices. In Pyomo.

A market clears, or its price lies at its floor and something is left over:
price >= floor(prices), supply - demand >= 0, and one of the two holds with equality.

Run: python examples/market_equilibrium.py    writes market_equilibrium.png and market_equilibrium.svg here
"""

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import pyomo.environ as pyo
from pyomo.mpec import Complementarity, complements

import icpmodel as icp

GOODS = ["bread", "housing", "labour"]
#: by how much supply less demand of one good rises with the price of another; goods replace each other a little
SLOPE = {"bread": [5.0, -1.0, -1.5], "housing": [-0.5, 4.0, -1.0], "labour": [-1.0, -0.5, 3.0]}
#: how much more is demanded than supplied if everything costs nothing
WANTED = {"bread": 6.0, "housing": 9.0, "labour": 2.0}

model = pyo.ConcreteModel()
model.price = pyo.Var(GOODS, within=pyo.NonNegativeReals)
model.share = pyo.Param(initialize=0.0, mutable=True)
model.cost_of_living = pyo.Expression(expr=pyo.sqrt(0.01 + model.price["bread"] * model.price["housing"]))


@model.Expression(GOODS)
def left_over(model, good):
    return sum(slope * model.price[other] for slope, other in zip(SLOPE[good], GOODS, strict=True)) - WANTED[good]


def market(model, good):
    floor = model.share * model.cost_of_living if good == "labour" else 0.0
    return complements(model.price[good] >= floor, model.left_over[good] >= 0)


model.market = Complementarity(GOODS, rule=market)
solver = icp.pyomo_solver(rtol=1e-12)

print(f"{'share of cost of living':>26}" + "".join(f"{good:>10}" for good in GOODS) + f"{'unemployed':>12}")
for share in (0.0, 0.8, 1.0, 1.2):
    model.share.set_value(share)
    pyo.assert_optimal_termination(solver.solve(model))  # starts from the prices before
    prices = "".join(f"{model.price[good].value:10.4f}" for good in GOODS)
    print(f"{share:26.1f}{prices}{pyo.value(model.left_over['labour']):12.4f}")
print()
print(
    "A floor above the market's own wage makes everything dearer, bread and housing too, and leaves some without work."
)

shares, found = [k / 20 for k in range(25)], []
for share in shares:
    model.share.set_value(share)
    pyo.assert_optimal_termination(solver.solve(model))
    found.append([model.price[good].value for good in GOODS] + [pyo.value(model.left_over["labour"])])
figure, (prices, work) = plt.subplots(1, 2, figsize=(9, 3.9), layout="constrained")
*by_good, unemployed = zip(*found, strict=True)
for good, price, colour, line in zip(GOODS, by_good, ("#0072B2", "#D55E00", "#009E73"), ("--", "-.", "-"), strict=True):
    prices.plot(shares, price, line, color=colour, label="wage" if good == "labour" else good)
work.plot(shares, unemployed, color="black")
prices.set_ylabel("price")
prices.set_title("A floor that binds makes everything dearer")
prices.legend(frameon=False)
work.set_ylabel("labour offered less labour wanted")
work.set_title("Unemployment")
for axes in (prices, work):
    axes.set_xlabel("wage floor / cost of living")
for suffix in ("png", "svg"):
    figure.savefig(f"market_equilibrium.{suffix}", dpi=150)
