"""The chart of docs/benchmarks.md: a solve against one linear solve, as the table `limit` of that page has it.

Run: python docs/figures/limit.py        writes limit.png beside this file
"""

import re
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

HERE = Path(__file__).parent
#: problem, unknowns, median of the ratio, lowest and highest ratio
ROW = re.compile(r"^(\S.*?)  +(\d+)  +\S+  +\S+  +\S+  +(\S+)  +(\S+)  +(\S+)  +\S+$", re.MULTILINE)
#: by the number of unknowns: what the legend says, colour, marker
SIZES = {10_000: ("10⁴ unknowns", "#56B4E9", "o"), 99_856: ("10⁵", "#0072B2", "s"), 1_000_000: ("10⁶", "#D55E00", "D")}


def rows():
    """{problem: {unknowns: (median, lowest, highest)}} of the table."""
    page = (HERE.parent / "benchmarks.md").read_text(encoding="utf-8")
    table = page.partition("$ python tests/benchmarks limit\n")[2].partition("```")[0]
    found = {}
    for problem, unknowns, *ratios in ROW.findall(table):
        found.setdefault(problem, {})[int(unknowns)] = tuple(map(float, ratios))
    return found


figure, axes = plt.subplots(figsize=(7.2, 3.6), layout="constrained")
problems = rows()
for offset, (size, (label, colour, marker)) in zip((-0.22, 0, 0.22), SIZES.items(), strict=True):
    at = [row + offset for row in range(len(problems))]
    median, low, high = zip(*(of[size] for of in problems.values()), strict=True)
    axes.hlines(at, low, high, color=colour, linewidth=1.6)
    axes.plot(median, at, marker, color=colour, markersize=5, label=label)
axes.axvline(1, color="0.35", linewidth=1, linestyle="--")
axes.set_xscale("log")
ticks = [0.05, 0.1, 0.2, 0.5, 1, 2]
axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
axes.minorticks_off()
axes.set_yticks(range(len(problems)), problems)
axes.invert_yaxis()
axes.set_xlabel("time of solve() / time of one linear solve with A by PyAMG")
axes.legend(frameon=False, loc="center left", bbox_to_anchor=(0.02, 0.62))
axes.grid(axis="x", color="0.9")
axes.set_axisbelow(True)
axes.spines[["top", "right"]].set_visible(False)
figure.savefig(HERE / "limit.png", dpi=130)
