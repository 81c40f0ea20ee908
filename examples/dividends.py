"""When to pay dividends, and how much: impulse control, checked against its closed form on three grids.

Run: python examples/dividends.py
"""

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
