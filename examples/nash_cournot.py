r"""How much do five firms produce, if none can gain by changing its output alone?

Each firm solves an optimisation problem of its own; all their conditions together are one complementarity problem.

Run: python examples/nash_cournot.py          writes nash_cournot.png and nash_cournot.svg into the current folder
"""

# %%
# ## The model
#
# All sell the same good. The price falls with what is sold, $\pi(x) = d - b\sum_j x_j$. Firm $i$ chooses its output
# $x_i$, at most its capacity $k_i$, so that its profit $x_i(\pi(x) - c_i)$ is largest, and takes the output of the
# others as given. With $y_i$, what one unit more of capacity would be worth to it, its conditions are
#
# $$c_i - \pi(x) + b x_i + y_i \ge 0, \quad x_i \ge 0, \qquad\qquad k_i - x_i \ge 0, \quad y_i \ge 0,$$
#
# where in each pair one is 0. For $z = (x, y)$ these are $p = Az + q \ge 0$, $z \ge 0$, $p^T z = 0$ with
#
# $$A = \begin{pmatrix} b(ee^T + I) & I \\ -I & 0 \end{pmatrix}, \qquad q = \begin{pmatrix} c - d\,e \\ k \end{pmatrix},
#   \qquad e = (1, \ldots, 1).$$
#
# $d$, the highest price that anyone would pay, is `DEMAND`.

import matplotlib.pyplot as plt
import numpy as np

import icpmodel as icp

DEMAND = 100.0  # 30 to 200
cost = np.array([10.0, 15.0, 20.0, 30.0, 45.0])
capacity = np.array([15.0, 20.0, 30.0, 30.0, 30.0])
b, n = 1.0, cost.size


def market(demand: float, capacity: np.ndarray = capacity) -> icp.ICP:
    one, eye = np.ones((n, n)), np.eye(n)
    A = np.block([[b * (one + eye), eye], [-eye, 0 * eye]])
    return icp.ICP(A, np.concatenate([cost - demand, capacity]))


def best_answer(x: np.ndarray, demand: float) -> np.ndarray:
    """The output that is best for each firm while the others keep theirs."""
    others = x.sum() - x
    return np.clip((demand - b * others - cost) / (2 * b), 0, capacity)


# %%
# ## What is seen
#
# The cheap firms produce all they can, and more capacity would be worth something to them; the dearest does not enter.
# No firm has a better answer to the others than what it does: that is an equilibrium, found without any rounds of
# offers.

solution = market(DEMAND).solve(rtol=1e-12)
output, worth = solution.z[:n], solution.z[n:]
best = best_answer(output, DEMAND)
assert np.abs(best - output).max() <= 1e-9, "nobody can do better alone"
print(
    f"{'firm':>4} {'cost':>6} {'capacity':>9} {'output':>8} {'best answer':>12} "
    f"{'capacity is worth':>18}"
)
for i in range(n):
    row = f"{i + 1:4d} {cost[i]:6.1f} {capacity[i]:9.1f} {output[i]:8.3f}"
    print(f"{row} {best[i]:12.3f} {worth[i]:18.3f}")
print(f"price {DEMAND - b * output.sum():.3f}, sold {output.sum():.3f}")

# %%
# For all $d$ at once: every solve starts from the answer before.

levels, outputs, last = np.linspace(0, 200, 201), [], None
for level in levels:
    last = market(level).solve(rtol=1e-12, z0=last)
    outputs.append(last.z[:n])
figure, axes = plt.subplots(figsize=(6.4, 4), layout="constrained")
looks = (
    ("#0072B2", "-"),
    ("#D55E00", "--"),
    ("#009E73", "-."),
    ("#CC79A7", ":"),
    ("#E69F00", (0, (5, 1, 1, 1, 1, 1))),
)
for i, (colour, line) in enumerate(looks):
    label = f"firm {i + 1}, cost {cost[i]:.0f}"
    axes.plot(
        levels, np.array(outputs)[:, i], linestyle=line, color=colour, label=label
    )
axes.set_xlabel("highest price that anyone would pay")
axes.set_ylabel("output, units")
axes.set_title("Firms enter by cost and end at capacity")
axes.legend(frameon=False)
for suffix in ("png", "svg"):
    figure.savefig(f"nash_cournot.{suffix}", dpi=150)

# %%
# ## Vary one thing
#
# `DEMAND`. Firms enter one after the other as the price rises above their cost; when all are at capacity, the price
# alone rises.

print(f"{'highest price':>13} {'price':>8} {'sold':>8}   outputs")
for demand in sorted({25.0, 50.0, 100.0, 150.0, 300.0, DEMAND}):
    x = market(demand).solve(rtol=1e-12).z[:n]
    print(
        f"{demand:13.1f} {demand - b * x.sum():8.3f} {x.sum():8.3f}   "
        f"{x.round(3) + 0.0}"
    )

# %%
# ## Exercises
#
# **1.** Let the firms play: all answer the outputs of the others at once, again and again. Does that lead to the
# equilibrium? And if they answer one after the other?
#
# Answer: All at once they swing: everybody produces much, then everybody little. With more than three firms that are
# not at a limit, linear demand and equal slopes, the swings grow until limits stop them. One after the other they get
# there: each answer lowers the energy $\tfrac{1}{2} x^T b(ee^T + I)x + (c - de)^T x$ of the same problem, whose least
# value within the capacities is the equilibrium. That is projected Gauss–Seidel, played by firms. (Capacities are set
# aside here, so that five firms are free, and the demand is 300 for all of them to sell.)


def rounds(at_once: bool, steps: int, demand: float = 300.0) -> np.ndarray:
    x = np.zeros(n)
    for _ in range(steps):
        for who in [np.arange(n)] if at_once else np.arange(n)[:, None]:
            x[who] = np.maximum((demand - b * (x.sum() - x) - cost) / (2 * b), 0)[who]
    return x


equilibrium = market(300.0, np.full(n, 1e6)).solve(rtol=1e-12).z[:n]
for words, at_once in (("all at once", True), ("one after the other", False)):
    away = [
        np.abs(rounds(at_once, steps) - equilibrium).max() for steps in (10, 20, 40)
    ]
    print(
        f"{words:>20}: away by {', '.join(f'{one:.2g}' for one in away)} after 10, "
        "20, 40 rounds"
    )
assert (
    np.abs(rounds(False, 100) - equilibrium).max()
    < 1e-9
    < 1
    < np.abs(rounds(True, 40) - equilibrium).max()
), "in turn they arrive, and all at once they do not"

# %%
# **2.** Firm 1 is offered one thousandth of a unit more of capacity. Is its profit larger by what $y_1$ says?
#
# Answer: By more. $y_1$ is what it gains while the others keep their outputs. In the new equilibrium firms 3 and 4,
# which are at no limit, give way to it, the price falls less, and firm 1 gains more: a large capacity is a threat.

more = capacity + np.array([1e-3, 0, 0, 0, 0])
x = market(100.0).solve(rtol=1e-12).z
bigger = market(100.0, more).solve(rtol=1e-12).z
profit = [one[0] * (100.0 - b * one[:n].sum() - cost[0]) for one in (x, bigger)]
change = ", ".join(f"{one:+.3f}" for one in (bigger - x)[1:n] * 1e3)
print(
    f"y_1 = {x[n]:.3f}; gained per unit {(profit[1] - profit[0]) / 1e-3:.3f}; the "
    f"others' outputs change by {change}"
)
assert (profit[1] - profit[0]) / 1e-3 > x[n] + 1, (
    "a large capacity is a threat: it gains more than y_1"
)

# %%
# **3.** Replace the five by $N$ equal firms of cost 20 without limits. What happens to the price as $N$ grows?
#
# Answer: It is $(d + Nc)/(N + 1)$: half way between cost and $d$ for one firm, and cost in the end: competition.

for count in (1, 2, 5, 20, 100):
    A = b * (np.ones((count, count)) + np.eye(count))
    x = icp.ICP(A, np.full(count, 20.0 - 100.0)).solve(rtol=1e-12).z
    price = 100.0 - b * x.sum()
    print(f"{count:4d} firms: price {price:8.4f}")
    assert np.isclose(price, (100 + 20 * count) / (count + 1)), (
        "the price is that of the formula"
    )
