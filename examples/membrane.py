"""A membrane over a paraboloid: where does it touch, and how hard does it press?

Run: python examples/membrane.py        writes membrane.png and membrane.svg into the current folder
"""

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import icpmodel as icp

scene = icp.scenes.membrane(n=10_000)
solution = scene.problem.solve()
print(solution)

m = int(np.sqrt(scene.problem.n))
x = scene.points[:, 0].reshape(m, m)
y = scene.points[:, 1].reshape(m, m)
height = solution.z.reshape(m, m)
# p and r are complementary: the larger of the two, which is not zero, says on which side a row lies.
contact = (solution.p > solution.r).reshape(m, m)
pressure = np.where(contact, solution.p.reshape(m, m) / scene.h**2, np.nan)
middle = m // 2

figure, (profile, plan) = plt.subplots(1, 2, figsize=(9, 3.9), layout="constrained")
axis = x[middle] if np.ptp(x[middle]) > 0 else y[middle]
profile.plot(axis, solution.problem.psi.value(solution.z).reshape(m, m)[middle], color="#D55E00", label="obstacle ψ")
profile.plot(axis, height[middle], color="#0072B2", label="membrane z")
profile.set_ylim(-0.05, 0.6)
profile.set_xlabel("x, sides of the square")
profile.set_ylabel("height")
profile.set_title("Section through the middle")
profile.legend(frameon=False, loc="upper right")

field = plan.pcolormesh(x, y, height, cmap="cividis", shading="nearest", rasterized=True)
plan.contour(x, y, contact.astype(float), levels=[0.5], colors="white", linewidths=1.2)
plan.annotate("contact", (0.5, 0.5), color="black", ha="center", va="center")
plan.set_aspect("equal")
plan.set_xlabel("x, sides of the square")
plan.set_ylabel("y, sides of the square")
plan.set_title("Height and contact set")
figure.colorbar(field, ax=plan, label="height z")

for suffix in ("png", "svg"):
    figure.savefig(f"membrane.{suffix}", dpi=150)
print(f"\n{contact.sum()} of {scene.problem.n} points touch; median force per area there: {np.nanmedian(pressure):.6g}")
print("(minus the Laplacian of the paraboloid is 16)")
