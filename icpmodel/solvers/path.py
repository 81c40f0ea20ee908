"""PATH, the reference solver for complementarity, run by the GAMS system of `gamspy_base`.

Lower and upper obstacles that depend on z have multipliers u ≥ 0 and v ≥ 0. PATH gets the mixed
complementarity problem in x = (z, u, v). Each line is a function and its variable:

    Az + q − u + v    ⟂   z, between the obstacles that are constant,
    z − Gz − c        ⟂   u ≥ 0,
    d + Hz − z        ⟂   v ≥ 0.

References
----------
Dirkse and Ferris, Optim. Methods Softw. 5 (1995), doi 10.1080/10556789508805606.
"""

from __future__ import annotations

import os
import pathlib
import re
import subprocess
import tempfile
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..numerics.arrays import Vector
from .foreign import Claim, ForeignSolver
from .formulations import Target

_MODEL = """$offlisting
$onempty
option limrow = 0, limcol = 0, solprint = silent, solvelink = 5, reslim = {seconds!r}, mcp = path;
set i / 1*{n} /; alias (i, j);
parameter M(i,j) / {M} /, b(i) / {b} /, least(i) / {least} /, most(i) / {most} /;
variable x(i); x.lo(i) = least(i); x.up(i) = most(i);
equation F(i); F(i).. sum(j$M(i,j), M(i,j) * x(j)) + eps * x(i) + b(i) =n= 0;
model icp / F.x /; icp.optfile = 1;
solve icp using mcp;
file answer / answer.txt /; answer.nd = 0; answer.nw = 0; answer.nr = 2;
put answer; loop(i, put x.l(i):26:17 /);
"""


class PathSolver(ForeignSolver):
    """PATH; its tolerance is that of its own residual. A run starts a process, which takes some 0.05 s."""

    name = "path"
    package = "gamspy_base"
    extra = "path"
    forms = ("mpec",)
    largest = 1000
    too_large = "the demo licence of GAMS takes no model"

    def size(self, target: Target) -> int:
        return target.problem.n + sum(int(moves.sum()) for _, _, _, moves in _sides(target))

    def set_up(self, target: Target, tolerance: float, time_limit: float) -> Any:
        end = time.perf_counter() + time_limit
        M, b, least, most = mixed_problem(target)
        vectors = {"b": b, "least": least, "most": most}
        lists = {name: _gams_list(vector, np.arange(b.size)) for name, vector in vectors.items()}
        model = _MODEL.format(n=b.size, seconds=float(time_limit), M=_gams_list(M.data, *M.coords), **lists)
        return {"icp.gms": model, "path.opt": f"convergence_tolerance {tolerance!r}\n"}, target.problem.n, end

    def run(self, model: Any) -> Claim:
        import gamspy_base

        files, n, end = model
        call = [os.path.join(gamspy_base.directory, "gams"), "icp.gms", "logoption=3"]
        with tempfile.TemporaryDirectory(prefix="icpmodel-") as folder:
            for name, text in files.items():
                pathlib.Path(folder, name).write_text(text, encoding="ascii")
            seconds_left = max(end - time.perf_counter(), 0.0)
            try:  # it is killed at the limit, and after Ctrl-C
                process = subprocess.run(
                    call, cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, timeout=seconds_left
                )
            except subprocess.TimeoutExpired:
                return Claim(None, "time limit", False)
            answer = pathlib.Path(folder, "answer.txt")
            z = np.array(answer.read_text().split(), dtype=np.float64)[:n] if answer.exists() else None
        # the exit message of PATH; without one, the errors of GAMS
        exits = re.findall(r"^ \*{2,3} EXIT - (.+?)\.?$", text := process.stdout.decode(errors="replace"), re.MULTILINE)
        words = exits[-1] if exits else "; ".join(re.findall(r"^\*\*\* (.+)", text, re.MULTILINE)[:2])
        return Claim(z, words, words == "solution found")


def mixed_problem(target: Target) -> tuple[sp.coo_array, Vector, Vector, Vector]:
    """(M, b, l, h) of the mixed complementarity problem Mx + b ⟂ l ≤ x ≤ h with x = (z, u, v); M in COO form."""
    problem = target.problem
    n = target.problem.n
    unit = sp.eye_array(n, format="csr")
    bounds = [np.full(n, -np.inf), np.full(n, np.inf)]
    rows = []
    offsets = [problem.q]
    columns = [problem.A]
    for k, (sign, G, c, moves) in enumerate(_sides(target)):
        bounds[k][~moves] = c[~moves]
        rows.append(sign * (unit - G)[moves])
        offsets.append(-sign * c[moves])
        columns.append(-sign * unit[:, moves])
    m = sum(one.shape[0] for one in rows)
    M = sp.vstack([sp.hstack(columns), sp.hstack([sp.vstack(rows), sp.csr_array((m, m))])])
    least = np.append(bounds[0], np.zeros(m))
    most = np.append(bounds[1], np.full(m, np.inf))
    return sp.coo_array(M), np.concatenate(offsets), least, most


def _sides(target: Target) -> Iterator[tuple[float, Any, Vector, Any]]:
    """(1, G, c) of the lower obstacle and (−1, H, d) of the upper one, each with the mask of rows that depend on z."""
    for sign, (G, c) in ((1.0, target.below), (-1.0, target.above)):
        yield sign, G, c, np.isfinite(c) & (np.diff(G.indptr) > 0)


def _gams_list(values: Vector, *places: Any) -> str:
    """The `values` as a list of GAMS data, each after its indices (one array of `places` each), from 1."""
    form = ".".join(["%d"] * len(places)) + " %r"
    return "\n".join(map(form.__mod__, zip(*((one + 1).tolist() for one in places), values.tolist(), strict=True)))
