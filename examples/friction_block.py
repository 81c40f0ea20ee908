"""A block on a slope: when does it slip, how fast, and which impulse holds it? Friction as an obstacle that moves.

It teaches: Coulomb's bound on friction depends on the unknown normal impulse, friction >= -mu * normal, so that the
obstacle psi(z) = (0, -mu z_1) moves with the solution; the complementary unknown, p, is the velocity.

Run: python examples/friction_block.py        writes friction_block.png and friction_block.svg into the current folder
"""

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import icpmodel as icp

mass, g, dt = 1.0, 9.81, 0.1  # kg, m/s^2, s
angles = np.linspace(0.0, 45.0, 181)  # degrees


def step(angle: float, mu: float) -> icp.Solution:
    """One time step from rest. z: impulse off the plane, impulse downhill; p: the velocities that come of them."""
    slope = np.deg2rad(angle)
    A = np.eye(2) / mass
    q = g * dt * np.array([-np.cos(slope), np.sin(slope)])  # what gravity alone would do
    return icp.ICP(A, q, icp.Affine([[0.0, 0.0], [-mu, 0.0]])).solve(rtol=1e-12)


figure, (speeds, impulses) = plt.subplots(1, 2, figsize=(9, 3.9), layout="constrained")
print(f"{'friction coefficient':>21} {'slips from':>12} {'arctan mu':>11} {'speed at 45 deg':>16}")
for mu, colour, line in ((0.1, "#0072B2", "-"), (0.3, "#D55E00", "--"), (0.6, "#009E73", "-.")):
    slip = np.array([step(angle, mu).p[1] for angle in angles])
    first = angles[np.argmax(slip > 1e-9)]
    print(f"{mu:21.1f} {first:8.2f} deg {np.rad2deg(np.arctan(mu)):7.2f} deg {slip[-1]:12.4f} m/s")
    speeds.plot(angles, slip, line, color=colour, label=f"μ = {mu}")
    exact = g * dt * (np.sin(np.deg2rad(angles)) - mu * np.cos(np.deg2rad(angles)))
    assert np.abs(slip - np.maximum(exact, 0.0)).max() <= 1e-12

speeds.set_xlabel("angle of the slope, degrees")
speeds.set_ylabel(f"slip speed after {dt} s, m/s")
speeds.set_title("The block slips where tan α > μ")
speeds.legend(frameon=False)

mu = 0.3
normal, friction = np.array([step(angle, mu).z for angle in angles]).T
impulses.plot(angles, normal, color="#0072B2", label="normal impulse λₙ")
impulses.plot(angles, -friction, color="#D55E00", label="friction, uphill")
impulses.plot(angles, mu * normal, ":", color="black", label="bound of friction μλₙ")
impulses.axvline(np.rad2deg(np.arctan(mu)), ymax=0.8, color="0.6", linewidth=1)
impulses.annotate("sticks ", (np.rad2deg(np.arctan(mu)), 0.6), ha="right")
impulses.annotate(" slips", (np.rad2deg(np.arctan(mu)), 0.6), ha="left")
impulses.set_ylim(0, 1.35)
impulses.set_xlabel("angle of the slope, degrees")
impulses.set_ylabel("impulse in one time step, N s")
impulses.set_title(f"Impulses for μ = {mu}")
impulses.legend(frameon=False, loc="upper center", ncols=2, fontsize=9)

for suffix in ("png", "svg"):
    figure.savefig(f"friction_block.{suffix}", dpi=150)
