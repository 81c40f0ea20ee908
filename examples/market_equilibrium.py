r"""What does a floor under wages do to all the other prices, if the floor rises with these prices?

A model of three markets in Pyomo, with an obstacle that moves with the solution.

Run: python examples/market_equilibrium.py    writes market_equilibrium.png and market_equilibrium.svg here
"""

# %%
# ## The model
#
# Three goods have prices $z$: bread, housing, labour. A market clears, or its price lies at its floor and something is
# left over:
#
# $$p = Az - w \ge 0, \qquad r = z - \psi(z) \ge 0, \qquad p^T r = 0.$$
#
# $p_i$ is supply less demand of good $i$. It rises with its own price and falls with the prices of the others, which
# replace it a little. $w$ is what is wanted if everything is free. The law keeps the wage above a share of the cost of
# living,
#
# $$\psi(z) = \left(0,\ 0,\ s\,\sqrt{0.01 + z_{\text{bread}}\, z_{\text{housing}}}\right).$$
#
# Where the floor binds, $p_3$ is unemployment: labour offered less labour wanted. $s$ is `SHARE`.

import matplotlib.pyplot as plt
import numpy as np
import pyomo.environ as pyo
from pyomo.mpec import Complementarity, complements

import icpmodel as icp

SHARE = 1.0  # 0 to 1
GOODS = ["bread", "housing", "labour"]
SLOPE = {
    "bread": [5.0, -1.0, -1.5],
    "housing": [-0.5, 4.0, -1.0],
    "labour": [-1.0, -0.5, 3.0],
}
WANTED = {"bread": 6.0, "housing": 9.0, "labour": 2.0}

model = pyo.ConcreteModel()
model.price = pyo.Var(GOODS, within=pyo.NonNegativeReals)
model.share = pyo.Param(initialize=SHARE, mutable=True)
living = pyo.sqrt(0.01 + model.price["bread"] * model.price["housing"])
model.cost_of_living = pyo.Expression(expr=living)


@model.Expression(GOODS)
def left_over(model, good):
    supply = sum(
        slope * model.price[other]
        for slope, other in zip(SLOPE[good], GOODS, strict=True)
    )
    return supply - WANTED[good]


def market(model, good):
    floor = model.share * model.cost_of_living if good == "labour" else 0.0
    return complements(model.price[good] >= floor, model.left_over[good] >= 0)


model.market = Complementarity(GOODS, rule=market)
solver = icp.pyomo_solver(rtol=1e-12)


def prices(share: float) -> list[float]:
    """Prices of the three goods, and unemployment; a solve starts from the last one."""
    model.share.set_value(share)
    pyo.assert_optimal_termination(solver.solve(model))
    found = [pyo.value(model.price[good]) for good in GOODS]
    return [*found, max(pyo.value(model.left_over["labour"]), 0.0)]


# %%
# ## What is seen
#
# Without a floor all markets clear. With the floor the wage is higher, some find no work, and bread and housing are
# dearer as well: they replace labour a little, and what replaces a dear good is wanted more.

for share in (0.0, SHARE):
    *found, unemployed = prices(share)
    print(
        f"share {share}: "
        + ", ".join(f"{g} {v:.4f}" for g, v in zip(GOODS, found, strict=True)),
        end="",
    )
    print(f"; unemployed {unemployed:.4f}")

# %%
# Nothing happens until the floor reaches the wage that the market pays anyway.

shares = [k / 20 for k in range(25)]
*by_good, unemployed = zip(*(prices(share) for share in shares), strict=True)
figure, (level, work) = plt.subplots(1, 2, figsize=(9, 3.9), layout="constrained")
looks = zip(
    GOODS, by_good, ("#0072B2", "#D55E00", "#009E73"), ("--", "-.", "-"), strict=True
)
for good, price, colour, line in looks:
    level.plot(
        shares, price, line, color=colour, label="wage" if good == "labour" else good
    )
work.plot(shares, unemployed, color="black")
level.set_ylabel("price")
level.set_title("A floor that binds makes everything dearer")
level.legend(frameon=False)
work.set_ylabel("labour offered less labour wanted")
work.set_title("Unemployment")
for axes in (level, work):
    axes.set_xlabel("wage floor / cost of living")
for suffix in ("png", "svg"):
    figure.savefig(f"market_equilibrium.{suffix}", dpi=150)

# %%
# ## Vary one thing
#
# `SHARE`.

print(
    f"{'share of cost of living':>26}"
    + "".join(f"{good:>10}" for good in GOODS)
    + f"{'unemployed':>12}"
)
for share in sorted({0.0, 0.8, 1.0, 1.2, SHARE}):
    print(
        f"{share:26.1f}" + "".join(f"{one:10.4f}" for one in prices(share)[:3]), end=""
    )
    print(f"{prices(share)[3]:12.4f}")

# %%
# ## Exercises
#
# **1.** From which share on does the floor bind?
#
# Answer: From the share that the wage of the free market is of its cost of living. Just below it nobody is unemployed,
# just above it somebody is.

*free, _ = prices(0.0)
edge = free[2] / (0.01 + free[0] * free[1]) ** 0.5
below, above = prices(edge - 1e-3)[3], prices(edge + 1e-3)[3]
print(
    f"from {edge:.4f} on; unemployed a little below {below:.1e}, a little above "
    f"{above:.1e}"
)
assert below < 1e-8 < above, (
    "nobody is unemployed below that share, somebody is above it"
)

# %%
# **2.** A floor in money, instead of one that rises with the cost of living: set it at the wage that the share 1.2 ends
# up with. Are prices the same?
#
# Answer: Yes: at the solution the obstacle has the same value, and an equilibrium asks for nothing else of it. But who
# sets the floor in money has to know that wage. Set at 1.2 times the cost of living of the *free* market, the floor is
# much lower, since the floor itself makes living dearer.

moving = prices(1.2)
fixed = pyo.ConcreteModel()
fixed.price = pyo.Var(GOODS, within=pyo.NonNegativeReals)
fixed.floor = pyo.Param(initialize=moving[2], mutable=True)


def clears(m, good):
    supply = sum(
        slope * m.price[other] for slope, other in zip(SLOPE[good], GOODS, strict=True)
    )
    return complements(
        m.price[good] >= (m.floor if good == "labour" else 0.0),
        supply - WANTED[good] >= 0,
    )


fixed.market = Complementarity(GOODS, rule=clears)
pyo.assert_optimal_termination(solver.solve(fixed))
apart = max(
    abs(pyo.value(fixed.price[good]) - one)
    for good, one in zip(GOODS, moving, strict=False)
)
fixed.floor.set_value(1.2 * (0.01 + free[0] * free[1]) ** 0.5)
pyo.assert_optimal_termination(solver.solve(fixed))
print(
    f"the same but for {apart:.0e}; wage {moving[2]:.4f} with the floor that moves,",
    end=" ",
)
print(
    f"{pyo.value(fixed.price['labour']):.4f} with 1.2 times the free market's cost "
    "of living"
)
assert apart < 1e-8, "Pyomo finds the same prices"
assert pyo.value(fixed.price["labour"]) < moving[2], (
    "a floor that is fixed gives a lower wage"
)

# %%
# **3.** With the floor of 1.2, how many does the state have to hire for nobody to be unemployed? What happens to the
# prices, and what if it hires half as many again? (Three rows of numbers are quicker in NumPy.)
#
# Answer: As many as were unemployed. No price changes: they satisfy the same conditions, with nothing left over on the
# market for labour. If it hires more, the wage leaves its floor, and all prices rise.


def floor(z: np.ndarray) -> np.ndarray:
    return np.array([0.0, 0.0, 1.2 * np.sqrt(0.01 + max(z[0] * z[1], 0.0))])


A, w = (
    np.array([SLOPE[good] for good in GOODS]),
    np.array([WANTED[good] for good in GOODS]),
)
*before, unemployed = prices(1.2)
print("before the state hires: prices " + ", ".join(f"{one:.4f}" for one in before))
for hired in (unemployed, 1.5 * unemployed):
    one = icp.ICP(A, -w - [0.0, 0.0, hired], floor).solve(rtol=1e-10)
    print(
        f"{hired:.4f} hired: prices " + ", ".join(f"{price:.4f}" for price in one.z),
        end="; ",
    )
    print(
        f"wage above its floor by {abs(one.r[2]):.4f}, unemployed {abs(one.p[2]):.4f}"
    )
    assert np.allclose(one.z, before, atol=1e-6) == (hired == unemployed), (
        "prices stay where all that are hired were unemployed"
    )
    assert abs(one.p[2]) < 1e-6, "nobody is unemployed any more"
