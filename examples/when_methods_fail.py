r"""What does a method say when it fails, and what can one do then?

Five failures, smallest first. Nothing here is ever called solved that is not.

Run: python examples/when_methods_fail.py     writes when_methods_fail.png and when_methods_fail.svg here
"""

# %%
# ## The model
#
# Every method of the modulus family is one step, repeated,
#
# $$z^+ = z - 2\,(M + \Omega)^{-1} \min\left(p,\ \Omega r\right), \qquad p = Az + q, \qquad r = z - \psi(z),$$
#
# with a part $M$ of $A$ that is easy to invert and a diagonal $\Omega > 0$, the parameter $\varphi_2$ below. Whether it
# converges depends on both. In the smallest example there is one unknown, one solution $z^* = 1$, and an obstacle that
# falls steeply where $z$ rises:
#
# $$p = 0.1\,z + 1, \qquad \psi(z) = 6 - 5z, \qquad r = 6z - 6.$$
#
# Here $p > 0$ near the solution, $r$ decides, and the error is multiplied by $1 - 12\,\varphi_2/(0.1 + \varphi_2)$.
# $\varphi_2$ is `PHI2`.

import textwrap

import matplotlib.pyplot as plt
import numpy as np

import icpmodel as icp

PHI2 = 0.1  # 0.05 to 5
steep = icp.ICP([[0.1]], [1.0], icp.Affine([[-5.0]], 6.0))


def say(words: str) -> None:
    print(textwrap.fill(words, 96, initial_indent="    ", subsequent_indent="    "))


def report(
    title: str, problem: icp.ICP, method: str | None = None, **options
) -> icp.Solution:
    solution = problem.solve(method, raise_on_failure=False, **options)
    print(title)
    if solution.solved:
        say(f"{solution.method!r}: solved, residual {solution.residual:.2g}")
    else:  # which method ended how, what is best so far, and what to try
        say(solution.message)
    return solution


# %%
# ## What is seen
#
# **A condition that the literature prints and that is false.** It bounds $\varrho(D^{-1}|B| + \varphi_2 G)$, here
# $0.1 \cdot 5 = 0.5 < 1$, and promises convergence. The right number has $D^{-1}$ before both terms and is 5. The
# method cycles, and says so.

for as_printed in (True, False):
    answer = icp.theory.check("4.3", steep, icp.MNMGS(phi2=PHI2), as_printed=as_printed)
    print(f"theorem {'as printed' if as_printed else 'corrected '}: {answer}")
report(
    f"A = .1, q = 1, psi(z) = 6 - 5z, phi2 = {PHI2}",
    steep,
    "mnmgs",
    phi2=PHI2,
    z0=[56.0],
)

# %%
# **A P-matrix that is not H+.** A solution exists and is unique for every $q$, and sweeps turn in a circle. With
# $M = A$ and $\Omega = 2I$ the start decides; see the exercises.

cyclic = icp.scenes.hand_cyclic().problem
report("Gauss-Seidel", cyclic, "mnmgs")
report("M = A and Omega = 2I", cyclic, "mnmmod", theta1=2.0)

# %%
# **The choice of the splitting decides.** Jacobi takes the larger one of two couplings, that of $A$ and that of $\psi$;
# Gauss–Seidel adds them. Who names no method gets one that is chosen for the problem, with the reason.

splittings = icp.scenes.hand_splittings().problem
report("Gauss-Seidel", splittings, "mnmgs")
report("Jacobi", splittings, "mnmj")
chosen = report("no method named", splittings)
say(chosen.why)

# %%
# **No solution at all**: $-z - 1 \ge 0$ and $z \ge 0$. Pivoting proves it, and the witness can be checked by hand.

nothing = report("A = -1, q = -1, psi = 0", icp.ICP([[-1.0]], [-1.0]))

# %%
# **A tolerance below rounding** is answered with the floor, and not with success.

floor = report(
    "rtol = 0", icp.scenes.manufactured_affine(n=400).problem, "mnmgs", rtol=0.0
)

# %%
# The error of the first problem, step by step, for three values of $\varphi_2$ and one of $\varphi$, which damps. A
# cycle is a line that does not fall.

figure, axes = plt.subplots(figsize=(6.4, 4), layout="constrained")
looks = {
    "φ₂ = 0.1": ("#D55E00", "o"),
    "φ₂ = 0.02": ("#E69F00", "^"),
    "φ₂ = 0.01": ("#0072B2", "s"),
}
looks["φ₂ = 0.1, φ = 0.6"] = ("#009E73", "D")
options = ({"phi2": 0.1}, {"phi2": 0.02}, {"phi2": 0.01}, {"phi2": 0.1, "phi": 0.6})
for (label, (colour, mark)), chosen_by in zip(looks.items(), options, strict=True):
    iterates = icp.MNMGS(**chosen_by).iterates(steep, np.array([2.0]))
    errors = [abs(next(iterates)[0][0] - 1) for _ in range(25)]
    axes.semilogy(errors, marker=mark, markersize=4, color=colour, label=label)
axes.set_xlabel("step")
axes.set_ylabel("error |z − z*|")
axes.set_title("One problem, four choices")
axes.legend(frameon=False)
for suffix in ("png", "svg"):
    figure.savefig(f"when_methods_fail.{suffix}", dpi=150)

# %%
# ## Vary one thing
#
# `PHI2`. What multiplies the error near the solution; what the theorem promises, as printed and as corrected; and what
# the method does from $z = 2$. The corrected theorem never promises too much. It is sufficient and not necessary: it
# promises nothing for the smallest values, for which the method converges.

print(f"{'phi2':>6} {'factor':>8}  {'as printed':>10}  {'corrected':>9}  the method")
for phi2 in sorted({0.005, 0.01, 0.018, 0.1, 0.15, PHI2}):
    method, promises = icp.MNMGS(phi2=phi2), []
    for as_printed in (True, False):
        answer = icp.theory.check("4.3", steep, method, as_printed=as_printed)
        promises.append("converges" if answer.holds else "-")
    found = steep.solve(method, z0=[2.0], raise_on_failure=False)
    factor = 1 - 12 * phi2 / (0.1 + phi2)
    print(
        f"{phi2:6.3f} {factor:8.3f}  {promises[0]:>10}  {promises[1]:>9}  "
        f"{found.status.value}"
    )

# %%
# ## Exercises
#
# **1.** For which $\varphi_2$ does the first method converge near $z^*$? The advice is a larger $\varphi$, which is
# added to $M$: for $\varphi_2 = 0.1$, how large has it to be?
#
# Answer: $|1 - 12\varphi_2/(0.1 + \varphi + \varphi_2)| < 1$ if and only if $5\varphi_2 < 0.1 + \varphi$. For
# $\varphi = 0$ that is $\varphi_2 < 0.02$, and for $\varphi_2 = 0.1$ it is $\varphi > 0.4$.

for options in (
    {"phi2": 0.019},
    {"phi2": 0.021},
    {"phi2": 0.1, "phi": 0.42},
    {"phi2": 0.1, "phi": 0.38},
):
    found = steep.solve(icp.MNMGS(**options), z0=[1.001], raise_on_failure=False)
    converges = 5 * options["phi2"] < 0.1 + options.get("phi", 0.0)
    print(f"{options}: {found.status.value}")
    assert found.solved == converges, "the method converges where the number is below 1"

# %%
# **2.** Start $M = A$, $\Omega = 2I$ on the P-matrix from $(1, 0, 0)$ instead of 0. It does not get
# there. Which eigenvalues of $A$ are to blame?
#
# Answer: $\pm i\sqrt3$. Where $p$ decides in all rows the error is multiplied by $(\omega I + A)^{-1}(\omega I - A)$,
# and $|\omega - \lambda| = |\omega + \lambda|$ for an imaginary $\lambda$. The error is turned and never becomes
# smaller. Pivoting does not care.

for start in ([0.0, 0.0, 0.0], [1.0, 0.0, 0.0]):
    found = cyclic.solve("mnmmod", theta1=2.0, z0=start, raise_on_failure=False)
    print(f"from {start}: {found.status.value}")
A = cyclic.A.toarray()
turns = np.linalg.eigvals(np.linalg.solve(2 * np.eye(3) + A, 2 * np.eye(3) - A))
print(
    f"moduli of the eigenvalues of the step: {np.sort(np.abs(turns)).round(12)}; ",
    end="",
)
print(f"pivoting: {cyclic.solve().status.value}")
assert not found.solved, "the sweeps go round in a circle"
assert cyclic.solve().solved, "solve() finds the solution"
assert np.isclose(np.abs(turns), 1).sum() == 2, (
    "two eigenvalues of the step have the modulus 1"
)

# %%
# **3.** The witness of the problem without solution is a vector $y$ with $y \ge 0$, $A^Ty \le 0$ and $q^Ty < 0$. Why is
# that a proof?
#
# Answer: If $z \ge 0$ had $p = Az + q \ge 0$, then $0 \le y^Tp = (A^Ty)^Tz + q^Ty < 0$. Anybody can check that in a
# line, whoever found $y$.

for problem in (
    icp.ICP([[-1.0]], [-1.0]),
    icp.ICP([[1.0, -2.0], [-2.0, 1.0]], [-1.0, -1.0]),
):
    y = problem.solve("lemke", raise_on_failure=False).infeasible.witness
    print(
        f"A = {problem.A.toarray().tolist()}: y = {y}, A'y = {problem.A.T @ y}, q'y "
        f"= {problem.q @ y:g}"
    )
    assert (y >= 0).all(), "y is not negative"
    assert (problem.A.T @ y <= 0).all(), "and A'y is not positive"
    assert problem.q @ y < 0, "and q'y is negative: no z has Az + q >= 0"
