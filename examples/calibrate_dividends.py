"""Which fixed cost and which volatility explain when firms pay dividends, and how much? Calibration to thresholds.

The model is that of dividends.py: a reserve drifts by μ a year with volatility σ; paying it down from x to y is worth
(x - y - c)/(1 + tax) to its owner. Its value V solves, on a grid,

    p = AV + q >= 0,    r = V - ψ(V) >= 0,    p'r = 0,    ψ_i(V) = max over j < i of V_j + (x_i - x_j - c)/(1 + tax),

where σ is in A and q and c in the gains of all jumps. Seen of six firms, whose μ is known: at which reserve they pay
and down to which one, each with an error of 1 %. It teaches: a threshold is a function of V, so that one `adjoint`
gives its derivative in all entries of A and q and all gains at once, and the chain rule that in c and σ.

The first row in which p > 0 is no threshold for a least-squares method: it stands still while c moves, and then jumps
by h. What is fitted is where the slope of V reaches 1/(1 + tax), by the straight line through the slopes of two cells:
smooth while these are the same cells, and where they change it jumps by some thousandths of h. The picture shows both.

To vary: DRIFTS. Firms that are alike say less; with one firm two numbers are left, and no error can be found in them.

Run: python examples/calibrate_dividends.py   writes calibrate_dividends.png and calibrate_dividends.svg here
"""

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import scipy.sparse as sp
from scipy.optimize import least_squares

import icpmodel as icp

DRIFTS, ERROR, TRUE, START = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7), 0.01, (0.05, 0.3), (0.12, 0.2)
RATE, WORTH, n, LENGTH = 0.2, 1 / 1.2, 241, 1.5
x = np.linspace(0.0, LENGTH, n)
h = x[1]
at_ruin = sp.csr_array(([1.0], ([0], [0])), shape=(n, n))  # row 0 of A: V = 0
i, j = np.tril_indices(n, -1)  # who pays nothing, or less than c, loses: jumps of any length may stand here


def operator(rate: float, diffusion: float, drift: float) -> tuple[sp.csr_array, np.ndarray]:
    """rate·V - diffusion·V″ - drift·V′ with V′ = WORTH at the right end; row 0, V = 0, is left empty. Linear in all."""
    second, first, q = diffusion / h**2, drift / (2 * h), np.zeros(n)
    diagonals = [np.full(n - 1, first - second), np.full(n, rate + 2 * second), np.full(n - 1, -first - second)]
    diagonals[0][-1], q[-1] = -2 * second, -2 * (second + first) * h * WORTH
    diagonals[1][0] = diagonals[2][0] = 0.0
    return sp.diags_array(diagonals, offsets=[-1, 0, 1], format="csr"), q


def value(cost: float, volatility: float, drift: float, z0: icp.Solution | None = None) -> icp.Solution:
    A, q = operator(RATE, volatility**2 / 2, drift)
    gains = sp.csr_array((WORTH * (x[i] - x[j] - cost), (i, j)), shape=(n, n))
    return icp.ICP(A + at_ruin, q, icp.Intervention(gains)).solve(rtol=1e-12, z0=z0)


def threshold(z: np.ndarray, k: int) -> tuple[float, np.ndarray]:
    """Where the line through the slopes of cells k and k + 1 reaches WORTH, and the derivative of that in z."""
    s0, s1 = np.diff(z[k : k + 3]) / h
    zbar = np.zeros(n)
    zbar[k : k + 3] = np.array([s1 - WORTH, 2 * WORTH - s0 - s1, s0 - WORTH]) / (s1 - s0) ** 2
    return x[k] + h / 2 + h * (WORTH - s0) / (s1 - s0), zbar


def thresholds(solution: icp.Solution) -> list[tuple[float, np.ndarray]]:
    """Pay at, from the last two free cells, and down to."""
    pays = int(np.argmax(solution.p > solution.r))
    return [threshold(solution.z, pays - 3), threshold(solution.z, int(np.argmax(np.diff(solution.z) < WORTH * h)) - 1)]


def slopes(solution: icp.Solution, volatility: float) -> list[list[float]]:
    """The derivative of both thresholds in the cost and in the volatility."""
    dA, dq = operator(0.0, volatility, 0.0)
    derivative = solution.derivative()  # factorised once
    by = [derivative.adjoint(zbar) for _, zbar in thresholds(solution)]
    return [[-WORTH * one.psi.sum(), one.A.multiply(dA).sum() + one.q @ dq] for one in by]


truth = np.array([t for drift in DRIFTS for t, _ in thresholds(value(*TRUE, drift))])
observed = truth * (1 + ERROR * np.random.default_rng(1).standard_normal(truth.size))
path, seen = [], {}


def solutions(guess: np.ndarray) -> list[icp.Solution]:
    """One for each firm; residual and Jacobian ask for the same ones."""
    if tuple(guess) not in seen:
        seen[tuple(guess)] = [value(*guess, drift) for drift in DRIFTS]
    return seen[tuple(guess)]


def residual(guess: np.ndarray) -> np.ndarray:
    model = np.array([t for solution in solutions(guess) for t, _ in thresholds(solution)])
    return (model / observed - 1) / ERROR


def jacobian(guess: np.ndarray) -> np.ndarray:
    path.append(guess.copy())
    rows = [row for one in solutions(guess) for row in slopes(one, guess[1])]
    return np.array(rows) / (ERROR * observed[:, None])


small = 1e-6 * np.array([1.0, -2.0])
differences = residual(np.array(START) + small) - residual(np.array(START) - small)
assert np.allclose(differences, 2 * jacobian(np.array(START)) @ small, rtol=1e-5)

path.clear()
found = least_squares(residual, START, jacobian, bounds=([0.01, 0.1], [0.2, 0.5]), x_scale=(0.05, 0.3))
covariance = np.linalg.inv(found.jac.T @ found.jac)
errors = np.sqrt(covariance.diagonal())
print(f"{'':>16} {'start':>8} {'found':>8} {'error':>8} {'true':>8}")
for name, *numbers in zip(("fixed cost c", "volatility σ"), START, found.x, errors, TRUE, strict=True):
    print(f"{name:>16}" + "".join(f" {number:8.4f}" for number in numbers))
print(f"misfit per degree of freedom {2 * found.cost / (truth.size - 2):.2f}, after {len(path)} Jacobians")

asked = [solution.derivative() for guess in path for solution in solutions(guess)]
told = {one.reason for one in asked}
print(f"\nThe derivative was certain in {sum(one.certain for one in asked)} of {len(asked)} solutions on the path:")
print("; ".join(sorted(told)) + ".")

# found by bisection: the cost at which two neighbouring rows are equally good to pay down to
solution = value(0.05616791923759763, TRUE[1], 0.5)
kink, zbar = solution.derivative(), thresholds(solution)[0][1]
print(f"At c = 0.0561679..., with a drift of 0.5, it is not: {kink.reason}.")
left, right = (zbar @ dz for dz in kink.one_sided(dpsi=WORTH))  # gains fall where c rises
print(f"There dx*/dc is {-left:.4f} to the left and {-right:.4f} to the right.")

# the same firm at costs so near to each other that one row more pays now and then
costs, one = np.linspace(0.05, 0.058, 41), None
by_rows, by_slopes = [], []
for cost in costs:
    one = value(cost, TRUE[1], DRIFTS[3], one)
    by_rows.append(x[np.argmax(one.p > one.r)])
    by_slopes.append(thresholds(one)[0][0])

figure, (reading, firms, plane) = plt.subplots(1, 3, figsize=(13, 4.2), layout="constrained")
reading.step(costs, by_rows, where="mid", color="#D55E00", label="first row that pays")
reading.plot(costs, by_slopes, color="#0072B2", label="where the slope is 1/(1 + tax)")
tangent = by_slopes[0] + slopes(value(costs[0], TRUE[1], DRIFTS[3]), TRUE[1])[0][0] * (costs - costs[0])
reading.plot(costs, tangent, ":", color="black", label="its tangent at the left, by the adjoint")
reading.set_xlabel("fixed cost c")
reading.set_ylabel("reserve at which dividends are paid")
reading.set_title("A threshold to fit, and one that is not")
reading.legend(frameon=False, fontsize=9)

several = np.linspace(DRIFTS[0], DRIFTS[-1], 11)
curve = lambda guess: np.array([[t for t, _ in thresholds(value(*guess, drift))] for drift in several])  # noqa: E731
for guess, line, colour, words in ((START, "--", "0.6", "start"), (found.x, "-", "#0072B2", "fitted")):
    firms.plot(several, curve(guess), line, color=colour, label=[words, None])
bars = {"yerr": ERROR * observed[0::2], "fmt": "o", "color": "black", "markersize": 4, "capsize": 3}
firms.errorbar(DRIFTS, observed[0::2], **bars, label="observed")
firms.errorbar(DRIFTS, observed[1::2], **(bars | {"yerr": ERROR * observed[1::2]}))
firms.annotate("pay from here", (0.45, 0.9), ha="center")
firms.annotate("down to here", (0.45, 0.52), ha="center")
firms.set_xlabel("drift μ of the firm, a year")
firms.set_ylabel("reserve")
firms.set_title("Six firms, one cost, one volatility")
firms.legend(frameon=False, fontsize=9, loc="center right")

turns = np.linspace(0, 2 * np.pi, 200)
circle = np.linalg.cholesky(covariance) @ np.array([np.cos(turns), np.sin(turns)])
for ax, deviations in ((plane, (2,)), (inset := plane.inset_axes((0.14, 0.08, 0.4, 0.4)), (1, 2))):
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
