r"""How hot does a slab get that heats itself?

A reaction gives off heat, and all the more the hotter it is. So the force of the problem is not linear in its unknown.

Run: python examples/thermal_explosion.py     writes thermal_explosion.png and .svg into the current folder
"""

# %%
# ## The model
#
# A slab of width 1 has cold sides, $u(0) = u(1) = 0$. Inside, the heat $\lambda e^u$ is conducted away, until the
# temperature reaches a ceiling $\bar u$, where the material melts and takes up the rest:
#
# $$p = -u'' - \lambda e^u, \qquad p = 0 \text{ where } u < \bar u, \qquad p \le 0 \text{ where } u = \bar u.$$
#
# On a grid that is $p(z) = Az + q + f(z)$ with an upper obstacle: $f$ is `Elementwise`, and its slopes lie between
# $-h^2\lambda e^{\bar u}$ and 0 for all $z \le \bar u$. That is all that a model with nonlinear $p$ has to say.
# `HEAT` is $\lambda$.

import matplotlib.pyplot as plt
import numpy as np

import icpmodel as icp

HEAT = 1.0  # 0.1 to 5
CEILING = 5.0
n = 29
h = 1 / (n + 1)
x = np.linspace(h, 1 - h, n)


def slab(heat: float) -> icp.ICP:
    A = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)

    def f(z: np.ndarray) -> np.ndarray:
        return -(h**2) * heat * np.exp(np.minimum(z, CEILING))

    def slope(z: np.ndarray) -> np.ndarray:
        return np.where(z > CEILING, 0, f(z))

    steepest = h**2 * heat * np.exp(CEILING)
    heating = icp.Elementwise(f, slope, slope_range=(-steepest, 0))
    return icp.ICP(A, np.zeros(n), -np.inf, CEILING, f=heating)


def residual(problem: icp.ICP, z: np.ndarray) -> float:
    return float(np.abs(problem.natural_map(z)).max())


# %%
# ## What is seen
#
# From a cold start there is a mild answer. From the ceiling sweeps, which solve each row of $p$ for its own unknown, go
# down to one that has melted. Both are answers: the certificate does not say that either is the only one.


def molten(heat: float) -> icp.Solution:
    return slab(heat).solve("psor", z0=np.full(n, CEILING))


problem = slab(HEAT)
cold = problem.solve(rtol=1e-12)
hot = molten(HEAT)
for name, found in (("cold", cold), ("molten", hot)):
    top, melts = found.z.max(), int((found.z == CEILING).sum())
    print(f"{name:>6}: top {top:.4f}, {melts} of {n} points melt, {found.method!r}")
    assert residual(problem, found.z) < 1e-6, "both are answers"
assert not cold.certificate.unique, "neither is proved to be the only one"

# %%
# The highest temperature for all $\lambda$: each mild answer starts from the one before, and the mild answers end at a
# fold. The molten ones end where the slab is too cold to stay molten. In between, the past decides.

heats, mild, last = np.linspace(0.3, 3.5, 17), [], np.zeros(n)
for heat in heats:
    last = slab(heat).solve(z0=last).z
    mild.append(last.max())
above = np.array([0.3, 0.6, 1.0, 2.0, 4.0])
tops = [molten(heat).z.max() for heat in above]
figure, axes = plt.subplots(figsize=(6.4, 4), layout="constrained")
axes.plot(heats, mild, color="#0072B2", label="from a cold start")
axes.plot(above, tops, "o--", color="#D55E00", label="from the ceiling")
axes.set_xlabel("heat of the reaction, λ")
axes.set_ylabel("highest temperature")
axes.set_title("Two states of one slab")
axes.legend(frameon=False)
for suffix in ("png", "svg"):
    figure.savefig(f"thermal_explosion.{suffix}", dpi=150)

# %%
# ## Vary one thing
#
# `HEAT`. The mild top rises slowly, then ever more quickly up to the fold, while the molten part grows.

for heat in sorted({0.6, 1.0, 2.0, 3.0, 3.5, HEAT}):
    top = slab(heat).solve().z.max()
    melts = int((molten(heat).z == CEILING).sum())
    print(f"heat {heat:3.1f}: mild top {top:.4f}, from the ceiling {melts} points melt")

# %%
# ## Exercises
#
# **1.** How many affine problems does `solve()` need for the mild answer, and is the linearisation at the answer solved
# by it as well?
#
# Answer: A few, as Newton's method converges quadratically. $p$ and its linearisation agree at the answer, so that
# every solver of affine problems can check it.

linear = problem.linearised(cold.z)
print(f"{cold.iterations} affine problems; linearised: {residual(linear, cold.z):.1e}")
assert cold.iterations <= 6, "a few affine problems"
assert np.abs(linear.solve(rtol=1e-12).z - cold.z).max() < 1e-8, "the same answer"

# %%
# **2.** Near the fold a little more heat matters much. By how much does the top grow with $\lambda$ at $\lambda = 1$
# and at $\lambda = 3.4$?
#
# Answer: Derivatives of the answer tell, without another solve. The closer the fold, the larger they are.

for heat in (1.0, 3.4):
    near = slab(heat)
    solution = near.solve(rtol=1e-12)
    change = -(h**2) * np.exp(solution.z)
    moved = solution.derivative().forward(dq=change)
    print(f"heat {heat:.1f}: the top grows by {moved.max():.3f} for 1 more")
