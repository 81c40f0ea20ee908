r"""What is an error bound worth, and what does "solved" mean in the third digit?

A residual says how well the equations hold, an error how far the answer is from the true one. Nobody knows the error;
a bound on it can be known nevertheless, and who has one can prove which rows touch.

Run: python examples/what_a_bound_is_worth.py      writes what_a_bound_is_worth.png and .svg into the current folder
"""

# %%
# ## The model
#
# A heavy string hangs over a bump $\psi$. On a grid of `N` points, with the width $h = 1/(N + 1)$ and
# $A = \mathrm{tridiag}(-1, 2, -1)$,
#
# $$p = Az + 10\,h^2 \ge 0, \qquad r = z - \psi \ge 0, \qquad p^\top r = 0.$$
#
# How wrong may $z$ be? The residual is $\|F(z)\|_2$ with $F(z) = \min(p, r)$, row by row. Let the diagonal of $A$ be
# positive, the obstacle fixed, and $\langle A \rangle$ the matrix $A$ with all entries off the diagonal made negative.
# If $\langle A \rangle v > 0$ for some $v > 0$, then for *every* $z$, whoever found it,
#
# $$\max_i \frac{|z_i - z_i^*|}{v_i} \le \max_i \frac{|F_i(z)|}{\min((\langle A \rangle v)_i,\ v_i)}.$$

from itertools import islice

import cvxpy as cp
import matplotlib.pyplot as plt
import numpy as np
import osqp
import scipy.sparse as sp

import icpmodel as icp

N = 199  # 50 to 400
h = 1 / (N + 1)
bump = 0.25 - 8 * (h * np.arange(1, N + 1) - 0.5) ** 2
A = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(N, N))
string = icp.ICP(A, np.full(N, 10 * h**2), bump)
exact = string.solve(
    "tridiagonal"
)  # elimination, right to rounding: it plays the truth here
print(f"heights from {exact.z.min():.3f} to {exact.z.max():.3f}; {exact.active_set}")

# %%
# ## What is seen
#
# ### A residual is not an error
#
# *Ill-conditioned.* For $A = 10^{-6}$, $q = -10^{-6}$, $\psi = 0$ the answer is 1, and 2 has a residual of a millionth
# in the units of $p$.
# The bound says what it is worth, and here it is attained: no better one can be given for that residual.

soft = icp.ICP([[1e-6]], [-1e-6])
print(
    f"z = 2: residual {soft.paper_residual([2.0]):.0e}, bound on the error "
    f"{icp.error_bound(soft, [2.0]).value:.9f}"
)
assert 1 <= icp.error_bound(soft, [2.0]).value < 1 + 1e-6, (
    "no better bound can be given"
)

# %%
# *Two solutions.* For $A = -10^{-6}$, $q = 10^{-6}$, $\psi = 0$ both 0 and 1 are solutions, and everything between them
# has a residual below a millionth. No bound exists, since there is no such thing as *the* error, and none is given:

two = icp.ICP([[-1e-6]], [1e-6])
print(
    f"residuals of 0, 1/2 and 1: {[two.paper_residual([z]) for z in (0.0, 0.5, 1.0)]}"
)
print(icp.certify(two, [0.5]))

# %%
# ### What a bound says while a method works
#
# Projected SOR on the string. The bound of $z$ itself costs one product with $A$, once $v$ is known, and is ten to some
# hundred times the error. Who pays for a few linear solves more, looks for a better point near $z$, bounds *its* error
# and adds the distance (`sharp=True`): until rounding the bound then is the error, to a few hundredths.
#
# A bound $|z - z^*| \le \delta$ decides rows. If $p_i(z) > \sum_j |a_{ij}|\delta_j$, then $p_i(z^*) > 0$: row $i$
# touches the bump in the true solution, whatever it does in $z$. If $r_i(z) > \delta_i$, it hangs free.

method, wanted = (
    icp.PSOR(omega=1.9),
    (0, 25, 50, 100, 200, 300, 400, 500, 600, 700, 800),
)
rows = []
print(
    f"{'sweeps':>6} {'residual':>9} {'error':>9} {'sharp':>9} {'bound of z':>11} "
    f"{'rows proved':>12}"
)
for k, (z, _) in enumerate(
    islice(method.iterates(string, np.maximum(bump, 0.0)), wanted[-1] + 1)
):
    if k in wanted:
        plain, sharp = (
            icp.error_bound(string, z, sharp=flag) for flag in (False, True)
        )
        sets = [icp.theory.active_set(string, z, bound) for bound in (plain, sharp)]
        residual, error = string.residual(z), np.abs(z - exact.z).max()
        by_plain, by_sharp = (N - one.undecided.sum() for one in sets)
        rows.append((k, residual, error, sharp.value, plain.value, by_plain, by_sharp))
        print(
            f"{k:6d} {residual:9.1e} {error:9.1e} {sharp.value:9.1e} "
            f"{plain.value:11.1e} {by_sharp:12d}"
        )
        assert error <= sharp.value * (1 + 1e-9), "the error is within the bound"
        assert not (sets[1].active & (exact.p <= exact.r)).any(), (
            "no row that is proved to be in contact is free"
        )

# %%
# ### What "solved" means in the third digit
#
# This is a quadratic programme, too: $z$ minimises $z^\top A z / 2 + q^\top z$ over $z \ge \psi$. Solvers with their
# default settings stop at a thousandth or a hundred-thousandth of *something*, in units of their own, and say "solved".
# The heights are numbers like 0.25.

q, height = string.q, cp.Variable(N)
model = cp.Problem(
    cp.Minimize(cp.quad_form(height, cp.psd_wrap(A)) / 2 + q @ height), [height >= bump]
)
answers = {}
for name in ("Clarabel", "SCS"):
    model.solve(solver=name.upper())
    answers[f"{name} in CVXPY"] = (model.status, height.value)
engine = osqp.OSQP()
engine.setup(
    sp.csc_matrix(A),
    q,
    sp.csc_matrix(sp.eye_array(N)),
    bump,
    np.full(N, np.inf),
    verbose=False,
)
found = engine.solve(raise_error=False)
answers["OSQP itself"] = (found.info.status, found.x)

print(f"{'':>17} {'says':>8} {'residual':>9} {'error':>9} {'bound':>9}   rows proved")
for name, (says, z) in answers.items():
    bound = icp.error_bound(string, z, sharp=True)
    proved = N - icp.theory.active_set(string, z, bound).undecided.sum()
    residual, error = string.residual(z), np.abs(z - exact.z).max()
    print(
        f"{name:>17} {says:>8} {residual:9.1e} {error:9.1e} {bound.value:9.1e} "
        f"{proved:6d} of {N}"
    )

# %%
# An answer can be wrong in its second digit and "solved" all the same; only a bound tells. And a poor answer with a
# bound is worth a good deal: most of the contact set is *proved* from it.
#
# ### In a picture
#
# To the left residual, error and bounds while projected SOR works; the residual is below the error all the time. In the
# middle how many rows are proved. To the right three answers that were called solved.

BLUE, RED, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "0.45"
figure, (fall, proved, bars) = plt.subplots(
    1, 3, figsize=(10.5, 3.9), width_ratios=[1.3, 1, 1], layout="constrained"
)
k, residual, error, sharp, plain, by_plain, by_sharp = np.array(rows).T
fall.semilogy(k, plain, "^-", color=RED, markersize=5, label="bound of z itself")
fall.semilogy(
    k,
    sharp,
    "s-",
    color=GREEN,
    markersize=7,
    markerfacecolor="none",
    label="sharp bound",
)
fall.semilogy(k, error, "o-", color=BLUE, markersize=4, label="true error")
fall.semilogy(k, residual, "d-", color=GREY, markersize=4, label="residual")
fall.set(xlabel="sweeps", title="Residual, error and bounds")
fall.legend(frameon=False, fontsize=9)
proved.plot(
    k,
    by_sharp,
    "s-",
    color=GREEN,
    markersize=6,
    markerfacecolor="none",
    label="by the sharp bound",
)
proved.plot(
    k, by_plain, "^-", color=RED, markersize=5, label="by the bound of z itself"
)
proved.axhline(N, color="0.6", linewidth=1)
proved.set(xlabel="sweeps", ylim=(0, 1.08 * N), title=f"Rows proved, of {N}")
proved.legend(frameon=False, fontsize=9, loc="lower right")
for place, (name, (_, z)) in enumerate(answers.items()):
    values = (
        string.residual(z),
        np.abs(z - exact.z).max(),
        icp.error_bound(string, z, sharp=True).value,
    )
    bars.plot([*values[:2]], [place, place], color="0.8", linewidth=1, zorder=0)
    for value, sign, colour, size in zip(
        values, "dos", (GREY, BLUE, GREEN), (5, 5, 9), strict=True
    ):
        bars.plot(
            value,
            place,
            sign,
            color=colour,
            markersize=size,
            markerfacecolor="none" if sign == "s" else colour,
        )
    bars.annotate(
        name, (values[0], place), (0, 9), textcoords="offset points", fontsize=9
    )
bars.set(
    xscale="log",
    yticks=[],
    ylim=(-0.5, len(answers) - 0.3),
    xlim=(1e-8, 1),
    xlabel="in heights  (← more accurate)",
)
bars.set_title("Called solved: ◆ residual, ● error")
for axes in (fall, proved, bars):
    axes.spines[["top", "right"]].set_visible(False)
for suffix in ("png", "svg"):
    figure.savefig(f"what_a_bound_is_worth.{suffix}", dpi=150)

# %%
# ## Vary one thing
#
# `N`. The finer the grid, the less the residual says: with half the width the same residual allows four times the
# error, for $v = A^{-1}(1, \ldots, 1)$ grows like $N^2$.

for n in (49, 99, 199, 399):
    fine = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n, n))
    print(
        f"N = {n:3d}: a residual of 1e-6 in every row allows an error of up to "
        f"{1e-6 * (n + 1) ** 2 / 8:.1e}"
    )
    v = sp.linalg.spsolve(fine.tocsc(), np.ones(n))
    assert abs(v.max() / ((n + 1) ** 2 / 8) - 1) < 1e-9, "v is that of the formula"

# %%
# ## Exercises
#
# **1.** What residual does it take to have heights that are right to $10^{-6}$? How does one ask for heights instead?
#
# Answer: At worst $(N + 1)^2/8 = 5000$ times smaller than the heights ask for, and one does not know before. Who says
# `accuracy=1e-6` need not know: the run ends when the certified error is below it.

asked = string.solve("psor", accuracy=1e-6)
print(
    f"{asked.iterations} sweeps: residual {asked.residual:.1e}, certified "
    f"{asked.certificate.error_bound:.1e}",
    end="",
)
print(f", true error {np.abs(asked.z - exact.z).max():.1e}")
assert np.abs(asked.z - exact.z).max() <= asked.certificate.error_bound <= 1e-6, (
    "the answer is as accurate as was asked for"
)

# %%
# **2.** As soon as every row is proved, what is left to do?
#
# Answer: One linear solve: where every row is known to touch or to hang free, the solution is that of linear equations.
# `Solution.polish` does it, and leaves rounding errors only.

early = string.solve("psor", omega=1.9, max_iter=300, raise_on_failure=False)
late = early.polish()
print(
    f"after {early.iterations} sweeps: {early.active_set}; error "
    f"{np.abs(early.z - exact.z).max():.0e}"
)
print(
    f"polished: error {np.abs(late.z - exact.z).max():.0e}, certified "
    f"{late.certificate.error_bound:.0e}"
)

# %%
# **3.** Judge OSQP's contact set by the eye: take rows with $z_i - \psi_i < 10^{-6}$ as touching. How many are wrong?
# How many of those that are *proved* from the same answer?
#
# Answer: Of the proved ones none, ever.

z = answers["OSQP itself"][1]
touches = icp.theory.active_set(string, z, icp.error_bound(string, z, sharp=True))
truth = exact.p > exact.r
by_eye = int(((z - bump < 1e-6) != truth).sum())
wrong = int((touches.active & ~truth).sum() + (touches.inactive & truth).sum())
print(
    f"by the eye {by_eye} of {N} wrong; of {N - touches.undecided.sum()} that are "
    f"proved {wrong}"
)
assert wrong == 0, "nothing that is proved is wrong"

# %%
# **4.** $A = (1, 0, 2;\ 2, 1, 0;\ 0, 2, 1)$ and $q = -(1, 1, 1)$ is the wheel of
# [the lesson on relaxation](why_relaxation_helps.md). No $v > 0$ has $\langle A \rangle v > 0$. Can an answer be
# bounded all the same?
#
# Answer: Yes: for few rows all linear pieces of the problem can be examined in fractions, and one of them holds the
# only solution. So the bound is the error.

wheel = icp.ICP([[1, 0, 2], [2, 1, 0], [0, 2, 1]], [-1, -1, -1])
bound = icp.error_bound(wheel, [0.33, 0.33, 0.34])
print(f"{bound}\ntrue error {np.abs(np.array([0.33, 0.33, 0.34]) - 1 / 3).max():.4f}")
