r"""Which fixed cost and which volatility explain when firms pay dividends, and how much?

A calibration to thresholds: a threshold is a function of the value, so that one `adjoint` gives its derivative in all
entries of the model at once.

Run: python examples/calibrate_dividends.py   writes calibrate_dividends.png and calibrate_dividends.svg here
"""

# %%
# ## The model
#
# As in the lesson on dividends, the reserve of a firm drifts by $\mu$ a year with the volatility $\sigma$. Paying it
# down from $x$ to $y$ is worth $(x - y - c)/(1 + \lambda)$ to its owner. Its value $V$ solves, on a grid,
#
# $$p = AV + q \ge 0, \qquad r = V - \psi(V) \ge 0, \qquad p^T r = 0, \qquad
#   \psi_i(V) = \max_{j < i}\left( V_j + \frac{x_i - x_j - c}{1 + \lambda} \right),$$
#
# where $\sigma$ is in $A$ and $q$, and $c$ in the gains of all jumps. Several firms are observed, whose drifts are
# known: at which reserve they pay and down to which one, each with an error of 1 %. Wanted are the $c$ and $\sigma$
# that all of them share. The drifts are `DRIFTS`.
#
# The first row that pays is no threshold for a least-squares method: it stands still while $c$ moves, and then jumps by
# the grid spacing. What is fitted is where the slope of $V$ reaches $1/(1 + \lambda)$, by the straight line through the
# slopes of two cells.

import matplotlib.pyplot as plt
import numpy as np
import scipy.sparse as sp
from scipy.optimize import least_squares

import icpmodel as icp

DRIFTS = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7)
ERROR, TRUE, START = 0.01, (0.05, 0.3), (0.12, 0.2)  # (c, sigma)
# ERROR from 0.001 to 0.05
RATE, WORTH, n, LENGTH = 0.2, 1 / 1.2, 121, 1.5
x = np.linspace(0.0, LENGTH, n)
h = x[1]
at_ruin = sp.csr_array(([1.0], ([0], [0])), shape=(n, n))  # row 0 of A: V = 0
i, j = np.tril_indices(n, -1)  # from x_i down to x_j


def operator(
    rate: float, diffusion: float, drift: float
) -> tuple[sp.csr_array, np.ndarray]:
    """rate V - diffusion V'' - drift V', V' = WORTH at the right end: linear in all."""
    second, first, q = diffusion / h**2, drift / (2 * h), np.zeros(n)
    below, middle = np.full(n - 1, first - second), np.full(n, rate + 2 * second)
    above = np.full(n - 1, -first - second)
    below[-1], q[-1] = -2 * second, -2 * (second + first) * h * WORTH
    middle[0] = above[0] = 0.0
    return sp.diags_array([below, middle, above], offsets=[-1, 0, 1], format="csr"), q


def value(cost: float, volatility: float, drift: float, z0=None) -> icp.Solution:
    A, q = operator(RATE, volatility**2 / 2, drift)
    gains = sp.csr_array((WORTH * (x[i] - x[j] - cost), (i, j)), shape=(n, n))
    return icp.ICP(A + at_ruin, q, icp.Intervention(gains)).solve(rtol=1e-12, z0=z0)


def threshold(z: np.ndarray, k: int) -> tuple[float, np.ndarray]:
    """Where the line through two slopes of cells is WORTH; its derivative in z."""
    s0, s1 = np.diff(z[k : k + 3]) / h
    zbar = np.zeros(n)
    zbar[k : k + 3] = (
        np.array([s1 - WORTH, 2 * WORTH - s0 - s1, s0 - WORTH]) / (s1 - s0) ** 2
    )
    return x[k] + h / 2 + h * (WORTH - s0) / (s1 - s0), zbar


def thresholds(solution: icp.Solution) -> list[tuple[float, np.ndarray]]:
    """Pay at, from the last two free cells, and down to."""
    pays, falls = (
        np.argmax(solution.p > solution.r),
        np.argmax(np.diff(solution.z) < WORTH * h),
    )
    return [threshold(solution.z, int(pays) - 3), threshold(solution.z, int(falls) - 1)]


def slopes(solution: icp.Solution, volatility: float) -> list[list[float]]:
    """The derivative of both thresholds in the cost and in the volatility."""
    dA, dq = operator(0.0, volatility, 0.0)
    derivative = solution.derivative()  # factorised once
    by = [derivative.adjoint(zbar) for _, zbar in thresholds(solution)]
    return [
        [-WORTH * one.psi.sum(), one.A.multiply(dA).sum() + one.q @ dq] for one in by
    ]


solved = {}


def firms(guess: np.ndarray) -> list[icp.Solution]:
    """One for each; residual and Jacobian ask for the same ones."""
    if tuple(guess) not in solved:
        solved[tuple(guess)] = [value(*guess, drift) for drift in DRIFTS]
    return solved[tuple(guess)]


def modelled(guess: np.ndarray) -> np.ndarray:
    return np.array([t for solution in firms(guess) for t, _ in thresholds(solution)])


noise = np.random.default_rng(1).standard_normal(2 * len(DRIFTS))
observed = modelled(np.array(TRUE)) * (1 + ERROR * noise)
path = []


def residual(guess: np.ndarray) -> np.ndarray:
    return (modelled(guess) / observed - 1) / ERROR


def jacobian(guess: np.ndarray) -> np.ndarray:
    path.append(guess.copy())
    rows = [row for one in firms(guess) for row in slopes(one, guess[1])]
    return np.array(rows) / (ERROR * observed[:, None])


# %%
# ## What is seen
#
# A handful of Jacobians lead from far away to the answer, with errors that come from the last one. The derivatives are
# *certain*: of every row it is proved on which side of its obstacle it is.

scales = {"bounds": ([0.01, 0.1], [0.2, 0.5]), "x_scale": (0.05, 0.3)}
found = least_squares(residual, START, jacobian, **scales)
covariance = np.linalg.inv(found.jac.T @ found.jac)
errors = np.sqrt(covariance.diagonal())
print(f"{'':>16} {'start':>8} {'found':>8} {'error':>8} {'true':>8}")
rows = zip(("fixed cost c", "volatility σ"), START, found.x, errors, TRUE, strict=True)
for name, *numbers in rows:
    print(f"{name:>16}" + "".join(f" {number:8.4f}" for number in numbers))
free = 2 * len(DRIFTS) - 2
if free:
    print(
        f"misfit per degree of freedom {2 * found.cost / free:.2f}, after "
        f"{len(path)} Jacobians"
    )
certain = [one.derivative().certain for one in firms(found.x)]
print(
    f"at the answer the derivative is certain for {sum(certain)} of {len(certain)} "
    "firms"
)

# %%
# Left a threshold that can be fitted, and one that cannot; in the middle the firms; right the way to the answer.

costs, one = np.linspace(0.05, 0.066, 33), None
by_rows, by_slopes = [], []
for cost in costs:
    one = value(cost, TRUE[1], 0.5, one)
    by_rows.append(x[np.argmax(one.p > one.r)])
    by_slopes.append(thresholds(one)[0][0])
figure, (reading, fit, plane) = plt.subplots(
    1, 3, figsize=(13, 4.2), layout="constrained"
)
reading.step(costs, by_rows, where="mid", color="#D55E00", label="first row that pays")
reading.plot(costs, by_slopes, color="#0072B2", label="where the slope is 1/(1 + tax)")
tangent = by_slopes[0] + slopes(value(costs[0], TRUE[1], 0.5), TRUE[1])[0][0] * (
    costs - costs[0]
)
reading.plot(
    costs, tangent, ":", color="black", label="its tangent at the left, by the adjoint"
)
reading.set_xlabel("fixed cost c")
reading.set_ylabel("reserve at which dividends are paid")
reading.set_title("A threshold to fit, and one that is not")
reading.legend(frameon=False, fontsize=9)

several = np.linspace(0.2, 0.7, 9)
for guess, line, colour, words in (
    (START, "--", "0.6", "start"),
    (found.x, "-", "#0072B2", "fitted"),
):
    curve = [[t for t, _ in thresholds(value(*guess, drift))] for drift in several]
    fit.plot(several, curve, line, color=colour, label=[words, None])
bars = {"fmt": "o", "color": "black", "markersize": 4, "capsize": 3}
fit.errorbar(
    DRIFTS, observed[0::2], yerr=ERROR * observed[0::2], **bars, label="observed"
)
fit.errorbar(DRIFTS, observed[1::2], yerr=ERROR * observed[1::2], **bars)
fit.annotate("pay from here", (0.45, 0.9), ha="center")
fit.annotate("down to here", (0.45, 0.52), ha="center")
fit.set_xlabel("drift μ of the firm, a year")
fit.set_ylabel("reserve")
fit.set_title("One cost, one volatility")
fit.legend(frameon=False, fontsize=9, loc="center right")

turns = np.linspace(0, 2 * np.pi, 200)
circle = np.linalg.cholesky(covariance) @ np.array([np.cos(turns), np.sin(turns)])
for ax, deviations in (
    (plane, (2,)),
    (inset := plane.inset_axes((0.14, 0.08, 0.4, 0.4)), (1, 2)),
):
    ax.plot(*np.array(path).T, ".-", color="0.6", label="on the way")
    for k in deviations:
        ax.plot(*(found.x[:, None] + k * circle), color="#0072B2")
    ax.plot(*found.x, "o", color="#0072B2", label="found, with 1 and 2 errors")
    ax.plot(*TRUE, "x", color="#D55E00", markersize=9, label="true")
inset.set_xlim(found.x[0] - 4 * errors[0], found.x[0] + 4 * errors[0])
inset.set_ylim(found.x[1] - 4 * errors[1], found.x[1] + 4 * errors[1])
inset.tick_params(labelsize=8)
plane.indicate_inset_zoom(inset)
plane.set_xlabel("fixed cost c")
plane.set_ylabel("volatility σ")
plane.set_title("From the start to the answer")
plane.legend(frameon=False, fontsize=9)
for suffix in ("png", "svg"):
    figure.savefig(f"calibrate_dividends.{suffix}", dpi=150)

# %%
# ## Vary one thing
#
# `DRIFTS`. The Jacobian says before anything is fitted how well $c$ and $\sigma$ will be known. One firm has two
# thresholds, just enough for two numbers, and then no misfit is left that could speak against the model. More firms
# help by their number, like its square root, and little by their variety.

print(
    f"{'firms with the drifts':>32} {'error of c':>11} {'error of σ':>11} "
    f"{'correlation':>12}"
)
for drifts in sorted(
    {(0.45,), (0.2, 0.7), (0.4, 0.45, 0.5), (0.2, 0.3, 0.4, 0.5, 0.6, 0.7), DRIFTS}
):
    rows = []
    for drift in drifts:
        one = value(*TRUE, drift)
        for (t, _), row in zip(thresholds(one), slopes(one, TRUE[1]), strict=True):
            rows.append(np.array(row) / (ERROR * t))
    expected = np.linalg.inv(np.array(rows).T @ np.array(rows))
    deviation = np.sqrt(expected.diagonal())
    together = expected[0, 1] / deviation.prod()
    print(f"{drifts!s:>32} {deviation[0]:11.4f} {deviation[1]:11.4f} {together:12.2f}")

# %%
# ## Exercises
#
# **1.** Check the Jacobian: move $(c, \sigma)$ a little from the start, and compare.
#
# Answer: The difference of the residuals over a small step and its derivative agree in five digits or more.

step = 1e-6 * np.array([1.0, -2.0])
start = np.array(START)
differences, derivative = (
    residual(start + step) - residual(start - step),
    2 * jacobian(start) @ step,
)
print(f"largest relative difference {np.abs(differences / derivative - 1).max():.0e}")
assert np.allclose(differences, derivative, rtol=1e-5), (
    "differences give the same derivative"
)

# %%
# **2.** At some costs two neighbouring rows are equally good to pay down to. What becomes of the derivative there? Find
# such a cost by bisection.
#
# Answer: It has two sides, and the package says that it is not certain: two equally good jumps cannot be excluded. Then
# `one_sided` gives the derivative in a direction from both sides. (On the grid; for the continuous problem there is no
# kink, and the sides differ the less the finer it is.)


def target(cost: float) -> int:
    """The row that is paid down to."""
    return int(np.argmax(np.diff(value(cost, TRUE[1], 0.5).z) < WORTH * h))


low, high = 0.05, 0.07
here = target(low)
assert target(high) != here, "the target jumps in between"
while high - low > 1e-14:
    middle = (low + high) / 2
    low, high = (middle, high) if target(middle) == here else (low, middle)
solution = value(low, TRUE[1], 0.5)
kink, zbar = solution.derivative(), thresholds(solution)[0][1]
left, right = (
    zbar @ dz for dz in kink.one_sided(dpsi=WORTH)
)  # gains fall where c rises
print(
    f"at c = {low:.9f}: certain {kink.certain}; dx*/dc is {-left:.4f} to the left, "
    f"{-right:.4f} to the right"
)
assert not kink.certain, "at the jump no derivative is certain"

# %%
# **3.** By how much does the owner pay later if $c$ rises by one thousandth? Predict it, then solve.
#
# Answer: By the derivative of $x^*$ in $c$ times one thousandth, up to a term that is quadratic in the change.

before, after = value(0.05, TRUE[1], 0.4), value(0.051, TRUE[1], 0.4)
predicted = 1e-3 * slopes(before, TRUE[1])[0][0]
happened = thresholds(after)[0][0] - thresholds(before)[0][0]
print(f"predicted {predicted:.6f}, happened {happened:.6f}")
assert np.isclose(predicted, happened, rtol=0.05), "the derivative predicts the change"
