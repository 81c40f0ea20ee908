"""Battle of the sexes: a game of two players as a complementarity problem that has three answers.

It teaches: "solved" means that z satisfies the conditions, not that it is the only z that does. The start decides which
equilibrium is found; Lemke's pivoting, which has none, ends without a solution, and says so.

With payoffs made into costs C, D > 0, an equilibrium is z = (x, y) / scale of

    C y >= 1,  x >= 0,      D'x >= 1,  y >= 0,      each pair complementary.

Run: python examples/bimatrix_game.py         writes bimatrix_game.png and bimatrix_game.svg into the current folder
"""

import itertools

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import icpmodel as icp

# What each gets if she (row) and he (column) go to the opera (0), which she prefers, or to the match (1), which he
# prefers; but both would rather be together.
hers, his = np.array([[3.0, 1.0], [0.0, 2.0]]), np.array([[2.0, 1.0], [0.0, 3.0]])
C, D = 1 + hers.max() - hers, 1 + his.max() - his
zero = np.zeros((2, 2))
problem = icp.ICP(np.block([[zero, C], [D.T, zero]]), -np.ones(4))


def strategies(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """z is a multiple of the probabilities in each half."""
    return z[:2] / z[:2].sum(), z[2:] / z[2:].sum()


def regret(x: np.ndarray, y: np.ndarray) -> float:
    """What the one who would gain most by another answer to the other's strategy would gain; 0 in equilibrium."""
    return float(max((hers @ y).max() - x @ hers @ y, (x @ his).max() - x @ his @ y))


print("Lemke's pivoting:", problem.solve("lemke", raise_on_failure=False).status.value)
solution = problem.solve()
x, y = strategies(solution.z)
print(f"solve():          {solution.status.value} by {solution.method!r}, she {x.round(4)}, he {y.round(4)}")
print(f"                  certified to be the only solution: {solution.certificate.unique}\n")

print("Newton's method from starts that say which choices each of them considers:")
found = set()
choices = ([1, 0], [0, 1], [1, 1])
for hers_first, his_first in itertools.product(choices, repeat=2):
    solution = problem.solve("newton", z0=np.array(hers_first + his_first, dtype=float), raise_on_failure=False)
    said = f"  she {hers_first}, he {his_first}: {solution.status.value}"
    if solution.solved:
        x, y = strategies(solution.z)
        assert regret(x, y) <= 1e-9
        found.add((round(x[0], 9), round(y[0], 9)))
        said += f", opera with probability {x[0]:.2f} and {y[0]:.2f}, gain by changing alone {regret(x, y):.9f}"
    print(said)
print(f"{len(found)} equilibria were found; this game has 3. In general nothing says that all were found.")

figure, axes = plt.subplots(figsize=(5.6, 4.6), layout="constrained")
even = 1 / 4  # he goes to the opera with this probability: she does not care (and 3/4 the other way round)
axes.plot([0, 0, 1, 1], [0, even, even, 1], color="#0072B2", label="her best answer to him")
axes.plot([0, 1 - even, 1 - even, 1], [0, 0, 1, 1], "--", color="#D55E00", label="his best answer to her")
axes.plot(*zip(*sorted(found), strict=True), "o", color="black", markersize=8, label="equilibria found", clip_on=False)
axes.set_xlabel("probability that she goes to the opera")
axes.set_ylabel("probability that he goes to the opera")
axes.set_title("Equilibria are where the best answers cross")
axes.legend(frameon=False, loc="upper left", bbox_to_anchor=(0.02, 0.9))
for suffix in ("png", "svg"):
    figure.savefig(f"bimatrix_game.{suffix}", dpi=150)
