"""When to pay dividends, and how much: impulse control, checked against its closed form on three grids.

It teaches: the obstacle is what the best act is worth, and that depends on the solution itself (impulse control).

Run: python examples/dividends.py             writes dividends.png and dividends.svg into the current folder
"""

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import icpmodel as icp

print(icp.scenes.dividend().models)
print()
print(f"{'grid h':>9} {'V(1)':>12} {'pay at x*':>12} {'down to':>12} {'steps':>7}")
for n in (61, 241, 961):
    scene = icp.scenes.dividend(n=n)
    solution = scene.problem.solve(rtol=1e-10)
    seen = [scene.quantities[name].measure(solution.z) for name in ("V(1)", "x*", "target")]
    print(f"{scene.h:9.6f} {seen[0]:12.7f} {seen[1]:12.7f} {seen[2]:12.7f} {solution.iterations:7d}")
exact = [scene.quantities[name].exact for name in ("V(1)", "x*", "target")]
print(f"{'exact':>9} {exact[0]:12.7f} {exact[1]:12.7f} {exact[2]:12.7f}")
print()
print("A quarter of the grid spacing divides the error by about 16: second order.")

x, V, pays = scene.points, solution.z, solution.p > solution.r
figure, (value, slope) = plt.subplots(1, 2, figsize=(9, 3.9), layout="constrained")
value.plot(x, V, color="#0072B2", label="value V")
value.plot(x, scene.problem.psi.value(V), "--", color="#D55E00", label="best payment now, ψ(V)")
value.axvspan(x[pays][0], x[-1], color="0.9", label="pay")
value.set_ylabel("value to the owner, money")
value.set_title("Pay where the best payment is worth V")
value.legend(frameon=False, loc="lower right")
slope.plot((x[1:] + x[:-1]) / 2, np.diff(V) / scene.h, color="#0072B2", label="slope of V")
slope.axhline(1 / 1.2, linestyle=":", color="black", label="1/(1 + tax): worth of one unit paid out")
for place, colour, mark, words in (
    (exact[1], "#D55E00", "o", "pay here: x*"),
    (exact[2], "#009E73", "s", "down to here"),
):
    slope.plot([place], [1 / 1.2], mark, color=colour, markersize=8, label=words)
slope.set_ylim(0.3, 1.4)
slope.set_ylabel("worth of one unit more in the reserve")
slope.set_title("Pay from x* down to the same slope")
slope.legend(frameon=False, loc="lower right")
for axes in (value, slope):
    axes.set_xlabel("reserve x, money")
for suffix in ("png", "svg"):
    figure.savefig(f"dividends.{suffix}", dpi=150)
