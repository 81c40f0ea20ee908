"""Learn a coefficient of friction from the track of a block that sticks and slips on a shaken slope.

In one step of time dt, in the frame of the slope, z = (impulse off the slope, impulse of friction) and p = (velocity
off the slope, velocity downhill): with a the acceleration of the slope and v the velocity before,

    p = z/m + (-g cos α dt,  v + (g sin α - a) dt),    0 <= z_1,    -μ z_1 <= z_2 <= μ z_1,    z_2 = -μ z_1 if p_2 > 0,

and the other bound if it slips uphill; it sticks, p_2 = 0, while friction can hold it. μ is in both obstacles. It
teaches: a motion is a chain of problems, and its derivative a chain of derivatives: `forward` takes what the step
before changes, dq = (0, dv), and what μ changes here, the slopes of both obstacles, and gives dz, hence the next dv.
Nobody has to say which steps stick and which slip, though that changes with μ.

To vary: START. From 0.8 nothing is learned: friction so high holds the block all the time, as a slightly smaller one
does, so that the derivative is 0. It is certain, and no error of the method: a block that does not slip shows no μ.

Run: python examples/learn_friction.py        writes learn_friction.png and learn_friction.svg into the current folder
"""

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import least_squares

import icpmodel as icp

TRUE, START, NOISE = 0.3, 0.1, 0.003  # the noise of a measured place in m
mass, g, dt, alpha = 1.0, 9.81, 0.025, np.deg2rad(4.0)  # kg, m/s^2, s
times = dt * np.arange(1, 121)
shaking = 2.2 * times * np.sin(2 * np.pi * times)  # m/s^2, growing
G = np.array([[0.0, 0.0], [1.0, 0.0]])
certain = {}


def motion(mu: float, ask: bool = False) -> np.ndarray:
    """The velocity, the place and their derivatives in mu after each step, shape (4, steps)."""
    v = dv = 0.0
    track = []
    for a in shaking:
        q = [-g * np.cos(alpha) * dt, v + (g * np.sin(alpha) - a) * dt]
        below, above = icp.Affine(-mu * G), icp.Affine(mu * G, [np.inf, 0.0])
        solution = icp.ICP(np.eye(2) / mass, q, below, upper=above).solve(rtol=1e-12)
        derivative = solution.derivative()
        dz = derivative.forward(dq=[0.0, dv], dpsi=(-G, [0.0, 0.0]), dupper=(G, [0.0, 0.0]))
        v, dv = solution.p[1], dz[1] / mass + dv
        track.append((v, dv))
        if ask:
            certain.setdefault(mu, []).append(derivative.certain)
    velocity, change = np.array(track).T
    return np.array([velocity, dt * np.cumsum(velocity), change, dt * np.cumsum(change)])


measured = motion(TRUE)[1] + NOISE * np.random.default_rng(0).standard_normal(times.size)
motions = {}


def at(mu: float) -> np.ndarray:
    """Residual and Jacobian ask for the same motion."""
    if mu not in motions:
        motions[mu] = motion(mu, ask=True)
    return motions[mu]


step = 1e-6
assert np.allclose((motion(START + step)[1] - motion(START - step)[1]) / (2 * step), at(START)[3], rtol=1e-5, atol=1e-8)
found = least_squares(
    lambda mu: (at(mu[0])[1] - measured) / NOISE, START, lambda mu: at(mu[0])[3][:, None] / NOISE, bounds=(0.0, 2.0)
)
mu, error = found.x[0], 1 / np.linalg.norm(found.jac)
fit = at(mu)
slips = np.abs(fit[0]) > 1e-9
print(f"friction coefficient {mu:.4f} ± {error:.4f}, true {TRUE}, after {found.nfev} motions from {START}")
print(f"misfit per degree of freedom {2 * found.cost / (times.size - 1):.2f}")
print(f"the block slips in {slips.sum()} of {slips.size} steps, downhill in {np.sum(fit[0] > 1e-9)} of these")
asked = [one for steps in certain.values() for one in steps]
print(f"\nThe derivative was certain in {sum(asked)} of {len(asked)} steps of {len(certain)} motions on the way.")
held = at(0.8)
print(
    f"With μ = 0.8 the block slips in {np.sum(np.abs(held[0]) > 1e-9)} steps, and the derivative is 0 everywhere",
    end="",
)
print(f": {not held[3].any()}, certain: {all(certain[0.8])}.")

figure, (track, valley) = plt.subplots(1, 2, figsize=(11, 4.2), layout="constrained")
track.plot(times, 100 * motion(START)[1], "--", color="0.6", label=f"at the start, μ = {START}")
track.plot(times, 100 * measured, ".", color="black", markersize=4, label="measured")
track.plot(times, 100 * fit[1], color="#0072B2", label=f"fitted, μ = {mu:.3f}")
for sign, colour, words in ((1, "#D55E00", "slips downhill"), (-1, "#009E73", "slips uphill")):
    there = sign * fit[0] > 1e-9
    track.fill_between(
        times,
        0,
        1,
        there,
        step="pre",
        transform=track.get_xaxis_transform(),
        color=colour,
        alpha=0.2,
        linewidth=0,
        label=words,
    )
track.set_ylim(100 * measured.min() - 2, 100 * measured.max() + 12)
track.set_xlabel("time, s")
track.set_ylabel("place on the slope, downhill, cm")
track.set_title("It sticks, slips, and creeps downhill")
track.legend(frameon=False, fontsize=9, loc="upper left", ncols=2)


def value(mu: float) -> tuple[float, float]:
    """The misfit per measurement and its slope."""
    track = at(mu) if mu in motions else motion(mu)
    error = (track[1] - measured) / NOISE
    return error @ error / times.size, 2 * error @ track[3] / NOISE / times.size


several = np.unique([0.05, 0.28, 0.31, 0.33, *np.linspace(0.35, 0.65, 7), 0.85, *motions])
valley.semilogy(several, [value(one)[0] for one in several], color="#0072B2")
for one in [*motions]:
    height, slope = value(one)
    across = 0.03 * np.array([-1, 1]) / np.hypot(1, 0.08 * slope / height)
    valley.plot(one + across, height * np.exp(slope / height * across), color="#D55E00", linewidth=2)
    valley.plot(one, height, "o", color="#D55E00", markersize=4)
valley.plot([], [], "o-", color="#D55E00", markersize=4, label="slopes by the derivative")
valley.annotate("never slips:\nnothing is learned", (0.75, 2 * value(0.8)[0]), ha="center")
valley.set_xlabel("coefficient of friction μ")
valley.set_ylabel("misfit / noise², per measurement")
valley.set_title("The misfit, and its slope")
valley.legend(frameon=False, loc="lower right")
for suffix in ("png", "svg"):
    figure.savefig(f"learn_friction.{suffix}", dpi=150)
