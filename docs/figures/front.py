"""The pictures of the README: a membrane with its contact set, and the race on it as `race.csv` has it.

Run: python docs/figures/front.py        writes front-field.png and front-race.png beside this file
"""

import csv
import math
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

import icpmodel as icp

HERE = Path(__file__).parent
#: who is shown: name in the race, what is written at its line, colour, marker
SHOWN = [
    ("solve()", "icpmodel, solve()", "#0072B2", "o"),
    ("mnmgs", "the paper's Gauss–Seidel", "#009E73", "s"),
    ("osqp", "OSQP", "#CC79A7", "v"),
    ("scs", "SCS", "#56B4E9", "D"),
    ("piqp", "PIQP", "#D55E00", "P"),
]


def field(axes):
    scene = icp.scenes.membrane(n=10_000)
    solution = scene.problem.solve()
    m = math.isqrt(scene.problem.n)
    x, y, height = (of.reshape(m, m) for of in (*scene.points.T, solution.z))
    touches = (solution.p > solution.r).reshape(m, m)
    shown = axes.pcolormesh(x, y, height, cmap="cividis", shading="nearest", rasterized=True)
    axes.contour(x, y, touches, levels=[0.5], colors="white", linewidths=1.4)
    axes.annotate("p > 0:\nit touches", (0.5, 0.5), ha="center", va="center", fontsize=9)
    axes.annotate("r > 0: it is free", (0.5, 0.14), ha="center", color="white", fontsize=9)
    axes.set(aspect="equal", xticks=[], yticks=[], title="A membrane over a bump")
    axes.figure.colorbar(shown, ax=axes, label="height z", shrink=0.8)


def race(axes):
    with (HERE / "race.csv").open(encoding="utf-8") as file:
        next(file)
        rows = list(csv.DictReader(file))
    error = next(head for head in rows[0] if "max |z - z*|" in head)
    for name, label, colour, marker in SHOWN:
        points = [
            (float(row[error]), float(row["time, s"]))
            for row in rows
            if row["competitor"] == name and row[error] and row["claim"].lower().startswith("solved")
        ]
        points.sort(reverse=True)
        axes.loglog(*zip(*points, strict=True), marker=marker, color=colour, markersize=4, linewidth=1.2)
        at, below = (points[2], -22) if name == "mnmgs" else (points[-1], 0)  # where no other line passes
        axes.annotate(
            label, at, (7, below), textcoords="offset points", fontsize=8.5, va="center", annotation_clip=False
        )
    axes.invert_xaxis()
    axes.set_xlim(right=1e-15)
    axes.set(xlabel="certified error  (more accurate →)", ylabel="seconds", title="The same with 100 000 points")
    axes.spines[["top", "right"]].set_visible(False)


for draw, name, size in ((field, "front-field", (4.8, 3.7)), (race, "front-race", (4.8, 3.7))):
    figure, axes = plt.subplots(figsize=size, layout="constrained")
    draw(axes)
    figure.savefig(HERE / f"{name}.png", dpi=130)
