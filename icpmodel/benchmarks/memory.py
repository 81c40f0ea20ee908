"""How much memory a solve takes, in a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from ..errors import InputError
from ..methods.contract import named
from ..present.table import Table
from ..study.cases import as_scenes, as_sizes
from ..study.timing import machine

#: the child: build, solve a smaller one (imports, compiles), forget the peak so far, solve, tell the peak
_CHILD = """
import json, sys
from pathlib import Path
from icpmodel.study.cases import built
text, n, method = json.loads(sys.argv[1])
built(text, 6_400).problem.solve(method, raise_on_failure=False)
problem = built(text, n).problem
def status(key):
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith(key)).split()[1])
Path("/proc/self/clear_refs").write_text("5")
before = status("VmRSS")
solution = problem.solve(method, raise_on_failure=False)
A = problem.A
size = A.data.nbytes + A.indices.nbytes + A.indptr.nbytes
print(json.dumps([problem.n, solution.method.name, solution.solved, size, 1024 * (status("VmHWM") - before)]))
"""

#: freed arrays go back to the kernel at once, so that the next ones are not hidden in what was freed before (glibc)
_RETURNED = {"MALLOC_MMAP_THRESHOLD_": "65536", "MALLOC_TRIM_THRESHOLD_": "65536"}


def memory(
    scenes: Sequence[str] = ("membrane",),
    sizes: Sequence[int] = (10_000, 100_000, 1_000_000),
    method: str | None = None,
) -> Table:
    """The most memory that solve() holds on SCENES, default the membrane, against the bytes of A.

    That is beyond the problem itself. Each solve runs in a process of its own that has solved one with 6 400 unknowns
    before; the peak is the kernel's (VmHWM), so that what compiled libraries allocate is counted. Linux only.
    Parameters: `scenes` as NAME or NAME,PARAMETER=NUMBER; `sizes` wanted unknowns; `method` by name, without it one
    is picked. Returns a `Table` (MiB). Raises InputError.

    >>> icp.benchmarks.memory(["hand-lcp"], [2]).heads[-2]
    'peak / A'
    """
    if not Path("/proc/self/clear_refs").exists():
        raise InputError("memory is measured on Linux only: there is no /proc/self/clear_refs")
    if method is not None:
        named(method)
    rows = []
    for text in as_scenes(scenes):
        for n in as_sizes(sizes):
            command = [sys.executable, "-c", _CHILD, json.dumps([text, n, method])]
            done = subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ | _RETURNED)
            if done.returncode != 0:
                raise InputError(f"{text}, n = {n}: {(done.stderr.strip().splitlines() or ['killed'])[-1]}")
            unknowns, by, solved, size, peak = json.loads(done.stdout)
            note = "" if solved else "not solved"
            rows.append((text, unknowns, by, size / 2**20, peak / 2**20, peak / size, note))
    heads = ("scene", "n", "method", "A, MiB", "peak beyond the problem, MiB", "peak / A", "note")
    return Table(f"Memory of solve() ({machine()})", heads, tuple(rows))
