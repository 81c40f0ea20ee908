r"""Why do longer steps help, and when do they kill?

A sweep over a string on a bump puts each point where its neighbours want it. *Relaxation* goes further than they want.
One number takes eight times fewer sweeps, and there are three ways to fail by it.

Run: python examples/why_relaxation_helps.py      writes why_relaxation_helps.png and .svg into the current folder
"""

# %%
# ## The model
#
# A string is stretched over a bump $\psi$: nothing but the bump bends it, and only upwards. On a grid of `N` points,
# with $A = \mathrm{tridiag}(-1, 2, -1)$ and $q = 0$,
#
# $$p = Az \ge 0, \qquad r = z - \psi \ge 0, \qquad p^\top r = 0.$$
#
# Projected SOR (`PSOR`) goes along the string with $\omega$ times the step to where a point would be in balance, but
# not below the bump:
#
# $$z_i^+ = \max\bigl(\psi_i,\ z_i - \omega (Az + q)_i / a_{ii}\bigr) \quad \text{with the newest } z.$$
#
# The modulus methods of the paper have such a number as well, $\theta_1$ in $M_1 = (D - \theta_2 L)/\theta_1$.

import math
from itertools import islice

import matplotlib.pyplot as plt
import numpy as np
import scipy.sparse as sp

import icpmodel as icp

N = 39  # 9 to 99


def stretched(n):
    """A string with n points between its ends, over a bump."""
    x = np.linspace(0, 1, n + 2)[1:-1]
    A = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n, n))
    return icp.ICP(A, np.zeros(n), 0.5 - 8 * (x - 0.5) ** 2)


string = stretched(N)
exact = string.solve("tridiagonal")
free = exact.p < exact.r
side = int(np.argmin(free))  # the number of points that hang free on each side
print(
    f"{N} points: {N - free.sum()} lie on the bump, {side} hang free on each side of it"
)

# %%
# ### What theory says
#
# Once it is known which points lie on the bump, only the two free pieces move, and there a sweep is linear. Of the
# slowest error in a piece of $m$ points a step of Jacobi's method leaves $\mu = \cos(\pi/(m + 1))$. What that makes of
# a sweep with $\omega$ Young found in 1950:
#
# $$\sigma(\omega) = \bigl(\omega\mu/2 + \sqrt{(\omega\mu/2)^2 - \omega + 1}\,\bigr)^2 \quad
# \text{up to } \omega^* = \frac{2}{1 + \sqrt{1 - \mu^2}}, \qquad \sigma(\omega) = \omega - 1 \quad
# \text{beyond.}$$
#
# *Why it helps*: long waves of the error shrink slowly and always the same way. A larger step in that direction
# makes them shrink faster, until at $\omega^*$ all waves shrink alike and begin to turn round. *Why it kills*: the
# eigenvalues of a sweep over $m$ points have the product $(1 - \omega)^m$. Beyond $\omega = 2$ at least one of them is
# larger than 1, whatever the matrix is, and `PSOR` refuses such an $\omega$.

mu = math.cos(math.pi / (side + 1))
best = 2 / (1 + math.sqrt(1 - mu**2))


def young(omega, mu=mu):
    """What a sweep leaves of the error, once the contact is found."""
    root = omega**2 * mu**2 / 4 - omega + 1
    return (omega * mu / 2 + math.sqrt(root)) ** 2 if root > 0 else omega - 1


def errors(method, start=None, steps=2500):
    """The largest error of each iterate."""
    z = np.zeros(N) if start is None else start
    return np.array(
        [
            np.abs(z - exact.z).max()
            for z, _ in islice(method.iterates(string, z), steps)
        ]
    )


def measured(error):
    """The mean factor of a step from 1/100 of the first error on, or infinity."""
    late = np.flatnonzero((error < 1e-2 * error[0]) & (error > 1e-12))
    return (
        (error[late[-1]] / error[late[0]]) ** (1 / (late[-1] - late[0]))
        if error[-1] < 1e-3
        else math.inf
    )


sweeps = {}
print(f"{'omega':>6} {'theory':>8} {'measured':>9} {'sweeps to 1e-6':>15}")
for omega in (0.5, 1.0, 1.5, best, 1.9):
    error = errors(icp.PSOR(omega=omega))
    sweeps[omega] = int(np.argmax(error < 1e-6))
    print(
        f"{omega:6.3f} {young(omega):8.4f} {measured(error):9.4f} {sweeps[omega]:15d}"
    )
print(
    f"the best one, {best:.4f}, is {sweeps[1.0] / sweeps[best]:.1f} times as fast "
    "as no relaxation"
)

# %%
# ## What is seen
#
# ### Another way to fail: on the way there
#
# The paper's sweep with $\theta_2 = \theta_1$ (`MNMSOR`) looks at the *old* values inside its modulus. There is no
# formula for it, but near the solution it is linear, too: $e^+ = (I - 2X^{-1}S)\,e$ with $X = M_1 + D$. A row of
# $S$ is that of $A$ if it hangs free and that of $D$ if it lies on the bump. The largest eigenvalue says how fast the
# method is *there*, and it would bear $\theta_1 = 6$. From $z = 0$ it does not come there: it overshoots, rows change
# between bump and air, and every such step is linear with another matrix. An eigenvalue at the solution says nothing
# of the way to it.

D, L = 2 * np.eye(N), np.eye(N, k=-1)
S = np.where(free[:, None], string.A.toarray(), D)


def near_solution(theta1, theta2):
    """The largest |eigenvalue| of a step of MNMAOR, once the contact is found."""
    X = (D - theta2 * L) / theta1 + D
    return np.abs(np.linalg.eigvals(np.eye(N) - 2 * np.linalg.solve(X, S))).max()


THETAS, seen = (0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0), {}
print(
    f"{'theta1':>6}   {'MNMSOR near the solution':>24} {'from 0':>8}   "
    f"{'MNMAOR with 2 theta1, near':>26} {'from 0':>8}"
)
for theta in THETAS:
    methods = icp.MNMSOR(theta1=theta), icp.MNMAOR(theta1=theta, theta2=2 * theta)
    near = near_solution(theta, theta), near_solution(theta, 2 * theta)
    seen[theta] = [measured(errors(method)) for method in methods]
    print(
        f"{theta:6.1f}   {near[0]:24.4f} {seen[theta][0]:8.4f}   {near[1]:26.4f} "
        f"{seen[theta][1]:8.4f}"
    )

# %%
# (With $\theta_2 = 2\theta_1$ a free row does what projected SOR does with $\omega = 2\theta_1/(1 + \theta_1)$. Half of
# the newest values got lost in the modulus, and twice as many make good for it.)
#
# ### A third way: neither alive nor dead
#
# $$A = \begin{pmatrix} 1 & 0 & 2 \\ 2 & 1 & 0 \\ 0 & 2 & 1 \end{pmatrix}, \qquad q = -(1, 1, 1)^\top, \qquad \psi = 0$$
#
# has one solution, $(1, 1, 1)/3$, at which all rows are free; $A$ is a P-matrix. With $M_1 = A$ and $\Omega = \omega I$
# (`MNMMOD`) an error along an eigenvector of $A$ is there multiplied by $(\omega - \lambda)/(\omega + \lambda)$. The
# eigenvalues are 3 and $\pm i\sqrt3$, and an imaginary one is as far from $\omega$ as from $-\omega$:
#
# $$|\omega - i\sqrt3| \,/\, |\omega + i\sqrt3| = 1 \qquad \text{for every } \omega.$$
#
# In that plane the error is turned and never shrinks. What helps is to take *less*: half a step multiplies by
# $(1 + \sigma)/2$ instead of $\sigma$, and for $|\sigma| = 1$, $\sigma \ne 1$, that is below 1.

wheel = icp.ICP([[1, 0, 2], [2, 1, 0], [0, 2, 1]], [-1, -1, -1])
full = icp.MNMMOD(theta1=2.0)
half = icp.Modulus(
    splitting=2 * wheel.A.toarray() + 2 * np.eye(3), phi2=2.0
)  # X = 2 (A + Omega)


def turns(method, steps=40):
    """The iterates from (1, 0, 0), less the solution."""
    return (
        np.array(
            [
                z
                for z, _ in islice(
                    method.iterates(wheel, np.array([1.0, 0, 0])), steps + 1
                )
            ]
        )
        - 1 / 3
    )


print("distance after 0, 1, 2, 5, 20 and 40")
for name, method in (("full", full), ("half", half)):
    distance = np.linalg.norm(turns(method), axis=1)[[0, 1, 2, 5, 20, 40]]
    print(f"{name} steps: {', '.join(f'{one:.4f}' for one in distance)}")

# %%
# ### All three in a picture
#
# Lines are theory, markers are measured. Projected SOR has its sharp best at $\omega^*$ and ends at 2. The paper's
# sweep is slow, and falls off a cliff that its line does not show. To the right the wheel, seen along
# $(1, 1, 1)$.

BLUE, RED, GREEN = "#0072B2", "#D55E00", "#009E73"
figure, (pace, plane) = plt.subplots(
    1, 2, figsize=(10, 4.2), width_ratios=[1.5, 1], layout="constrained"
)
grid = np.linspace(0.3, 6, 120)
for member, (times, colour, marker) in enumerate([(1, RED, "s"), (2, GREEN, "D")]):
    pace.plot(
        grid,
        [near_solution(theta, times * theta) for theta in grid],
        color=colour,
        linewidth=1.3,
    )
    alive = [theta for theta in THETAS if seen[theta][member] < 1]
    pace.plot(
        alive,
        [seen[theta][member] for theta in alive],
        marker,
        color=colour,
        markersize=6,
    )
    dead = [theta for theta in THETAS if seen[theta][member] > 1]
    pace.plot(dead, [1.0] * len(dead), "X", color=colour, markersize=8)
grid = np.linspace(0.3, 2.0, 300)
pace.plot(grid, [young(omega) for omega in grid], color=BLUE, linewidth=1.3)
omegas = [0.5, 0.8, 1.1, 1.4, 1.6, best, 1.8, 1.9, 1.96]
pace.plot(
    omegas,
    [measured(errors(icp.PSOR(omega=omega))) for omega in omegas],
    "o",
    color=BLUE,
    markersize=5,
)
pace.axhline(1.0, color="0.6", linewidth=1)
for text, at, off in (
    ("projected SOR,\nω = θ₁", (best, young(best)), (12, 6)),
    ("MNMSOR", (2.5, near_solution(2.5, 2.5)), (0, 5)),
    ("MNMAOR,\nθ₂ = 2θ₁", (5, near_solution(5, 10)), (5, -30)),
    ("MNMSOR from z = 0: never arrives", (6, 1.0), (8, 7)),
):
    right = "right" if at[0] == 6 else "left"
    pace.annotate(text, at, off, textcoords="offset points", fontsize=9, ha=right)
pace.set(
    ylim=(None, 1.03),
    xlabel="relaxation parameter θ₁",
    ylabel="what a step leaves of the error",
)
pace.set_title("Theory (lines) and measurement (markers)")

across = np.array([[1, -1, 0], [1, 1, -2]]) / np.sqrt(
    [[2], [6]]
)  # the plane that turns
for method, colour, marker in ((full, RED, "s"), (half, BLUE, "o")):
    plane.plot(
        *across @ turns(method).T,
        color=colour,
        marker=marker,
        markersize=4,
        linewidth=0.7,
    )
plane.plot(0, 0, "*", color="black", markersize=10)
plane.annotate("full steps turn for ever", (-0.26, 0.27), fontsize=9, va="bottom")
plane.annotate("half steps arrive", (0.36, -0.01), fontsize=9)
plane.annotate(
    "start",
    across @ turns(full)[0],
    (-4, 6),
    textcoords="offset points",
    ha="right",
    fontsize=9,
)
plane.set(
    aspect="equal", xlabel="error across (1, 1, 1)", title="The wheel, with ω = 2"
)
for axes in (pace, plane):
    axes.spines[["top", "right"]].set_visible(False)
for suffix in ("png", "svg"):
    figure.savefig(f"why_relaxation_helps.{suffix}", dpi=150)

# %%
# ## Vary one thing
#
# `N`, the number of points. The best $\omega$ moves towards 2 and gets sharper. Without relaxation the sweeps grow like
# $N^2$, with the best one like $N$:


def needed(sigma):
    """Steps until a millionth is left."""
    return math.log(1e-6) / math.log(sigma)


for n in (19, 39, 79, 159, 319):
    found = stretched(n).solve("tridiagonal")
    slow = math.cos(math.pi / (np.argmin(found.p < found.r) + 1))
    at = 2 / (1 + math.sqrt(1 - slow**2))
    plain, fast = needed(young(1.0, slow)), needed(young(at, slow))
    print(f"{n:4d} points: best {at:.4f}, {fast:4.0f} sweeps instead of {plain:6.0f}")

# %%
# ## Exercises
#
# **1.** Young's formula holds near the solution. Up to which $\omega$ is it *proved*, for every start and before the
# first sweep, that projected SOR converges here? (`icp.theory.predicted_rate`)
#
# Answer: To 1, and hardly further. The proof bounds what a sweep makes of the worst error with any signs, and for it
# exaggerating is always a loss; up to 2 all goes well nevertheless.

low, high = 0.5, 1.9
while high - low > 1e-3:
    middle = (low + high) / 2
    found = icp.theory.predicted_rate(string, icp.PSOR(omega=middle))
    low, high = (middle, high) if isinstance(found, icp.theory.Rate) else (low, middle)
print(f"proved up to {low:.3f}")
assert 0.99 < low < 1.1, "what is proved ends at 1"

# %%
# **2.** Does `MNMSOR` with $\theta_1 = 6$ converge if it starts very near the solution?
#
# Answer: From a billionth away, yes, as its eigenvalue says. But its steps first let an error grow, some hundred
# thousand times, before they let it shrink; from a hundred-thousandth away it is thrown out of where they are linear.

for distance in (1e-9, 1e-5, 1e-1):
    error = errors(icp.MNMSOR(theta1=6.0), exact.z + distance)
    print(
        f"from {distance:.0e} away: the error grows to {error.max():.0e} and ends "
        f"at {error[-1]:.0e}"
    )

# %%
# **3.** For which $\omega$ is the wheel back where it was after four steps?
#
# Answer: For $\omega = \sqrt3$: then $(\omega - i\sqrt3)/(\omega + i\sqrt3) = -i$, a quarter of a turn.

back = turns(icp.MNMMOD(theta1=math.sqrt(3)))
gaps = np.abs(back[-1] - back[-5:-1]).max(axis=1)
print(
    "the 40th iterate differs from the 36th to the 39th by "
    f"{', '.join(f'{one:.1g}' for one in gaps)}"
)
assert gaps[0] < 1e-12 < gaps[1:].min(), "only every fourth iterate is the same"

# %%
# **4.** The package's advice for a method that fails is often a larger $\varphi$. Does it help the wheel?
#
# Answer: No. At free rows $X = A + \varphi I + \omega I$, so that $\varphi$ only stands for a larger $\omega$, and all
# of them turn. Half a step has $X = 2(A + \omega I)$: it damps along all directions alike.

for phi in (0.5, 2.0, 8.0):
    left = np.linalg.norm(turns(icp.MNMMOD(theta1=2.0, phi=phi), 1000)[-1])
    print(f"phi = {phi}: distance {left:.4f} after 1000 steps")
    assert left > 0.1, "no shift helps the wheel"
