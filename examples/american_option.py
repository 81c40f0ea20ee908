r"""When is it time to exercise an American put?

The right to sell a share at a fixed price, at any time: an obstacle problem for every date, backwards from the last.

Run: python examples/american_option.py       writes american_option.png and american_option.svg here
"""

# %%
# ## The model
#
# A put gives the right to sell a share, worth $S$, for the strike $K$ at any time within a year. Its value $V(S, t)$ is
# at least what exercising pays, $\psi(S) = \max(K - S, 0)$. While it is worth more it is held, and then it follows the
# equation of Black and Scholes,
#
# $$\frac{\partial V}{\partial t} + L V = 0, \qquad
#   L V = \tfrac{1}{2}\sigma^2 S^2 V_{SS} + \rho S V_S - \rho V,$$
#
# with the volatility $\sigma$ and the interest $\rho$, which is `RATE`. On a grid in $\log(S/K)$, where $L$ has
# constant coefficients, and in time steps $\Delta t$ backwards from expiry, one problem per date:
#
# $$p = V - \Delta t\, L V - V_{\text{later}} \ge 0, \qquad r = V - \psi \ge 0, \qquad p^T r = 0.$$
#
# $A = I - \Delta t\, L$ is the same for all dates; only $q = -V_{\text{later}}$ changes, but for the values at the ends
# of the grid.

import matplotlib.pyplot as plt
import numpy as np
import scipy.sparse as sp

import icpmodel as icp

RATE = 0.05  # 0.01 to 0.2
STRIKE, VOLATILITY, DATES, N = 100.0, 0.2, 400, 500  # DATES in a year
x = np.linspace(-1.0, 1.0, N + 2)  # log(S / K)
share, h = STRIKE * np.exp(x), x[1] - x[0]
payoff = np.maximum(STRIKE - share, 0)


def put(
    rate: float, volatility: float = VOLATILITY, years: int = 1, dates: int = DATES
) -> tuple:
    """The value on the inner grid, the exercise boundary, and the last solution."""
    dt = years / dates
    diffusion, drift = volatility**2 / (2 * h**2), (rate - volatility**2 / 2) / (2 * h)
    diagonals = [diffusion - drift, -2 * diffusion - rate, diffusion + drift]
    L = sp.diags_array(diagonals, offsets=[-1, 0, 1], shape=(N, N))
    ends = np.zeros(N)  # at both ends of the grid the value is the payoff
    ends[0], ends[-1] = diagonals[0] * payoff[0], diagonals[2] * payoff[-1]
    problem = icp.ICP(sp.eye_array(N) - dt * L, np.zeros(N), payoff[1:-1])
    value, boundary = payoff[1:-1], []
    for _ in range(dates):
        solution = problem.with_q(-value - dt * ends).solve(rtol=1e-10)
        value = solution.z
        exercise = solution.p > max(1e-9, 1e-3 * dt * rate * STRIKE)
        boundary.append(share[1:-1][~exercise][0] if exercise.any() else 0.0)
    return value, np.array(boundary), solution


def tree(early: bool, rate: float, steps: int = 2000) -> float:
    """At the money, by the tree of Cox, Ross and Rubinstein; European or American."""
    dt = 1 / steps
    up = np.exp(VOLATILITY * np.sqrt(dt))
    q, discount = (np.exp(rate * dt) - 1 / up) / (up - 1 / up), np.exp(-rate * dt)

    def pays(k: int) -> np.ndarray:
        return np.maximum(STRIKE - STRIKE * up ** (2.0 * np.arange(k + 1) - k), 0)

    v = pays(steps)
    for k in reversed(range(steps)):
        v = discount * (q * v[1:] + (1 - q) * v[:-1])
        v = np.maximum(v, pays(k)) if early else v
    return float(v[0])


# %%
# ## What is seen
#
# The nearer expiry, the higher the price of the share below which it is time to exercise: there is less left to wait
# for, and the strike would already bear interest. The right to exercise early is worth the difference to the value
# without it.

value, boundary, solution = put(RATE)
print(f"{'months to expiry':>17} {'exercise below':>15}")
for month in (1, 3, 6, 12):
    print(f"{month:17d} {boundary[month * DATES // 12 - 1]:15.2f}")
price = np.interp(0.0, x[1:-1], value)
print(
    f"\nAt the money the put is worth {price:.2f}; a binomial tree gives "
    f"{tree(True, RATE):.2f}."
)
print(f"Without the right to exercise early it would be {tree(False, RATE):.2f}.")

# %%
# Left the value a year before expiry, right the free boundary in time.

figure, (now, when) = plt.subplots(1, 2, figsize=(9, 3.9), layout="constrained")
now.plot(share, payoff, "--", color="#D55E00", label="exercise now: payoff")
now.plot(share[1:-1], value, color="#0072B2", label="the put, a year to expiry")
now.axvline(boundary[-1], color="0.6", linewidth=1, label="exercise left of this line")
now.set_xlim(60, 140)
now.set_ylim(-2, 42)
now.set_xlabel("price of the share")
now.set_ylabel("value")
now.set_title("What the put is worth")
now.legend(frameon=False)
when.step(12 / DATES * np.arange(1, DATES + 1), boundary, where="post", color="#0072B2")
when.axhline(STRIKE, linestyle=":", color="black")
when.annotate("strike", (12, STRIKE), ha="right", va="bottom")
when.annotate("hold", (6, (boundary[-1] + 2 * STRIKE) / 3))
when.annotate("exercise", (6, boundary[-1] - 1.5))
when.set_ylim(boundary[-1] - 6, STRIKE + 3)
when.set_xlabel("months to expiry")
when.set_ylabel("price of the share")
when.set_title("When to exercise")
for suffix in ("png", "svg"):
    figure.savefig(f"american_option.{suffix}", dpi=150)

# %%
# ## Vary one thing
#
# `RATE`. The higher the interest, the earlier one wants the money: the boundary rises, and what waiting is worth falls.

print(
    f"{'interest':>8} {'the put':>8} {'without early exercise':>23} "
    f"{'exercise below':>15}"
)
for rate in sorted({0.02, 0.05, 0.10, 0.20, RATE}):
    v, edge, _ = put(rate, dates=100)
    at_the_money = np.interp(0.0, x[1:-1], v)
    print(f"{rate:8.2f} {at_the_money:8.2f} {tree(False, rate):23.2f} {edge[-1]:15.2f}")

# %%
# ## Exercises
#
# **1.** With no interest, when is it worth while to exercise early?
#
# Answer: Never: the strike in hand bears nothing, and who waits keeps the choice. The American put is then worth what
# the one without early exercise is.

v, edge, _ = put(0.0)
early, late = np.interp(0.0, x[1:-1], v), tree(False, 0.0)
print(
    f"American {early:.3f}, without early exercise {late:.3f}; exercised at "
    f"{np.sum(edge > 0)} of {edge.size} dates"
)
assert not edge.any(), "without interest nobody exercises early"
assert abs(early - late) < 0.01, "without interest waiting costs nothing"

# %%
# **2.** A put that never expires is exercised below $K\,\frac{2\rho}{2\rho + \sigma^2}$. Compare with a year and with
# ten years.
#
# Answer: The boundary falls towards that price as expiry moves away, and does not reach it.

forever = STRIKE * 2 * 0.05 / (2 * 0.05 + 0.2**2)
edges = {
    years: put(0.05, 0.2, years=years, dates=40 * years)[1][-1] for years in (1, 10)
}
print(f"1 year {edges[1]:.2f}, 10 years {edges[10]:.2f}, for ever {forever:.2f}")
assert forever < edges[10] < edges[1], (
    "the boundary falls towards that of the put for ever"
)

# %%
# **3.** What is $p/\Delta t$ where the put is exercised, and why?
#
# Answer: $\rho K$, the interest that is lost by waiting. There $V = K - S$ and the share is a fair bet. Of the strike
# only the interest is left, $-L(K - S) = \rho K$, on the grid but for an error of its spacing squared. (Where it is
# exercised now it is exercised at the next date as well, so that $V_{\text{later}}$ is the payoff.)

_, edge, last = put(0.05)
lost = (
    last.p[share[1:-1] < edge[-1]][:-1] * DATES
)  # the last one has a neighbour that is held
print(
    f"p/dt from {lost.min():.4f} to {lost.max():.4f}; interest on the strike: "
    f"{0.05 * STRIKE:.4f} a year"
)
assert np.abs(lost - 0.05 * STRIKE).max() < 1e-2, (
    "what is lost is the interest on the strike"
)
