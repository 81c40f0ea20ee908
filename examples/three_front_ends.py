r"""How does one model look in NumPy, in CVXPY and in Pyomo, and is it the same one?

A string over a bump, written three times. Whatever the language, the same problem is solved, judged and certified.

Run: python examples/three_front_ends.py      writes three_front_ends.png and .svg into the current folder
"""

# %%
# ## The model
#
# A string between two nails, one length apart, is pulled down by its weight $w$ per length (its tension is 1) and lies
# on a bump $\psi$. It is nowhere below the bump, the bump pushes it up and never pulls, and only where they touch:
#
# $$-u'' + w \ge 0, \qquad u \ge \psi, \qquad (-u'' + w)(u - \psi) = 0, \qquad
#   \psi(s) = 0.15 - 2\,(s - 0.6)^2, \qquad u(0) = u(1) = 0.$$
#
# With $n$ points, $h = 1/(n + 1)$ apart, and rows multiplied by $h^2$,
#
# $$p_i = 2 z_i - z_{i-1} - z_{i+1} + w h^2 \ge 0, \qquad r = z - \psi \ge 0, \qquad p^T r = 0.$$
#
# $w$ is `WEIGHT`.

import cvxpy as cp
import matplotlib.pyplot as plt
import numpy as np
import pyomo.environ as pyo
import scipy.sparse as sp
from pyomo.mpec import Complementarity, complements

import icpmodel as icp

WEIGHT, N = 1.0, 100  # WEIGHT from -2 to 20; N points
h = 1 / (N + 1)
s = h * np.arange(1, N + 1)
bump = 0.15 - 2 * (s - 0.6) ** 2

# %%
# In NumPy and SciPy: the matrix, the vector, the obstacle.


def in_numpy(weight: float, n: int = N) -> icp.Solution:
    h, s = 1 / (n + 1), np.arange(1, n + 1) / (n + 1)
    A = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n, n))
    return icp.ICP(A, np.full(n, weight * h**2), 0.15 - 2 * (s - 0.6) ** 2).solve(
        rtol=1e-11
    )


# %%
# In CVXPY: expressions of a variable.


def in_cvxpy(weight: float) -> np.ndarray:
    z = cp.Variable(N)
    string = cp.hstack([0, z, 0])
    pressed = 2 * z - string[:-2] - string[2:] + weight * h**2
    icp.Problem(icp.complements(pressed, z - bump)).solve(rtol=1e-11)
    return z.value


# %%
# In Pyomo: one condition for every point.


def in_pyomo(weight: float) -> np.ndarray:
    model = pyo.ConcreteModel()
    model.z = pyo.Var(range(N + 2))
    for end in (0, N + 1):
        model.z[end].fix(0.0)

    def contact(m, i):
        pressed = 2 * m.z[i] - m.z[i - 1] - m.z[i + 1] + weight * h**2
        return complements(pressed >= 0, m.z[i] >= float(bump[i - 1]))

    model.contact = Complementarity(range(1, N + 1), rule=contact)
    pyo.assert_optimal_termination(icp.pyomo_solver(rtol=1e-11).solve(model))
    return np.array([model.z[i].value for i in range(1, N + 1)])


# %%
# ## What is seen
#
# The same heights; and the card says of the problem, whoever wrote it, how far $z$ can be from the solution.

solution = in_numpy(WEIGHT)
print(solution)
answers = {"CVXPY": in_cvxpy(WEIGHT), "Pyomo": in_pyomo(WEIGHT)}
for name, other in answers.items():
    apart = np.abs(other - solution.z).max()
    assert apart <= 1e-9, "all front ends have the same z"
    print(
        f"{name} and NumPy: the same z to 1e-9; the largest difference is {apart:.1e}"
    )
touches = solution.p > solution.r
place = (
    f", from s = {s[touches][0]:.3f} to s = {s[touches][-1]:.3f}"
    if touches.any()
    else ""
)
print(f"{touches.sum()} of {N} points touch{place}")

# %%
# Between its last contact and the nail the string is a parabola. Where it lies on the bump it is pushed up by
# $w - \psi'' = w + 4$ per length.

figure, (shape, force) = plt.subplots(1, 2, figsize=(9, 3.9), layout="constrained")
shape.plot(s, bump, color="#D55E00", label="bump ψ")
shape.plot(s, solution.z, color="#0072B2", label="string, NumPy")
shape.plot(
    s[2::8],
    answers["CVXPY"][2::8],
    "s",
    color="#E69F00",
    markersize=5,
    label="string, CVXPY",
)
shape.plot(
    s[6::8],
    answers["Pyomo"][6::8],
    "x",
    color="black",
    markersize=5,
    label="string, Pyomo",
)
shape.set_ylim(-0.08, 0.22)
shape.set_xlabel("s, lengths between the nails")
shape.set_ylabel("height z")
shape.set_title("One string, written three times")
shape.legend(frameon=False, fontsize=9, ncols=2)
force.plot(s, solution.p / h**2, color="#0072B2")
force.set_xlabel("s, lengths between the nails")
force.set_ylabel("force of the bump per length")
force.set_title(
    "It presses only where they touch" if touches.any() else "They do not touch"
)
for suffix in ("png", "svg"):
    figure.savefig(f"three_front_ends.{suffix}", dpi=150)

# %%
# ## Vary one thing
#
# `WEIGHT`. A heavier string lies on more of the bump. A negative weight pulls it up, and it touches less and less.

print(f"{'weight':>7} {'touches from':>13} {'to':>6} {'whole force of the bump':>24}")
for weight in sorted({-1.2, -0.5, 0.0, 1.0, 5.0, 20.0, WEIGHT}):
    one = in_numpy(weight, 999)
    there = np.arange(1, 1000)[one.p > one.r] / 1000
    ends = f"{there[0]:13.3f} {there[-1]:6.3f}" if there.size else f"{'nowhere':>20}"
    print(f"{weight:7.1f} {ends} {one.p.sum() * 1000:24.4f}")

# %%
# ## Exercises
#
# **1.** Where does the string first touch the bump? (Left of it $u = as + w s^2/2$; at the first contact $u$ and
# $u'$ are those of the bump.)
#
# Answer: Eliminating $a$ gives $s_1^2\,(2 + w/2) = 2 \cdot 0.6^2 - 0.15 = 0.57$. From the other nail, at the
# distance 0.4 from the top of the bump, $(1 - s_2)^2\,(2 + w/2) = 2 \cdot 0.4^2 - 0.15 = 0.17$.

for weight in (0.0, 1.0, 5.0):
    one = in_numpy(weight, 999)
    there = np.arange(1, 1000)[one.p > one.r] / 1000
    s1, s2 = np.sqrt(0.57 / (2 + weight / 2)), 1 - np.sqrt(0.17 / (2 + weight / 2))
    print(
        f"weight {weight}: from {s1:.4f} to {s2:.4f}; on the grid from "
        f"{there[0]:.3f} to {there[-1]:.3f}"
    )
    assert abs(there[0] - s1) <= 2e-3, "the first contact is that of the formula"
    assert abs(there[-1] - s2) <= 2e-3, "and so is the last one"

# %%
# **2.** Pulled up by how much does the string leave the bump?
#
# Answer: When $s_1 = s_2$: $2 + w/2 = (\sqrt{0.57} + \sqrt{0.17})^2$.

lifts = 2 * ((np.sqrt(0.57) + np.sqrt(0.17)) ** 2 - 2)
just_above, just_below = (in_numpy(lifts + change, 999) for change in (0.01, -0.01))
print(
    f"w = {lifts:.4f}; contacts at w + 0.01: {(just_above.p > just_above.r).sum()}",
    end=", ",
)
print(f"at w - 0.01: {(just_below.p > just_below.r).sum()}")
assert (just_above.p > just_above.r).any(), "it touches just above this weight"
assert not (just_below.p > just_below.r).any(), "and just below it does not"

# %%
# **3.** The three front ends hand the same numbers to the same solver, so that they agree if they are *written* alike.
# What would be an independent check of the answer?
#
# Answer: A solver that is not of this package, asked for the same problem, and a judge who recomputes $p$ and $r$ from
# what it says.

report = solution.problem.crosscheck(solution, ["osqp", "clarabel"])
print(report)
assert report.agrees, "other solvers agree"
