r"""Opera or match: what do two people do who would rather be together, and is there one answer?

A game of two players is a complementarity problem, here one with three answers: *solved* means that $z$ satisfies the
conditions, and not that it is the only $z$ that does.

Run: python examples/bimatrix_game.py         writes bimatrix_game.png and bimatrix_game.svg into the current folder
"""

# %%
# ## The model
#
# She chooses a row, he a column: the opera (0), which she prefers, or the match (1), which he prefers. Both would
# rather be together. What each of them gets is in
#
# $$\text{hers} = \begin{pmatrix} g & 1 \\ 0 & 2 \end{pmatrix}, \qquad
#   \text{his} = \begin{pmatrix} 2 & 1 \\ 0 & 3 \end{pmatrix}, \qquad g = 3.$$
#
# A strategy is a vector of probabilities, $x$ hers and $y$ his. They are in *equilibrium* if neither gains by changing
# alone: what has a positive probability is among the best answers to the other. Turn gains into costs, $C, D > 0$
# (the largest gain plus one, less the gain), and scale each strategy so that the other's least cost is 1:
#
# $$C y \ge e, \quad x \ge 0, \qquad\qquad D^T x \ge e, \quad y \ge 0, \qquad\qquad \text{each pair complementary}.$$
#
# For $z = (x, y)$ that is $p = Az + q$ with $C$ and $D^T$ off the diagonal of $A$, $q = -(e, e)$ and $\psi = 0$; the
# probabilities are $x/e^T x$ and $y/e^T y$. $g$, what she gets at the opera with him, is `HERS`.

import itertools

import matplotlib.pyplot as plt
import numpy as np

import icpmodel as icp

HERS = 3.0
his = np.array([[2.0, 1.0], [0.0, 3.0]])


def payoff(g: float) -> np.ndarray:
    return np.array([[g, 1.0], [0.0, 2.0]])


def game(g: float) -> icp.ICP:
    hers, zero = payoff(g), np.zeros((2, 2))
    C, D = 1 + hers.max() - hers, 1 + his.max() - his
    return icp.ICP(np.block([[zero, C], [D.T, zero]]), -np.ones(4))


def strategies(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return z[:2] / z[:2].sum(), z[2:] / z[2:].sum()


def regret(x: np.ndarray, y: np.ndarray, g: float = HERS) -> float:
    """What the one who would gain most by another answer would gain; 0 in equilibrium."""
    hers = payoff(g)
    return float(max((hers @ y).max() - x @ hers @ y, (x @ his).max() - x @ his @ y))


# %%
# ## What is seen
#
# `solve` finds an equilibrium and says that it is not certified to be the only one. It is the strangest of them: both
# leave it to chance, and mostly miss each other.

solution = game(HERS).solve()
x, y = strategies(solution.z)
print(f"solve(): {solution.status.value} by {solution.method!r}, she {x.round(4)}, he {y.round(4)}")
print(f"         certified to be the only solution: {solution.certificate.unique}")
print(f"         they meet with probability {x @ y:.4f}")

# %%
# Newton's method, from nine starts that say which choices each of them considers: the start decides which equilibrium
# is found.


def equilibria(g: float, talk: bool = False) -> list[tuple[float, float]]:
    """The probabilities of the opera, hers and his, of those that are found."""
    found = set()
    for she, he in itertools.product(([1, 0], [0, 1], [1, 1]), repeat=2):
        one = game(g).solve("newton", z0=np.array(she + he, dtype=float), raise_on_failure=False)
        said = f"  she {she}, he {he}: {one.status.value}"
        if one.solved:
            x, y = strategies(one.z)
            assert regret(x, y, g) <= 1e-9
            found.add((round(x[0], 9) + 0.0, round(y[0], 9) + 0.0))
            said += f", opera with probability {x[0]:.2f} and {y[0]:.2f}"
        if talk:
            print(said)
    return sorted(found)


found = equilibria(HERS, talk=True)
print(f"{len(found)} equilibria were found. In general nothing says that all were found.")

# %%
# Each line is one's best answer to the other; equilibria are where they cross. That shows that there are no more.

figure, axes = plt.subplots(figsize=(5.6, 4.6), layout="constrained")
his_turn = 1 / (1 + HERS)  # he goes to the opera with this probability: she does not care
axes.plot([0, 0, 1, 1], [0, his_turn, his_turn, 1], color="#0072B2", label="her best answer to him")
axes.plot([0, 3 / 4, 3 / 4, 1], [0, 0, 1, 1], "--", color="#D55E00", label="his best answer to her")
style = {"color": "black", "markersize": 8, "clip_on": False}
axes.plot(*zip(*found, strict=True), "o", label="equilibria found", **style)
axes.set_xlabel("probability that she goes to the opera")
axes.set_ylabel("probability that he goes to the opera")
axes.set_title("Equilibria are where the best answers cross")
axes.legend(frameon=False, loc="upper left", bbox_to_anchor=(0.02, 0.9))
for suffix in ("png", "svg"):
    figure.savefig(f"bimatrix_game.{suffix}", dpi=150)

# %%
# ## Vary one thing
#
# `HERS`, her gain at the opera with him. In the equilibrium of chance *her* strategy does not depend on it: his does.
# She mixes so that he does not care, and he so that she does not care.

print(f"{'her gain':>9}   equilibria: probability of the opera, hers and his")
for g in sorted({1.5, 3.0, 6.0, 12.0, HERS}):
    print(f"{g:9.1f}   " + ", ".join(f"({x:.4f}, {y:.4f})" for x, y in equilibria(g)))

# %%
# ## Exercises
#
# **1.** Derive the equilibrium of chance. With which probability do they miss each other?
#
# Answer: She does not care if $g y_0 + (1 - y_0) = 2(1 - y_0)$, hence $y_0 = 1/(1 + g)$. He does not care if
# $2x_0 = x_0 + 3(1 - x_0)$, hence $x_0 = \frac{3}{4}$. For $g = 3$ they miss each other with probability
# $\frac{3}{4}\cdot\frac{3}{4} + \frac{1}{4}\cdot\frac{1}{4} = 0.625$.

for g in (1.5, 3.0, 6.0):
    assert any(np.allclose(one, (3 / 4, 1 / (1 + g))) for one in equilibria(g))
x0, y0 = 3 / 4, 1 / (1 + 3)
print(f"they miss each other with probability {x0 * (1 - y0) + (1 - x0) * y0:.4f}")

# %%
# **2.** Which property of $A$ would have promised one solution, and how is it seen that $A$ lacks it?
#
# Answer: A linear complementarity problem has exactly one solution for every $q$ if and only if $A$ is a P-matrix, all
# of whose principal minors are positive. Those of size one are the diagonal, and that is 0.

classes = icp.theory.classify(game(3.0).A)
print(f"P-matrix: {classes.p}")
assert classes.p.holds is False

# %%
# **3.** Lemke's pivoting, which has no start to choose, ends here without a solution. Does it claim anything false?
#
# Answer: No. It ends on a ray. For some classes of matrices, the copositive-plus ones for example, that proves that
# there is no solution; $A$ is copositive and not copositive-plus. So it says that it stagnated, and not that the
# problem is infeasible. The algorithm of Lemke and Howson, which is made for games, does end with an equilibrium.

lemke = game(3.0).solve("lemke", raise_on_failure=False)
print(f"Lemke's pivoting: {lemke.status.value}; proved infeasible: {lemke.infeasible is not None}")
assert not lemke.solved
assert lemke.infeasible is None
