"""When to exercise an American put: one CVXPY model, compiled once, solved for every date.

The option's value V is at least what exercising pays; where it is more, it follows the Black-Scholes equation:

    p = V - dt L V - (value a moment later) >= 0,    r = V - payoff >= 0,    p'r = 0.

Run: python examples/american_option.py       writes american_option.png and american_option.svg here
"""

import cvxpy as cp
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import scipy.sparse as sp

import icpmodel as icp

strike, rate, volatility, years, dates, n = 100.0, 0.05, 0.2, 1.0, 400, 500

# in x = log(price / strike), where the coefficients are constant; the value at both ends of the grid is the payoff
x = np.linspace(-1.0, 1.0, n + 2)
h, dt = x[1] - x[0], years / dates
payoff = strike * np.maximum(1 - np.exp(x), 0)
diffusion, drift = volatility**2 / (2 * h**2), (rate - volatility**2 / 2) / (2 * h)
L = sp.diags_array([diffusion - drift, -2 * diffusion - rate, diffusion + drift], offsets=[-1, 0, 1], shape=(n, n))
ends = np.zeros(n)
ends[0], ends[-1] = (diffusion - drift) * payoff[0], (diffusion + drift) * payoff[-1]

value, later = cp.Variable(n, name="value"), cp.Parameter(n, name="later")
exercise = icp.complements(value - dt * (L @ value + ends) - later, value - payoff[1:-1])
problem = icp.Problem(exercise)

later.value = payoff[1:-1]
boundary = []
for _ in range(dates):
    problem.solve(rtol=1e-10)
    later.value = value.value
    held = np.flatnonzero(exercise.r > 1e-9)  # where holding is worth more than exercising
    boundary.append(strike * np.exp(x[1 + held[0]]))

print(f"{'months to expiry':>17} {'exercise below':>15}")
for month in (1, 3, 6, 12):
    print(f"{month:17d} {boundary[month * dates // 12 - 1]:15.2f}")
price = np.interp(0.0, x[1:-1], value.value)


def tree(early: bool, steps: int = 2000) -> float:
    """The value on a binomial tree of Cox, Ross and Rubinstein, with or without the right to exercise early."""
    dt = years / steps
    up = np.exp(volatility * np.sqrt(dt))
    q, discount = (np.exp(rate * dt) - 1 / up) / (up - 1 / up), np.exp(-rate * dt)
    pays = lambda k: np.maximum(strike - strike * up ** (2.0 * np.arange(k + 1) - k), 0)  # noqa: E731
    v = pays(steps)
    for k in reversed(range(steps)):
        v = discount * (q * v[1:] + (1 - q) * v[:-1])
        v = np.maximum(v, pays(k)) if early else v
    return float(v[0])


print(f"\nAt the money the put is worth {price:.2f}; a binomial tree gives {tree(True):.2f}.")
print(f"Without the right to exercise early it would be {tree(False):.2f}.")

figure, (now, when) = plt.subplots(1, 2, figsize=(9, 3.9), layout="constrained")
prices = strike * np.exp(x)
now.plot(prices, payoff, "--", color="#D55E00", label="exercise now: payoff")
now.plot(prices[1:-1], value.value, color="#0072B2", label="the put, a year to expiry")
now.axvline(boundary[-1], color="0.6", linewidth=1, label="exercise left of this line")
now.set_xlim(60, 140)
now.set_ylim(-2, 42)
now.set_xlabel("price of the share")
now.set_ylabel("value")
now.set_title("What the put is worth")
now.legend(frameon=False)
when.step(12 * years / dates * np.arange(1, dates + 1), boundary, where="post", color="#0072B2")
when.axhline(strike, linestyle=":", color="black")
when.annotate("strike", (12, strike), ha="right", va="bottom")
when.annotate("hold", (6, 93))
when.annotate("exercise", (6, 80))
when.set_ylim(75, 103)
when.set_xlabel("months to expiry")
when.set_ylabel("price of the share")
when.set_title("When to exercise")
for suffix in ("png", "svg"):
    figure.savefig(f"american_option.{suffix}", dpi=150)
