r"""What is a complementarity problem, and how does one know that an answer is right?

Two unknowns that one can draw; then everything that the package says of an answer.

Run: python examples/first_problem.py         writes first_problem.png and first_problem.svg into the current folder
"""

# %%
# ## The model
#
# Two unknowns may not fall below bounds that move with the other one:
#
# $$z_1 \ge \psi_1(z) = c\,z_2 + 1, \qquad z_2 \ge \psi_2(z) = c\,z_1 - 3, \qquad c = \frac{1}{2}.$$
#
# A force acts on each of them, $p = Az + q \ge 0$, and it acts only where its bound is touched. With the distance from
# the bound, $r = z - \psi(z) \ge 0$, that is
#
# $$p \ge 0, \qquad r \ge 0, \qquad p_1 r_1 = p_2 r_2 = 0, \qquad
#   A = \begin{pmatrix} 2 & -1 \\ -1 & 2 \end{pmatrix}, \qquad q = \begin{pmatrix} 1 \\ -2 \end{pmatrix}.$$
#
# Each unknown has two cases, touching or free. In each of the $2 \cdot 2$ combinations $z$ follows from two linear
# equations; the problem is to know which combination is right. Below, $c$ is `COUPLING`.

import itertools

import matplotlib.pyplot as plt
import numpy as np

import icpmodel as icp

COUPLING = 0.5  # 0 to 1.1; beyond it there may be no solution
A = np.array([[2.0, -1.0], [-1.0, 2.0]])
q = np.array([1.0, -2.0])


def bound(c: float) -> icp.Affine:
    """psi(z) = Gz + (1, -3)"""
    return icp.Affine(G=[[0.0, c], [c, 0.0]], c=[1.0, -3.0])


problem = icp.ICP(A, q, bound(COUPLING))

# %%
# ## What is seen
#
# The answer comes with what is known of it: the residual, how far $z$ can be from a solution, whether there is another
# solution, and which of the two cases is proved for each row.

solution = problem.solve(rtol=1e-12, raise_on_failure=False)
print(solution)
print()
print("z =", solution.z.round(9))
print("p =", solution.p.round(9), " (force: only where the bound is touched)")
print("r =", solution.r.round(9), " (distance from the bound)")

# %%
# In the plane: $z$ has to lie right of the blue bound and above the orange one, drawn solid, and on the side of the
# dashed lines where the forces are not negative. Of the points where a blue line crosses an orange one, one has that.

figure, axes = plt.subplots(figsize=(5.6, 4.6), layout="constrained")
grid = np.linspace(-1.5, 5.0, 301)
z1, z2 = np.meshgrid(grid, grid)
both = np.moveaxis(np.array([z1, z2]), 0, -1)
force, distance = (
    both @ A.T + q,
    both - both @ bound(COUPLING).G.toarray().T - [1.0, -3.0],
)
allowed = (np.minimum(force, distance) >= 0).all(axis=-1)
axes.contourf(z1, z2, allowed.astype(float), levels=[0.5, 1.5], colors=["0.88"])
for i, colour in enumerate(("#0072B2", "#D55E00")):
    axes.contour(z1, z2, distance[..., i], levels=[0], colors=[colour], linewidths=2)
    axes.contour(z1, z2, force[..., i], levels=[0], colors=[colour], linestyles="--")
    axes.plot([], [], color=colour, linewidth=2, label=f"$r_{i + 1} = 0$: at its bound")
    axes.plot([], [], "--", color=colour, label=f"$p_{i + 1} = 0$: no force")
if solution.solved:
    axes.plot(*solution.z, "o", color="black", markersize=8, label="the solution")
axes.annotate("p, r ≥ 0", (3.2, 2.9), ha="center")
axes.set_xlabel("$z_1$")
axes.set_ylabel("$z_2$")
crossings = "One crossing has" if solution.solved else "No crossing has"
axes.set_title(f"{crossings} p, r ≥ 0 and p'r = 0")
axes.legend(frameon=False, fontsize=9, loc="upper left")
for suffix in ("png", "svg"):
    figure.savefig(f"first_problem.{suffix}", dpi=150)

# %%
# A second opinion: independent solvers are given the problem, and one judge looks at all answers.

report = problem.crosscheck(solution, ["osqp", "cvxpy-highs"])
print(report)
assert report.agrees is solution.solved, "other solvers agree where there is a solution"

# %%
# ## Vary one thing
#
# `COUPLING`. The larger it is, the higher both push each other. The proof that there is no other solution needs some
# $v > 0$ with $(I - |G|)v > 0$, which there is as long as $c < 1$.

print(f"{'c':>5} {'z1':>8} {'z2':>8} {'force p1':>9}  the only solution")
for c in sorted({0.0, 0.25, 0.5, 0.75, 0.95, COUPLING}):
    one = icp.ICP(A, q, bound(c)).solve(rtol=1e-12, raise_on_failure=False)
    if not one.solved:
        print(f"{c:5.2f} {one.status.value}")
        continue
    print(
        f"{c:5.2f} {one.z[0]:8.4f} {one.z[1]:8.4f} {one.p[0]:9.4f}  "
        f"{one.certificate.unique}"
    )

# %%
# ## Exercises
#
# **1.** For $c = 1.1$ go through all four combinations. How many solutions are there? Is it right that nothing is
# certified beyond $c = 1$?
#
# Answer: Two, so that no certificate of uniqueness can exist. With two unknowns one can try every combination; with
# $n$ there are $2^n$.


def all_solutions(c: float) -> list[np.ndarray]:
    """Per row, the equation of its force or of its distance; kept where p, r >= 0."""
    problem, G, found = icp.ICP(A, q, bound(c)), np.array([[0.0, c], [c, 0.0]]), []
    for touches in itertools.product([False, True], repeat=2):
        rows = np.where(np.array(touches)[:, None], np.eye(2) - G, A)
        z = np.linalg.solve(rows, np.where(touches, [1.0, -3.0], -q))
        if min(problem.p(z).min(), problem.r(z).min()) >= -1e-12:
            found.append(z)
    return found


for z in all_solutions(1.1):
    print(f"z = {z.round(4)}, residual {icp.ICP(A, q, bound(1.1)).residual(z):.0e}")
assert len(all_solutions(1.1)) == 2, "there are two solutions at c = 1.1"
assert len(all_solutions(0.5)) == 1, "there is one solution at c = 0.5"

# %%
# **2.** And for $c = 1.5$? What does `solve` say then?
#
# Answer: No combination works: both bounds rise faster than the unknowns can follow. `solve` does not call anything
# solved; its message says what was tried.

print("solutions:", all_solutions(1.5))
failed = icp.ICP(A, q, bound(1.5)).solve(raise_on_failure=False)
print(f"{failed.status.value}; solved: {failed.solved}")
assert not all_solutions(1.5), "there is no solution at c = 1.5"
assert not failed.solved, "and solve() does not claim one"

# %%
# **3.** Give $\psi(z) = 0.3\sin z$ as a bare function, `psi=lambda z: 0.3 * np.sin(z)`. It is solved, but nothing is
# certified. What does the package not know, and how is it told?
#
# Answer: How fast $\psi$ can change. A function can be evaluated, and no number of evaluations bounds its slope. With
# `icp.Elementwise` and `lipschitz=0.3` the same answer is certified, given that this is true.

told = icp.Elementwise(
    lambda z: 0.3 * np.sin(z), lambda z: 0.3 * np.cos(z), lipschitz=0.3
)
for words, psi in (("bare", lambda z: 0.3 * np.sin(z)), ("told", told)):
    one = icp.ICP(A, q, psi).solve()
    print(f"{words}: z = {one.z.round(6)}, the only solution: {one.certificate.unique}")
