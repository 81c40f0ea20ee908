r"""When does a block on a slope slip, how fast, and which impulse holds it?

Coulomb's friction is bounded by the normal impulse, which is itself unknown: an obstacle that moves with the solution.

Run: python examples/friction_block.py        writes friction_block.png and friction_block.svg into the current folder
"""

# %%
# ## The model
#
# A block of mass $m$ starts from rest on a slope of angle $\alpha$. In one time step $\Delta t$ the slope gives it two
# impulses, $z = (\lambda_n, \lambda_t)$: $\lambda_n$ off the slope and $\lambda_t$ downhill. Friction, which
# holds it, is negative. What comes of them and of gravity is its velocity $p$, off the slope and downhill:
#
# $$p = \frac{1}{m}\, z + g\,\Delta t \begin{pmatrix} -\cos\alpha \\ \sin\alpha \end{pmatrix}.$$
#
# The slope pushes only while they touch, $\lambda_n \ge 0$ and $p_1 \ge 0$, one of them 0. Friction is at most `MU`
# times the normal impulse, and reaches that bound where the block slips: $\lambda_t \ge -\mu\lambda_n$ and
# $p_2 \ge 0$, one of them with equality. Together
#
# $$p \ge 0, \qquad r = z - \psi(z) \ge 0, \qquad p^T r = 0, \qquad \psi(z) = (0,\ -\mu z_1).$$

import matplotlib.pyplot as plt
import numpy as np

import icpmodel as icp

MU = 0.3  # the coefficient of friction, 0.05 to 1
m, g, dt = 1.0, 9.81, 0.1  # kg, m/s², s


def step(angle: float, mu: float = MU, m: float = m, dt: float = dt) -> icp.Solution:
    """One time step from rest on a slope of `angle` degrees."""
    slope = np.deg2rad(angle)
    q = (
        g * dt * np.array([-np.cos(slope), np.sin(slope)])
    )  # what gravity alone would do
    return icp.ICP(np.eye(2) / m, q, icp.Affine([[0.0, 0.0], [-mu, 0.0]])).solve(
        rtol=1e-12
    )


# %%
# ## What is seen
#
# On the gentle slope nothing moves: friction is just what gravity asks. On the steep one friction is at its bound.

for angle in (10.0, 30.0):
    solution = step(angle)
    print(
        f"{angle:.0f} degrees: impulses {solution.z.round(4)} N s, velocities "
        f"{solution.p.round(4) + 0.0} m/s"
    )

# %%
# Over all angles: the block slips where $\tan\alpha > \mu$, and then with the speed
# $g\,\Delta t(\sin\alpha - \mu\cos\alpha)$, which the code compares with what was solved for.

angles = np.linspace(0.0, 45.0, 181)
speed = np.array([step(angle).p[1] for angle in angles])
by_hand = g * dt * (np.sin(np.deg2rad(angles)) - MU * np.cos(np.deg2rad(angles)))
print(
    "largest difference from the formula: "
    f"{np.abs(speed - np.maximum(by_hand, 0.0)).max():.0e} m/s"
)
assert np.abs(speed - np.maximum(by_hand, 0.0)).max() <= 1e-12, (
    "the speed is that of the formula"
)

figure, (speeds, impulses) = plt.subplots(1, 2, figsize=(9, 3.9), layout="constrained")
for mu, colour, line in (
    (0.1, "#0072B2", "-"),
    (0.3, "#D55E00", "--"),
    (0.6, "#009E73", "-."),
):
    speeds.plot(
        angles,
        [step(angle, mu).p[1] for angle in angles],
        line,
        color=colour,
        label=f"μ = {mu}",
    )
speeds.set_xlabel("angle of the slope, degrees")
speeds.set_ylabel(f"slip speed after {dt} s, m/s")
speeds.set_title("The block slips where tan α > μ")
speeds.legend(frameon=False)

normal, friction = np.array([step(angle).z for angle in angles]).T
impulses.plot(angles, normal, color="#0072B2", label="normal impulse λₙ")
impulses.plot(angles, -friction, color="#D55E00", label="friction, uphill")
impulses.plot(angles, MU * normal, ":", color="black", label="bound of friction μλₙ")
impulses.axvline(np.rad2deg(np.arctan(MU)), ymax=0.8, color="0.6", linewidth=1)
impulses.annotate("sticks ", (np.rad2deg(np.arctan(MU)), 0.6), ha="right")
impulses.annotate(" slips", (np.rad2deg(np.arctan(MU)), 0.6), ha="left")
impulses.set_ylim(0, 1.35)
impulses.set_xlabel("angle of the slope, degrees")
impulses.set_ylabel("impulse in one time step, N s")
impulses.set_title(f"Impulses for μ = {MU}")
impulses.legend(frameon=False, loc="upper center", ncols=2, fontsize=9)
for suffix in ("png", "svg"):
    figure.savefig(f"friction_block.{suffix}", dpi=150)

# %%
# ## Vary one thing
#
# `MU`, the coefficient of friction. The first angle of a quarter of a degree at which the block slips is the first one
# above $\arctan\mu$.

print(
    f"{'friction coefficient':>21} {'slips from':>12} {'arctan mu':>11} "
    f"{'speed at 45 deg':>16}"
)
for mu in sorted({0.1, 0.3, 0.6, MU}):
    slip = np.array([step(angle, mu).p[1] for angle in angles])
    first = angles[np.argmax(slip > 1e-9)]
    print(
        f"{mu:21.1f} {first:8.2f} deg {np.rad2deg(np.arctan(mu)):7.2f} deg "
        f"{slip[-1]:12.4f} m/s"
    )

# %%
# ## Exercises
#
# **1.** Does a block of 10 kg slip earlier than one of 1 kg? Does it slip faster?
#
# Answer: Neither. Both impulses grow with $m$, and the velocities do not: $z/m$ solves a problem without $m$.

light, heavy = step(30.0, m=1.0), step(30.0, m=10.0)
print(
    f"1 kg: {light.z.round(4)} N s, {light.p[1]:.4f} m/s;   10 kg: "
    f"{heavy.z.round(4)} N s, {heavy.p[1]:.4f} m/s"
)
assert np.allclose(heavy.z, 10 * light.z), (
    "ten times the weight has ten times the forces"
)
assert np.allclose(heavy.p, light.p), "and the same velocities"

# %%
# **2.** At $\tan\alpha = \mu$ exactly, what are $p_2$ and $r_2 = \lambda_t + \mu\lambda_n$? What does a certificate say
# of a row in which both are 0?
#
# Answer: Both are 0: friction is at its bound, and the block still rests. The row is *degenerate*. A certificate proves
# on which side of its obstacle a row lies where an error that is not excluded cannot change it. Here it can, and the
# row is counted as undecided.

edge = step(np.rad2deg(np.arctan(MU)))
print(f"p_2 = {edge.p[1]:.1e}, r_2 = {edge.r[1]:.1e}; rows: {edge.active_set}")
assert max(abs(edge.p[1]), abs(edge.r[1])) < 1e-12, (
    "friction is at its bound, and the block rests"
)

# %%
# **3.** Written as $\psi(z) = (0, -\mu z_1)$, friction is an obstacle with $G = \mu$ below the diagonal. How large may
# $\mu$ be for a certificate that the answer is the only one?
#
# Answer: As large as it likes, here: $A$ is diagonal, and $(I - G)v > 0$ has the solution $v = (1, 2\mu)$ whatever
# $\mu$ is. Normal impulse moves the bound of friction, and friction does not move the normal impulse back. With a wheel
# or a lever that couples both, $A$ is full, and for a large $\mu$ the answer need not be unique.

for mu in (0.3, 3.0, 30.0):
    print(f"mu = {mu:4.1f}: the only solution: {step(30.0, mu).certificate.unique}")
    assert step(30.0, mu).certificate.unique, (
        "it is proved that there is no other solution"
    )
