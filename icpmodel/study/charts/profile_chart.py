"""Performance profiles: on which share of the problems is a method within a factor of the best?"""

from __future__ import annotations

import numpy as np

from ...numerics.arrays import Vector
from ...present.table import Table
from .figures import Figure, dashed, new_figure

#: the largest factor that is drawn
_LARGEST = 1000.0
#: more lines than these cannot be told apart
_SHOWN = 12


def profiles(table: Table) -> dict[str, Vector]:
    """Method → its factors t/t_best, increasing, on the problems that it solved; infinite on the others.

    Parameters: `table` of a `benchmark`; a problem is a scene at a size which someone solved, linear solves do not take
    part. The share ρ(τ) of factors ≤ τ is the performance profile.
    Reference: Dolan and Moré, Math. Program. 91 (2002), doi:10.1007/s101070100263.
    """
    times: dict[str, dict[tuple[str, int], float]] = {}
    for row in table.rows:
        cells = dict(zip(table.heads, row, strict=True))
        if cells["method"] and cells["kind"] != "limit":
            mine = times.setdefault(cells["method"], {})
            if cells["time, s"] is not None:
                mine[cells["scene"], cells["n"]] = cells["time, s"]
    best: dict[tuple[str, int], float] = {}
    for mine in times.values():
        for problem, seconds in mine.items():
            best[problem] = min(seconds, best.get(problem, np.inf))
    return {
        name: np.sort([mine.get(problem, np.inf) / seconds for problem, seconds in best.items()])
        for name, mine in times.items()
    }


def profile_figure(table: Table) -> Figure:
    """The twelve best profiles of a `benchmark`, best first in the legend. Returns a matplotlib figure."""
    found = profiles(table)
    figure = new_figure(9, 5.4)
    axes = figure.subplots()
    ranked = sorted(found, key=lambda name: (name != "solve()", -_area(found[name])))[:_SHOWN]
    for name, (colour, dash) in dashed(ranked).items():
        factors = found[name]
        solved = factors[factors <= _LARGEST]
        x = np.concatenate([[1.0], solved, [_LARGEST]])
        y = np.concatenate([[0.0], np.arange(1, solved.size + 1), [solved.size]]) / max(factors.size, 1)
        width = 2.5 if name == "solve()" else 1.3
        axes.plot(x, y, drawstyle="steps-post", color=colour, linestyle=dash, linewidth=width, label=name)
    axes.set_xscale("log")
    axes.set_xlim(1.0, _LARGEST)
    axes.set_ylim(0.0, 1.02)
    axes.set_xlabel("time within this factor of the quickest")
    axes.set_ylabel("share of the problems")
    axes.grid(alpha=0.3)
    figure.legend(loc="outside right center", frameon=False, fontsize=8)
    return figure


def _area(factors: Vector) -> float:
    """The area under the profile over log τ."""
    return float(np.log(_LARGEST / np.clip(factors, 1.0, _LARGEST)).sum())
