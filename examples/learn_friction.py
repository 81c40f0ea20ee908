r"""Can a coefficient of friction be learned from the track of a block that sticks and slips?

A motion is a chain of complementarity problems, and its derivative a chain of derivatives. Nobody has to say which
steps stick and which slip, though that changes with the coefficient.

Run: python examples/learn_friction.py        writes learn_friction.png and learn_friction.svg into the current folder
"""

# %%
# ## The model
#
# A block lies on a gentle slope that is shaken along itself with the acceleration $a(t)$. In one step of time
# $\Delta t$, in the frame of the slope, $z = (\lambda_n, \lambda_t)$ are the impulses off the slope and along it.
# $p$ are the velocities off it and downhill. With the velocity $v$ before,
#
# $$p = \frac{1}{m} z + \begin{pmatrix} -g\cos\alpha\,\Delta t \\ v + (g\sin\alpha - a)\,\Delta t \end{pmatrix}, \qquad
#   0 \le \lambda_n \perp p_1 \ge 0, \qquad -\mu\lambda_n \le \lambda_t \le \mu\lambda_n .$$
#
# Friction is at its lower bound, $\lambda_t = -\mu\lambda_n$, if the block slips downhill, $p_2 > 0$, and at the upper
# one if it slips uphill. It sticks, $p_2 = 0$, while friction can hold it. So $\mu$ is in both obstacles. The place of
# the block is measured after each step, with noise; wanted is the $\mu$ for which
#
# $$\sum_k \left(\frac{x_k(\mu) - x_k^{\text{measured}}}{\text{noise}}\right)^2$$
#
# is least. For that one needs $dx_k/d\mu$. `forward` takes what the step before changes, $dq = (0, dv)$, and what $\mu$
# changes here, the slopes of both obstacles. It gives $dz$, hence the next $dv$. The search begins at `START`.

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import least_squares

import icpmodel as icp

START = 0.1  # 0.05 to 0.7
TRUE, NOISE = 0.3, 0.003  # the noise of a measured place in m
m, g, dt, alpha = 1.0, 9.81, 0.05, np.deg2rad(4.0)  # kg, m/s², s
times = dt * np.arange(1, 61)
shaking = 2.2 * times * np.sin(2 * np.pi * times)  # m/s², growing
G = np.array([[0.0, 0.0], [1.0, 0.0]])
known = {}


def motion(mu: float) -> dict:
    """Velocity, place, and the derivative of the place in mu after each step."""
    if mu not in known:
        v = dv = 0.0
        track, derivatives = [], []
        for a in shaking:
            q = [-g * np.cos(alpha) * dt, v + (g * np.sin(alpha) - a) * dt]
            below, above = icp.Affine(-mu * G), icp.Affine(mu * G, [np.inf, 0.0])
            solution = icp.ICP(np.eye(2) / m, q, below, upper=above).solve(rtol=1e-12)
            derivative = solution.derivative()
            dz = derivative.forward(
                dq=[0.0, dv], dpsi=(-G, [0.0, 0.0]), dupper=(G, [0.0, 0.0])
            )
            v, dv = solution.p[1], dz[1] / m + dv
            track.append((v, dv))
            derivatives.append(derivative)
        velocity, change = np.array(track).T
        place, slope = dt * np.cumsum(velocity), dt * np.cumsum(change)
        known[mu] = {
            "velocity": velocity,
            "place": place,
            "slope": slope,
            "derivatives": derivatives,
        }
    return known[mu]


def certain(mu: float) -> int:
    """The number of steps in which the derivative is."""
    return sum(derivative.certain for derivative in motion(mu)["derivatives"])


measured = motion(TRUE)["place"] + NOISE * np.random.default_rng(0).standard_normal(
    times.size
)


def residual(mu: np.ndarray) -> np.ndarray:
    return (motion(mu[0])["place"] - measured) / NOISE


def jacobian(mu: np.ndarray) -> np.ndarray:
    return motion(mu[0])["slope"][:, None] / NOISE


# %%
# ## What is seen
#
# A few motions are enough. The derivative is *certain* where it is proved of every row on which side of its obstacles
# it is.

found = least_squares(residual, START, jacobian, bounds=(0.0, 2.0))
mu, error = found.x[0], 1 / np.linalg.norm(found.jac)
fit = motion(mu)
slips = np.abs(fit["velocity"]) > 1e-9
downhill = np.sum(fit["velocity"] > 1e-9)
print(
    f"friction coefficient {mu:.4f} ± {error:.4f}, true {TRUE}, after {found.nfev} "
    f"motions from {START}"
)
print(f"misfit per degree of freedom {2 * found.cost / (times.size - 1):.2f}")
print(
    f"the block slips in {slips.sum()} of {slips.size} steps, downhill in "
    f"{downhill} of these"
)
print(f"the derivative is certain in {certain(mu)} of {slips.size} steps")

# %%
# Left the track; right what is made least, and its slope at some $\mu$ by the derivative.


def misfit(mu: float) -> tuple[float, float]:
    """Per measurement, and its slope."""
    error, slope = residual(np.array([mu])), jacobian(np.array([mu]))[:, 0]
    return error @ error / times.size, 2 * error @ slope / times.size


figure, (track, valley) = plt.subplots(1, 2, figsize=(11, 4.2), layout="constrained")
label = f"at the start, μ = {START}"
track.plot(times, 100 * motion(START)["place"], "--", color="0.6", label=label)
track.plot(times, 100 * measured, ".", color="black", markersize=4, label="measured")
track.plot(times, 100 * fit["place"], color="#0072B2", label=f"fitted, μ = {mu:.3f}")
bands = {
    "step": "pre",
    "transform": track.get_xaxis_transform(),
    "alpha": 0.2,
    "linewidth": 0,
}
for sign, colour, words in (
    (1, "#D55E00", "slips downhill"),
    (-1, "#009E73", "slips uphill"),
):
    there = sign * fit["velocity"] > 1e-9
    track.fill_between(times, 0, 1, there, color=colour, label=words, **bands)
track.set_ylim(100 * measured.min() - 2, 100 * measured.max() + 12)
track.set_xlabel("time, s")
track.set_ylabel("place on the slope, downhill, cm")
track.set_title("It sticks, slips, and creeps downhill")
track.legend(frameon=False, fontsize=9, loc="upper left", ncols=2)

shown = (0.1, 0.2, 0.25, 0.4, 0.5, 0.6, 0.8)
several = np.unique(
    [0.05, 0.28, mu, 0.31, 0.33, 0.36, 0.45, 0.55, 0.65, 0.7, 0.85, *shown]
)
valley.semilogy(several, [misfit(one)[0] for one in several], color="#0072B2")
for one in shown:
    height, slope = misfit(one)
    across = 0.03 * np.array([-1, 1]) / np.hypot(1, 0.08 * slope / height)
    valley.plot(
        one + across,
        height * np.exp(slope / height * across),
        color="#D55E00",
        linewidth=2,
    )
    valley.plot(one, height, "o", color="#D55E00", markersize=4)
valley.plot(
    [], [], "o-", color="#D55E00", markersize=4, label="slopes by the derivative"
)
valley.annotate(
    "never slips:\nnothing is learned",
    (0.75, 0.3 * misfit(0.8)[0]),
    ha="center",
    va="top",
)
valley.set_xlabel("coefficient of friction μ")
valley.set_ylabel("misfit / noise², per measurement")
valley.set_title("The misfit, and its slope")
valley.legend(frameon=False, loc="lower right")
for suffix in ("png", "svg"):
    figure.savefig(f"learn_friction.{suffix}", dpi=150)

# %%
# ## Vary one thing
#
# `START`. From 0.8 nothing is learned: friction so high holds the block all the time, as a slightly smaller one does,
# so that the derivative is 0. It is certain, and no error of the method: a block that does not slip shows no $\mu$.

print(
    f"{'start':>6} {'slips at first in':>18} {'slope of the misfit':>20} {'found':>8}"
)
for start in sorted({0.1, 0.5, 0.8, START}):
    at = motion(start)
    end = least_squares(residual, start, jacobian, bounds=(0.0, 2.0)).x[0]
    moves = np.sum(np.abs(at["velocity"]) > 1e-9)
    print(f"{start:6.2f} {moves:12d} steps {misfit(start)[1]:20.1f} {end:8.4f}")
print(f"at 0.8 the derivative is certain in {certain(0.8)} of {times.size} steps")

# %%
# ## Exercises
#
# **1.** Check the derivative of the last place in $\mu$ by a difference. How large a step is best?
#
# Answer: Neither a large one, over which the motion bends, nor a tiny one, over which it changes by no more than
# rounding. The derivative has no step to choose.

exact = motion(TRUE)["slope"][-1]
for step in (1e-2, 1e-5, 1e-12):
    difference = (
        motion(TRUE + step)["place"][-1] - motion(TRUE - step)["place"][-1]
    ) / (2 * step)
    print(f"step {step:.0e}: difference {difference:.6f}, derivative {exact:.6f}")
    if step == 1e-5:
        assert np.isclose(difference, exact, rtol=1e-5), (
            "differences give the same derivative"
        )

# %%
# **2.** What does the $\pm$ of the answer mean? Measure 1000 times again, and take for the answer of each the linear
# one, $\mu + J^T e / J^T J$.
#
# Answer: It is the standard deviation of the answers, $1/\sqrt{J^TJ}$, and that is what they scatter by.

J = jacobian(np.array([TRUE]))[:, 0]
noise = np.random.default_rng(1).standard_normal((1000, J.size))
scatter = np.std(noise @ J / (J @ J))
print(f"predicted {1 / np.sqrt(J @ J):.5f}, scatter of 1000 answers {scatter:.5f}")
assert abs(scatter * np.sqrt(J @ J) - 1) < 0.1, "the formula predicts the scatter"

# %%
# **3.** One may film only one second of the three. Which one?
#
# Answer: The last. In the first second the block does not slip, and shows nothing of $\mu$; a slip shows in all places
# after it.

for begin in (0, 1, 2):
    rows = (times > begin + dt / 2) & (times < begin + 1 + dt / 2)
    size = np.linalg.norm(J[rows])
    print(
        f"second {begin + 1}: slips in "
        f"{np.sum(np.abs(motion(TRUE)['velocity'][rows]) > 1e-9)} steps",
        end="; ",
    )
    print(f"error {1 / size:.4f}" if size > 0 else "nothing is learned")
assert np.linalg.norm(J[times <= 1]) < np.linalg.norm(J[times > 2]), (
    "the last second says more than the first"
)
