r"""When should a firm pay dividends, and how much?

What the best act is worth is the obstacle, and that depends on the solution itself: impulse control.

Run: python examples/dividends.py             writes dividends.png and dividends.svg into the current folder
"""

# %%
# ## The model
#
# A firm's reserve drifts, $dX = \mu\,dt + \sigma\,dW$, until it is ruined at 0. Its owner may pay it down from $x$ to
# $y$ at any time: a fixed cost $c$ and a tax $\lambda$ leave $(x - y - c)/(1 + \lambda)$ to him. Money later is worth
# less, by the rate $\rho$. The value $V$ of a reserve is at least what the best payment now gives, and where it is more
# it is best to wait:
#
# $$p = \rho V - \tfrac{1}{2}\sigma^2 V'' - \mu V' \ge 0, \qquad r = V - \psi(V) \ge 0, \qquad p\,r = 0,$$
#
# $$\psi(V)(x) = \max_{y < x}\left( V(y) + \frac{x - y - c}{1 + \lambda} \right), \qquad V(0) = 0.$$
#
# With $\mu = 0.5$, $\sigma = 0.3$, $\rho = 0.2$ the answer is known: pay from $x^*$ on, down to a lower reserve. $c$ is
# `COST`.

import itertools

import matplotlib.pyplot as plt
import numpy as np
import scipy.sparse as sp

import icpmodel as icp

COST, TAX = 0.05, 0.2  # COST from 0.0025 to 0.15: beyond it the firm never pays
DRIFT, VOLATILITY, RHO, LENGTH = 0.5, 0.3, 0.2, 1.5


def firm(
    n: int, cost: float = COST, tax: float = TAX
) -> tuple[np.ndarray, icp.Solution]:
    """The grid of reserves and the value on it."""
    x, worth = np.linspace(0.0, LENGTH, n), 1 / (1 + tax)
    h = x[1]
    second, first, q = VOLATILITY**2 / (2 * h**2), DRIFT / (2 * h), np.zeros(n)
    below, middle, above = (
        np.full(n - 1, first - second),
        np.full(n, RHO + 2 * second),
        np.full(n - 1, -first - second),
    )
    middle[0], above[0] = 1.0, 0.0  # ruin: V = 0
    below[-1], q[-1] = (
        -2 * second,
        -2 * (second + first) * h * worth,
    )  # far out: slope 1/(1 + tax)
    A = sp.diags_array([below, middle, above], offsets=[-1, 0, 1])
    i, j = np.tril_indices(n, -1)  # from x_i down to x_j
    gains = sp.csr_array((worth * (x[i] - x[j] - cost), (i, j)), shape=(n, n))
    return x, icp.ICP(A, q, icp.Intervention(gains)).solve(rtol=1e-10)


def payment(
    x: np.ndarray, solution: icp.Solution, tax: float = TAX
) -> tuple[float, float]:
    """Pay at, and down to: where the interpolated slope of V is 1/(1 + tax)."""
    slope, worth = np.diff(solution.z) / x[1], 1 / (1 + tax)
    pays = int(np.argmax(solution.p > solution.r))
    cells = pays - 3, int(np.argmax(slope < worth)) - 1
    at, down = (
        x[k] + x[1] / 2 + x[1] * (worth - slope[k]) / (slope[k + 1] - slope[k])
        for k in cells
    )
    return at, down


# %%
# ## What is seen
#
# Three grids, each four times as fine as the one before, and the exact answer, which has a closed form.

known = icp.scenes.dividend().quantities
exact = [known[name].exact for name in ("V(1)", "x*", "target")]
print(f"{'grid h':>9} {'V(1)':>12} {'pay at x*':>12} {'down to':>12} {'steps':>6}")
for n in (61, 241, 961):
    x, solution = firm(n)
    seen = [np.interp(1.0, x, solution.z), *payment(x, solution)]
    print(
        f"{x[1]:9.6f}"
        + "".join(f" {one:12.7f}" for one in seen)
        + f" {solution.iterations:6d}"
    )
if (COST, TAX) == (0.05, 0.2):
    print(f"{'exact':>9}" + "".join(f" {one:12.7f}" for one in exact))
    print("A quarter of the grid spacing divides the error by about 16: second order.")

# %%
# Left the value and the best payment; they meet where it is time to pay. Right the slope of the value: at $x^*$ and at
# the reserve to which is paid it is $1/(1 + \lambda)$, what one unit paid out is worth.

at, down = payment(x, solution)
V, pays = solution.z, solution.p > solution.r
figure, (value, slope) = plt.subplots(1, 2, figsize=(9, 3.9), layout="constrained")
value.plot(x, V, color="#0072B2", label="value V")
best = solution.problem.psi.value(V)
value.plot(x[1:], best[1:], "--", color="#D55E00", label="best payment now, ψ(V)")
value.axvspan(x[pays][0], x[-1], color="0.9", label="pay")
value.set_ylabel("value to the owner, money")
value.set_title("Pay where the best payment is worth V")
value.legend(frameon=False, loc="lower right")
slope.plot((x[1:] + x[:-1]) / 2, np.diff(V) / x[1], color="#0072B2", label="slope of V")
words = "1/(1 + tax): worth of one unit paid out"
slope.axhline(1 / (1 + TAX), linestyle=":", color="black", label=words)
for place, colour, mark, words in (
    (at, "#D55E00", "o", "pay here: x*"),
    (down, "#009E73", "s", "down to here"),
):
    slope.plot([place], [1 / (1 + TAX)], mark, color=colour, markersize=8, label=words)
slope.set_ylim(0.3, 1.4)
slope.set_ylabel("worth of one unit more in the reserve")
slope.set_title("Pay from x* down to the same slope")
slope.legend(frameon=False, loc="lower right")
for axes in (value, slope):
    axes.set_xlabel("reserve x, money")
for suffix in ("png", "svg"):
    figure.savefig(f"dividends.{suffix}", dpi=150)

# %%
# ## Vary one thing
#
# `COST`, of each payment. The dearer, the less often and the more at once.

print(f"{'cost':>8} {'pay at x*':>10} {'down to':>9} {'payment':>9} {'V(1)':>9}")
for cost in sorted({0.0025, 0.01, 0.05, 0.1, COST}):
    x, one = firm(301, cost)
    high, low = payment(x, one)
    print(
        f"{cost:8.4f} {high:10.4f} {low:9.4f} {high - low:9.4f} "
        f"{np.interp(1.0, x, one.z):9.4f}"
    )

# %%
# ## Exercises
#
# **1.** By which factor does the payment change when the cost is a quarter of what it was? Guess a power of $c$.
#
# Answer: For small $c$ by about $4^{1/3} = 1.59$: the payment is like $c^{1/3}$. Without cost there is one threshold
# $x_0$, and near to it $V' = 1/(1 + \lambda) + a\,(x - x_0)^2$. With cost $V' = 1/(1 + \lambda) + a\,((x - x_0)^2 -
# \delta^2)$ or nearly so: paying $2\delta$ gains the area between $V'$ and $1/(1 + \lambda)$, which is like $\delta^3$,
# and has to make good $c$.

sizes = []
for cost in (0.02, 0.005, 0.00125):
    x, one = firm(601, cost)
    high, low = payment(x, one)
    sizes.append(high - low)
factors = [a / b for a, b in itertools.pairwise(sizes)]
print("payments " + ", ".join(f"{one:.4f}" for one in sizes), end="; factors ")
print(", ".join(f"{one:.3f}" for one in factors) + f"; 4^(1/3) = {4 ** (1 / 3):.3f}")
assert all(1.5 < one < 1.75 for one in factors), (
    "a quarter of the cost divides the payment by about 1.6"
)

# %%
# **2.** The tax is doubled. Does the owner pay later?
#
# Answer: No. $(1 + \lambda)V$ satisfies conditions without $\lambda$: all that he gets is less by one factor, and so
# no comparison of acts changes.

x, old = firm(241)
_, new = firm(241, tax=2 * TAX)
ratio = new.z[1:] / old.z[1:]
print(f"V falls to {ratio.min():.6f} ... {ratio.max():.6f} of it,", end=" ")
print(f"(1 + tax)/(1 + 2 tax) = {(1 + TAX) / (1 + 2 * TAX):.6f}")
print(f"pay at {payment(x, old)[0]:.6f} and {payment(x, new, 2 * TAX)[0]:.6f}")
assert np.allclose(ratio, (1 + TAX) / (1 + 2 * TAX), rtol=1e-8), (
    "the tax divides the value as the formula says"
)

# %%
# **3.** How can one know that $V$ is the only solution, though the obstacle depends on it?
#
# Answer: $\psi$ is monotone, and a constant added to $V$ is added to $\psi(V)$, no more. With $A$, whose rows are
# dominant, that leaves room for one solution if there is a *strict supersolution*, some $s$ with $As + q > 0$ and
# $s > \psi(s)$. There is one since every payment costs something. Its margin also turns the residual of any $z$ into a
# bound of its error. The certificate names this proof.

bound = solution.certificate.bound
print(f"proved: {bound.proof}")
print(f"|V - exact solution on this grid| <= {bound.value:.1e}")
assert solution.certificate.unique, "it is proved that there is no other solution"
