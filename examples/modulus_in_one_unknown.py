r"""Why does an absolute value solve a problem with inequalities?

A ball hangs on a spring above a table, or lies on it. Either nothing presses, or there is no gap, and one does not know
beforehand which. Modulus methods make of that one equation with an absolute value, and iterate. In one unknown all of
it can be drawn.

Run: python examples/modulus_in_one_unknown.py      writes modulus_in_one_unknown.png and .svg into the current folder
"""

# %%
# ## The model
#
# One unknown, the height $z$. The force of the table is $p = az + q$, with $a$ the stiffness of the spring, the gap
# $r = z - \psi(z)$, and
#
# $$p \ge 0, \qquad r \ge 0, \qquad p\,r = 0 \qquad \Longleftrightarrow \qquad \min(p, r) = 0.$$

import math
from itertools import islice

import matplotlib.pyplot as plt
import numpy as np

import icpmodel as icp

a, q, start = 2.0, -2.0, 0.7  # and psi = 0: the ball hangs free, at z = 1
ball = icp.ICP([[a]], [q])
solution = ball.solve()
print(f"z = {solution.z[0]:g}, force p = {solution.p[0]:g}, gap r = {solution.r[0]:g}")

# %%
# ### From two inequalities to one modulus
#
# For any two numbers
#
# $$|x - y| = x + y - 2 \min(x, y),$$
#
# so that $\min(x, y) = 0$ says the same as $x + y = |x - y|$. Force and gap have different units. A number
# $\Omega > 0$, a force per length (`OMEGA`), brings them together; $\min(p, \Omega r) = 0$ has the same solutions. Put
# in $x = p$ and $y = \Omega r$:
#
# $$(a + \Omega)\, z = |(a - \Omega) z + q| - q \qquad (\psi = 0).$$
#
# The older papers say it with another unknown: $z = (|x| + x)/\gamma$ and $p = \Omega (|x| - x)/\gamma$ are never
# negative, and one of them is always 0, *whatever* $x$ *is*. What is left to ask for is $p = az + q$:
#
# $$(\Omega + a)\, x = (\Omega - a)\, |x| - \gamma q.$$
#
# $\gamma$ only measures $x$: with any other the same $z$ and $p$ come out, step by step.

OMEGA = 6.0  # 0.1 to 50
for gamma in (1.0, 2.0, 50.0):
    x = 0.0
    for _ in range(30):
        x = ((OMEGA - a) * abs(x) - gamma * q) / (OMEGA + a)
    z, p = (abs(x) + x) / gamma, OMEGA * (abs(x) - x) / gamma
    print(
        f"gamma = {gamma:4.1f}: x = {x:9.6f} after 30 steps, hence z = {z:.9f} and "
        f"p = {p:g}"
    )

# %%
# ## What is seen
#
# ### A walk on a V
#
# Divide the equation by $a + \Omega$, and the right side is a map whose fixed point is the solution. By the identity
# above it is a step against $\min(p, \Omega r)$:
#
# $$z^+ = \frac{|(a - \Omega) z + q| - q}{a + \Omega} = z - \frac{2}{a + \Omega} \min(p, \Omega r).$$
#
# Its graph is a V. Where $p$ is the smaller one, it has the slope $\sigma_p$, elsewhere $\sigma_r$:
#
# $$\sigma_p = 1 - \frac{2a}{a + \Omega} = \frac{\Omega - a}{\Omega + a}, \qquad
# \sigma_r = 1 - \frac{2\Omega}{a + \Omega} = - \sigma_p.$$
#
# For $a > 0$ and every $\Omega > 0$ both are between −1 and 1. So from *every* start a step leaves at most
# $|\Omega - a| / (\Omega + a)$ of the error. In one unknown this is the whole theory of convergence, and the package
# knows it before the first step:


def walk(problem, method, start, steps=30):
    """z⁰, z¹, …"""
    return np.array(
        [
            z[0]
            for z, _ in islice(method.iterates(problem, np.array([start])), steps + 1)
        ]
    )


print(
    f"{'Omega':>6} {'slope sigma_p':>14} {'error multiplied by':>20} "
    f"{'proved beforehand':>18}"
)
for Omega in (0.4, 2.0, OMEGA):
    method = icp.MNMMOD(theta1=Omega)
    error = walk(ball, method, start) - 1.0
    measured = abs(error[4] / error[3]) if error[3] else 0.0
    proved = icp.theory.predicted_rate(ball, method).factor
    print(
        f"{Omega:6.1f} {(Omega - a) / (Omega + a):14.4f} {measured:20.4f} "
        f"{proved:18.4f}"
    )
    assert measured <= proved * (1 + 1e-9), "no step is slower than is proved"

# %%
# ### In a picture
#
# Go from the start up to the V, across to the diagonal, up or down to the V again: a cobweb. With a small $\Omega$ the
# piece falls, and the walk turns round the solution. With a large one it rises, and the walk comes from one side. With
# $\Omega = a$ it is level, and one step hits. To the right the same walks as errors: how steep the lines are is the
# slope of the pieces.

SHOWN = {0.4: ("#D55E00", "s"), 2.0: ("#0072B2", "o"), OMEGA: ("#009E73", "D")}
figure, (small, large, fall) = plt.subplots(
    1, 3, figsize=(10, 3.7), layout="constrained"
)
grid = np.linspace(-0.6, 3.0, 400)
for axes, Omega, title in (
    (small, 0.4, "turns round"),
    (large, OMEGA, "from one side" if a < OMEGA else "turns round"),
):
    axes.plot(grid, grid, color="0.6", linewidth=1)
    axes.plot(
        grid,
        (abs((a - Omega) * grid + q) - q) / (a + Omega),
        color=SHOWN[Omega][0],
        linewidth=2,
    )
    z = np.repeat(walk(ball, icp.MNMMOD(theta1=Omega), start, 12), 2)
    axes.plot(z[:-1], np.append(0.0, z[2:]), color="black", linewidth=0.9)
    axes.plot(1, 1, "o", color="black", markersize=6)
    axes.annotate("$z^+ = z$", (2.5, 2.65), ha="right", va="bottom", color="0.4")
    axes.set(
        xlim=(-0.6, 3.0), ylim=(0, 3.2), xlabel="z", title=f"Ω = {Omega:g}: {title}"
    )
small.set_ylabel("$z^+$, after one step")
for Omega, (colour, marker) in SHOWN.items():
    error, slope = (
        np.abs(walk(ball, icp.MNMMOD(theta1=Omega), start) - 1.0),
        abs(Omega - a) / (Omega + a),
    )
    steps, seen = np.arange(error.size), error > 1e-15
    label = (
        f"Ω = {Omega:g}: times {slope:.3g} a step"
        if slope
        else f"Ω = {Omega:g}: one step hits"
    )
    fall.semilogy(
        steps[seen], error[seen], marker, color=colour, markersize=4, label=label
    )
    fall.semilogy(steps, error[0] * slope**steps, color=colour, linewidth=1)
fall.set(
    ylim=(1e-10, 300),
    xlabel="steps",
    ylabel="|z − 1|",
    title="Errors, and what is proved",
)
fall.legend(frameon=False, loc="upper right", fontsize=9)
for axes in (small, large, fall):
    axes.spines[["top", "right"]].set_visible(False)
for suffix in ("png", "svg"):
    figure.savefig(f"modulus_in_one_unknown.{suffix}", dpi=150)

# %%
# ## Vary one thing
#
# `OMEGA`. Any positive one converges, but a force per length that is far from the stiffness $a$ compares what cannot be
# compared, and takes hundreds of steps.

for Omega in sorted({0.01, 0.1, 1.0, 2.0, OMEGA, 1000.0}):
    steps = ball.solve("mnmmod", theta1=Omega, z0=[start]).iterations
    print(f"Omega = {Omega:7.2f}: {steps:5d} steps")

# %%
# Vary `start` as well: from 0.1 the walk with $\Omega = 0.4$ first meets the other piece of the V, and gains by it.

for start_at in (0.7, 0.1):
    error = np.abs(walk(ball, icp.MNMMOD(theta1=0.4), start_at) - 1.0)
    print(
        f"from {start_at}: error {error[-1]:.1e} after 30 steps, proved "
        f"{error[0] * (1.6 / 2.4) ** 30:.1e}"
    )
    assert error[-1] <= error[0] * (1.6 / 2.4) ** 30 * (1 + 1e-9), (
        "the error falls as is proved"
    )

# %%
# ## Exercises
#
# **1.** With $\Omega = 6$ how many steps is it from $z = 10^6$ until the error is below $10^{-6}$? Predict it.
#
# Answer: The slope is 1/2, on both pieces up to the sign. The error has to shrink by $10^{12}$, hence $2^k > 10^{12}$.

steps = math.ceil(math.log(1e12) / math.log(2))
counted = int(
    np.argmax(np.abs(walk(ball, icp.MNMMOD(theta1=6.0), 1e6, 100) - 1.0) < 1e-6)
)
print(f"predicted: {steps}, counted: {counted}")
assert steps == counted, "the steps are those of the formula"

# %%
# **2.** Let the table sink where the ball rises: $\psi(z) = 6 - 5z$, with $a = 0.1$ and $q = 1$. For which $\Omega$ do
# the walks converge? (The gap $r = z - \psi(z)$ now rises by $1 - g = 6$ with $z$, where $g = -5$ is the slope of
# $\psi$.)
#
# Answer: $\sigma_p$ is as before, and $\sigma_r = 1 - 2\Omega(1 - g)/(a + \Omega)$, which is above −1 if and only if
# $-g\,\Omega < a$. Beyond that the solution, where $r = 0$, repels.

weak, g = 0.1, -5.0
sinking = icp.ICP([[weak]], [1.0], icp.Affine([[g]], 6.0))
limit = -weak / g
for Omega in (0.9 * limit, 1.1 * limit):
    error = np.abs(walk(sinking, icp.MNMMOD(theta1=Omega), 2.0, 2000) - 1.0)
    side = "below" if Omega < limit else "above"
    print(
        f"Omega = {Omega:.3f}, {side} {limit:g}: error {error[-1]:.1e} after 2000 steps"
    )
    assert (error[-1] < 1e-12) == (Omega < limit), (
        "it converges below the limit and not above"
    )

# %%
# **3.** Which $\Omega$ is the best one there, and what does a step then leave?
#
# Answer: That for which $p$ and $\Omega r$ are equally steep, $\Omega = a/(1 - g)$. Then $|\sigma_p| = |\sigma_r|$, and
# any other $\Omega$ makes one of the two larger.


def factor(Omega, phi=0.0):
    """The larger one of |σ_p| and |σ_r|."""
    return max(
        abs(1 - 2 * weak / (weak + phi + Omega)),
        abs(1 - 2 * Omega * (1 - g) / (weak + phi + Omega)),
    )


best = weak / (1 - g)
tried = min(np.linspace(0.001, 0.02, 20_000), key=factor)
print(
    f"Omega = {best:.5f} leaves {factor(best):.4f}; the best of 20 000 that were "
    f"tried is {tried:.5f}"
)
assert abs(tried - best) < 1e-6, "the best one is that of the formula"

# %%
# **4.** A shift $\varphi$ adds to the denominator: $z^+ = z - 2 \min(p, \Omega r) / (a + \varphi + \Omega)$. Choose
# $\varphi$ and $\Omega$ so that this problem, too, is solved in one step, from anywhere.
#
# Answer: $\Omega$ as before makes both pieces equally steep, and $\varphi = a - \Omega$ makes the denominator twice
# that slope, $2a$: the V becomes a level line. With several unknowns that would need $A = \Omega(I - G)$.

phi = weak - best
for z in (-1e3, 50.0):
    print(
        f"from {z:g} one step leads to "
        f"{walk(sinking, icp.MNMMOD(theta1=best, phi=phi), z, 1)[-1]:.9f}"
    )
    assert abs(walk(sinking, icp.MNMMOD(theta1=best, phi=phi), z, 1)[-1] - 1) < 1e-9, (
        "one step leads to the solution"
    )

# %%
# **5.** What happens for $a = -1$, $q = 1$, $\psi = 0$?
#
# Answer: There are two solutions, 0 and 1, and both slopes are steeper than 1, or the V has no denominator
# ($\Omega = 1$): both solutions repel. A spring that pushes the harder the further it is bent has no stable rest.

backwards = icp.ICP([[-1.0]], [1.0])
print(
    f"residuals of 0 and 1: {backwards.residual([0.0]):g}, "
    f"{backwards.residual([1.0]):g}"
)
print(
    "from 3 with Omega = 2, after 20 steps: "
    f"{walk(backwards, icp.MNMMOD(theta1=2.0), 3.0, 20)[-1]:.3g}"
)
print(f"certified to be the only solution: {icp.certify(backwards, [1.0]).unique}")
