r"""When does a stack of boxes slide, when does it topple, and how exact is the friction of a physics engine?

Engines bound friction by a multiple of the normal impulse of the same contact: an index says of which.

Run: python examples/box_stack.py        writes box_stack.png and box_stack.svg into the current folder
"""

# %%
# ## The model
#
# A contact gives an impulse in each of its rows, $z_n \ge 0$ off the surface and $z_t$ along it. After the impulses the
# contacts have the velocities $w = Az - b$, where $A = J M^{-1} J^T$ and $b = -Jv$. $J$ maps the velocities of
# the bodies to those of the contacts. A normal row has $w_n \ge 0$ and $w_n z_n = 0$. A row of friction has its
# bounds from the normal row `findex[t]`:
#
# $$-\mu z_n \le z_t \le \mu z_n, \qquad w_t = 0 \text{ in between}, \qquad w_t z_t \le 0 \text{ at a bound}.$$
#
# The boxes have sides of 1 m and lie on each other, the lowest one on a slope. Each lies on its two lower edges, with a
# normal row and a row of friction at each.

import matplotlib.pyplot as plt
import numpy as np

import icpmodel as icp

MU = 0.5  # the coefficient of friction, 0.2 to 1
gdt = 9.81 * 0.01  # what gravity makes in one time step, m/s


def stack(masses: list[float], angle: float, mu: float = MU) -> icp.Solution:
    """One time step from rest of boxes on a slope of `angle` degrees; x is downhill."""
    rows = []
    for k in range(len(masses)):
        for x in (-0.5, 0.5):  # uphill, downhill
            for t in (np.array([0.0, 1.0]), np.array([1.0, 0.0])):
                row = np.zeros(
                    (len(masses), 3)
                )  # velocities of x, y and the angle of each box
                row[k] = [*t, x * t[1] + 0.5 * t[0]]
                if k:
                    row[k - 1] = -np.array([*t, x * t[1] - 0.5 * t[0]])
                rows.append(row.ravel())
    J = np.array(rows)
    inertia = np.array([[m, m, m / 6.0] for m in masses]).ravel()
    slope = np.deg2rad(angle)
    v = np.tile(gdt * np.array([np.sin(slope), -np.cos(slope), 0.0]), len(masses))
    contacts = 2 * len(masses)
    findex = np.array([[-1, 2 * k] for k in range(contacts)]).ravel()
    lo, hi = np.tile([0.0, -mu], contacts), np.tile([np.inf, mu], contacts)
    return icp.ICP.from_friction_index(
        J / inertia @ J.T, -J @ v, lo, hi, findex
    ).solve()


# %%
# ## What is seen
#
# Three boxes on four slopes. On the first two all stick. On the steeper ones the stack topples: its lowest uphill edge,
# whose rows are the first two, separates.

for angle in (0.0, 10.0, 20.0, 30.0):
    state = icp.contact_state(stack([1.0, 1.0, 1.0], angle))
    print(
        f"{angle:4.0f} degrees: {state}; the uphill edge lifts at "
        f"{abs(state.velocities[0]):.4f} m/s"
    )

# %%
# The contacts are redundant: twelve rows, and no more than nine velocities, so that A is singular. The impulses need
# not be unique; their sum is.

standing = stack([1.0, 1.0, 1.0], 0.0)
carried = standing.z[0] + standing.z[2]
print(
    f"rank of A: {np.linalg.matrix_rank(standing.problem.dense())} of "
    f"{standing.problem.n}"
)
print(
    f"the slope carries {carried:.4f} N s; the weight of one step is {3 * gdt:.4f} N s"
)
assert abs(carried - 3 * gdt) < 1e-9, "the slope carries the weight"

# %%
# Now one block on a level floor that moves at 1 m/s in a `direction`, in degrees from the first axis of friction.
# In three dimensions a contact has two rows of friction, each bounded by $\mu z_n$: together a *pyramid*. Coulomb's
# *cone*, $\sqrt{z_x^2 + z_y^2} \le \mu z_n$, is solved by hand for one block: friction of $\mu z_n$ against the motion.
# The *box* law has a fixed bound, $\mu$ times the weight, whatever the contact carries.


def block(direction: float, mu: float = MU, load: float = 1.0) -> icp.Solution:
    """A block of 1 kg that moves at 1 m/s, pressed down by `load` times its weight."""
    turn = np.deg2rad(direction)
    b = [load * gdt, -np.cos(turn), -np.sin(turn)]
    return icp.ICP.from_friction_index(
        np.eye(3), b, [0, -mu, -mu], [np.inf, mu, mu], [-1, 0, 0]
    ).solve()


def cone(direction: float, mu: float = MU, load: float = 1.0) -> np.ndarray:
    turn = np.deg2rad(direction)
    return -min(1.0, mu * load * gdt) * np.array([np.cos(turn), np.sin(turn)])


def box(direction: float, mu: float = MU, load: float = 1.0) -> np.ndarray:
    turn, bound = np.deg2rad(direction), mu * gdt
    q = [-load * gdt, np.cos(turn), np.sin(turn)]
    return (
        icp.ICP(np.eye(3), q, [0, -bound, -bound], upper=[np.inf, bound, bound])
        .solve()
        .z[1:]
    )


print(f"{'direction':>9} {'pyramid':>9} {'cone':>9} {'too much by':>12}")
for direction in (0.0, 15.0, 30.0, 45.0):
    found, exact = (
        np.linalg.norm(block(direction).z[1:]),
        np.linalg.norm(cone(direction)),
    )
    print(
        f"{direction:5.0f} deg {found:9.5f} {exact:9.5f} "
        f"{100 * (found / exact - 1):10.1f} %"
    )

turns = np.arange(0.5, 90.0, 1.0)
figure, (impulse, bend) = plt.subplots(1, 2, figsize=(9, 3.9), layout="constrained")
around = np.deg2rad(np.linspace(0, 360, 361))
impulse.plot(
    np.cos(around), np.sin(around), color="#0072B2", label="cone: all impulses"
)
impulse.plot(
    [1, -1, -1, 1, 1], [1, 1, -1, -1, 1], color="#D55E00", label="pyramid: all impulses"
)
for direction in (20.0, 70.0, 200.0, 290.0):
    turn = np.deg2rad(direction)
    impulse.plot([0, np.cos(turn)], [0, np.sin(turn)], color="0.6", linewidth=1)
    solution = block(direction)
    impulse.plot(
        *(solution.z[1:] / (MU * solution.z[0])), "o", color="#D55E00", markersize=6
    )
    impulse.plot(*(cone(direction) / (MU * gdt)), "s", color="#0072B2", markersize=6)
impulse.plot([], [], color="0.6", linewidth=1, label="motion")
impulse.set_aspect("equal")
impulse.set_xlim(-2.4, 2.4)
impulse.set_ylim(-1.3, 2.3)
impulse.set_xticks([-1, 0, 1])
impulse.set_yticks([-1, 0, 1])
impulse.set_xlabel("friction along the first axis / μzₙ")
impulse.set_ylabel("along the second axis / μzₙ")
impulse.set_title("Friction of a block that slides")
impulse.legend(frameon=False, loc="upper center", ncols=1, fontsize=9)
for mu, colour, line in (
    (0.2, "#009E73", "-."),
    (0.5, "#D55E00", "-"),
    (1.0, "#CC79A7", "--"),
):
    bends = [np.rad2deg(np.arctan2(*block(one, mu).p[:0:-1])) - one for one in turns]
    bend.plot(turns, bends, line, color=colour, label=f"pyramid, μ = {mu}")
bend.axhline(0, color="#0072B2", label="cone")
bend.set_xlabel("direction of the motion, degrees")
bend.set_ylabel("bent by friction in one step, degrees")
bend.set_title("The pyramid bends a straight path")
bend.legend(frameon=False, fontsize=9)
for suffix in ("png", "svg"):
    figure.savefig(f"box_stack.{suffix}", dpi=150)

# %%
# ## Vary one thing
#
# `MU`, from 0.2 to 1. A stack of three boxes slides where $\tan\alpha > \mu$, and topples where $\tan\alpha$ is above
# its width over its height, a third. The angles are those of a search in steps of a tenth of a degree.

angles = np.arange(1.0, 50.0, 0.1)
print(
    f"{'friction':>8} {'moves from':>11} {'and then':>9} {'arctan mu':>10} "
    f"{'arctan 1/3':>11}"
)
for mu in sorted({0.2, 0.3, 0.5, 1.0, MU}):
    for angle in angles:
        state = icp.contact_state(stack([1.0, 1.0, 1.0], angle, mu))
        if state.separating.any() or np.abs(state.velocities[1::2]).max() > 1e-9:
            break
    how = "topples" if state.separating.any() else "slides"
    theory = np.rad2deg(np.arctan(mu)), np.rad2deg(np.arctan(1 / 3))
    print(
        f"{mu:8.1f} {angle:7.1f} deg {how:>9} {theory[0]:6.2f} deg {theory[1]:7.2f} deg"
    )
    assert abs(angle - min(theory)) <= 0.11, "the first of the two angles decides"

# %%
# ## Exercises
#
# **1.** A box of a thousand tonnes stands on one of 1 kg. Many engines fail at such a ratio of masses. What does the
# floor carry here?
#
# Answer: The weight of both. Lemke's pivoting has no rate of convergence that a ratio of masses could spoil.

heavy = stack([1.0, 1e6], 0.0)
share = (heavy.z[0] + heavy.z[2]) / ((1.0 + 1e6) * gdt)
print(f"{heavy.status.value}: the floor carries {share:.6f} of the weight")
assert abs(share - 1.0) < 1e-6, "the floor carries all"

# %%
# **2.** The block is pressed down with twice its weight. Which law sees it?
#
# Answer: Pyramid and cone double the friction, as their bound moves with the normal impulse. The box law, which has no
# friction index, does not.

for name, law in (
    ("pyramid", lambda load: block(0.0, load=load).z[1:]),
    ("box", lambda load: box(0.0, load=load)),
):
    once, twice = np.linalg.norm(law(1.0)), np.linalg.norm(law(2.0))
    print(f"{name:>8}: {once:.5f} N s, pressed twice as hard {twice:.5f} N s")
    assert np.isclose(twice / once, 2.0 if name == "pyramid" else 1.0), (
        "only a bound that moves doubles"
    )

# %%
# **3.** The axes of friction are free to choose. How much friction does the block at 45 degrees get if the first axis
# is turned into its motion, as some engines do?
#
# Answer: As much as from the cone: the block then slides along an axis, where the pyramid is exact.

along, askew = np.linalg.norm(block(0.0).z[1:]), np.linalg.norm(block(45.0).z[1:])
print(
    f"axes turned: {along:.5f} N s; not turned: {askew:.5f} N s; cone: "
    f"{np.linalg.norm(cone(45.0)):.5f} N s"
)
assert np.isclose(along, np.linalg.norm(cone(45.0))), (
    "along an axis the pyramid is exact"
)
