r"""Which standard will two firms agree on: are all answers known, and which start leads to which?

A game of two players is a complementarity problem, here one with four answers: *solved* means that $z$ satisfies the
conditions, and not that it is the only $z$ that does.

Run: python examples/bimatrix_game.py         writes bimatrix_game.png and bimatrix_game.svg into the current folder
"""

# %%
# ## The model
#
# Two firms choose one of three standards. Only if they choose the same one, each of them earns something: 3 with the
# first, 2 with the second, and $g = 0$ with the third, which is worthless.
#
# A strategy is a vector of probabilities, $x$ of the one firm and $y$ of the other. They are in *equilibrium* if
# neither gains by changing alone: what has a positive probability is among the best answers to the other. Turn gains
# into costs (the largest gain plus one, less the gain), and scale each strategy so that the other's least cost is 1:
#
# $$C y \ge e, \quad x \ge 0, \qquad\qquad C^T x \ge e, \quad y \ge 0, \qquad\qquad \text{each pair complementary}.$$
#
# For $z = (x, y)$ that is $p = Az + q$ with $C$ and $C^T$ off the diagonal of $A$, $q = -(e, e)$ and $\psi = 0$. The
# probabilities are $x/e^T x$ and $y/e^T y$. $g$ is `THIRD`.

import matplotlib.pyplot as plt
import numpy as np

import icpmodel as icp

THIRD = 0.0  # 0 to 2


def game(g: float) -> icp.ICP:
    gains = np.diag([3.0, 2.0, g])
    C, zero = 1 + gains.max() - gains, np.zeros((3, 3))
    return icp.ICP(np.block([[zero, C], [C.T, zero]]), -np.ones(6))


def strategies(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return z[:3] / z[:3].sum(), z[3:] / z[3:].sum()


# %%
# ## What is seen
#
# `solve` finds an equilibrium and does not certify that it is the only one. `all_solutions` goes through all
# $2^6 = 64$ choices of equations, in fractions: these four are all.

solution = game(THIRD).solve()
print(
    f"solve(): {solution.status.value}; certified to be the only solution: "
    f"{solution.certificate.unique}"
)
found = icp.all_solutions(game(THIRD))
equilibria = np.array([strategies(z)[0] for z in found.points])
print(
    f"{len(found.points)} equilibria, {len(found.faces)} faces of others, all "
    f"found: {found.complete}"
)
for z in found.points:
    x, y = strategies(z)
    print(
        f"  {x.round(4) + 0.0} and {y.round(4) + 0.0}, each earns "
        f"{x @ np.diag([3.0, 2.0, THIRD]) @ y:.2f}"
    )

# %%
# Newton's method starts where both firms have the same beliefs, $x = y$. Each of them is a point of a triangle, whose
# corners are the standards. Its colour says which equilibrium that start leads to.

SIDE = 24
STARTS = (
    np.array(
        [(i, j, SIDE - i - j) for i in range(SIDE + 1) for j in range(SIDE + 1 - i)]
    )
    / SIDE
)


def led_to(g: float, points: np.ndarray) -> np.ndarray:
    """The index in `points` of the answer from each start, −1 where there is none."""
    reached = []
    for start in STARTS:
        one = game(g).solve("newton", z0=np.tile(start, 2), raise_on_failure=False)
        away = np.abs(points - one.z).max(axis=1)
        reached.append(int(away.argmin()) if one.solved and away.min() <= 1e-6 else -1)
    return np.array(reached)


reached = led_to(THIRD, found.points)
for k, x in enumerate(equilibria):
    print(
        f"  {(reached == k).sum():4d} of {len(STARTS)} starts lead to "
        f"{x.round(4) + 0.0}"
    )

corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, np.sqrt(3.0) / 2]])
figure, axes = plt.subplots(figsize=(6.2, 5.2), layout="constrained")
axes.fill(*corners.T, facecolor="none", edgecolor="0.6")
colours = ["#009E73", "#D55E00", "#CC79A7", "#0072B2", "#E69F00", "#56B4E9", "0.6"]
standards = np.array(["first", "second", "third"])
for k, (x, colour) in enumerate(zip(equilibria, colours, strict=False)):
    axes.plot(*(STARTS[reached == k] @ corners).T, "o", color=colour, markersize=5)
    label = f"{', '.join(standards[x > 1e-9])}: {(reached == k).sum()} starts"
    axes.plot(
        *(x @ corners),
        "*",
        color=colour,
        markeredgecolor="black",
        markersize=18,
        label=label,
    )
axes.plot(*(STARTS[reached == -1] @ corners).T, "x", color="black", markersize=5)
for corner, word, place in zip(
    corners, ("first", "second", "third"), ((0, -22), (0, -22), (0, 14)), strict=True
):
    axes.annotate(word, corner, place, textcoords="offset points", ha="center")
axes.set_title("Where Newton's method ends, by where it starts")
axes.legend(frameon=False, loc="upper left", title="equilibrium: what is chosen")
axes.set_xlim(-0.35, 1.1)
axes.set_ylim(-0.1, 1.0)
axes.set_aspect("equal")
axes.axis("off")
for suffix in ("png", "svg"):
    figure.savefig(f"bimatrix_game.{suffix}", dpi=150)

# %%
# The method knows nothing of what is good: many starts lead to the worthless standard. It is an equilibrium all the
# same, as a firm that leaves it alone earns nothing either.

# %%
# ## Vary one thing
#
# `THIRD`, what the third standard is worth. Where it is worth something there are seven equilibria: every set of
# standards has one. Where it costs something there are three. At 0, between the two, there are four: that is
# degenerate, as $p_i = z_i = 0$ for the first two standards where both firms take the third.

for g in sorted({-1.0, 0.0, 1.0, THIRD}):
    print(
        f"third standard worth {g:4.1f}: {len(icp.all_solutions(game(g)))} equilibria"
    )

# %%
# ## Exercises
#
# **1.** Derive the equilibrium in which chance decides between the first two standards.
#
# Answer: A firm mixes both only if they earn the same: $3 y_0 = 2 y_1$ with $y_0 + y_1 = 1$, hence $y = (0.4, 0.6, 0)$.
# The firms agree with probability 0.52, and each earns 1.20, less than where both take the second standard.

mixed = np.array([0.4, 0.6, 0.0])
assert any(np.allclose(x, mixed) for x in equilibria), (
    "the mixed equilibrium by hand is among them"
)
print(f"they agree with probability {mixed @ mixed:.2f}")

# %%
# **2.** Which property of $A$ would have promised one solution, and how is it seen that $A$ lacks it?
#
# Answer: A linear complementarity problem has exactly one solution for every $q$ if and only if $A$ is a P-matrix, all
# of whose principal minors are positive. Those of size one are the diagonal, and that is 0.

classes = icp.theory.classify(game(THIRD).A)
print(f"P-matrix: {classes.p}")
assert classes.p.holds is False, "A is no P-matrix"

# %%
# **3.** Lemke's pivoting, which has no start to choose, ends here without a solution. Does it claim anything false?
#
# Answer: No. It ends on a ray. For some classes of matrices, the copositive-plus ones for example, that proves that
# there is no solution; $A$ is copositive and not copositive-plus. So it says that it stagnated, and not that the
# problem is infeasible. With other covering vectors, as the method `restarts` draws them, it does find a solution.

lemke = game(THIRD).solve("lemke", raise_on_failure=False)
print(
    f"Lemke's pivoting: {lemke.status.value}; proved infeasible: "
    f"{lemke.infeasible is not None}"
)
assert not lemke.solved, "Lemke's pivoting fails here"
assert lemke.infeasible is None, "and proves nothing by that"
assert game(THIRD).solve("restarts").solved, "other starts find an equilibrium"
