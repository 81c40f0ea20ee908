"""Memory of solve()."""

import json
import os
import subprocess
import sys

#: the child: build, solve a smaller one (imports, compiles), forget the peak so far, solve, tell the peak
CHILD = """
import json, sys
from pathlib import Path
from icpmodel.scenes import scene
text, n = json.loads(sys.argv[1])
scene(text, 6_400).problem.solve(raise_on_failure=False)
problem = scene(text, n).problem
def status(key):
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith(key)).split()[1])
Path("/proc/self/clear_refs").write_text("5")
before = status("VmRSS")
solution = problem.solve()
A = problem.A
size = A.data.nbytes + A.indices.nbytes + A.indptr.nbytes
print(json.dumps([problem.n, solution.method.name, size, 1024 * (status("VmHWM") - before)]))
"""

#: freed arrays go back to the kernel at once, so that the next ones are not hidden in what was freed before (glibc)
RETURNED = {"MALLOC_MMAP_THRESHOLD_": "65536", "MALLOC_TRIM_THRESHOLD_": "65536"}


def table(scenes=("membrane", "membrane,skew=0.5"), sizes=(10_000, 100_000, 1_000_000)):
    """The most memory that `solve()` holds beyond the problem, against the bytes of A.

    Each solve runs in a process of its own. The peak is the kernel's, so that what compiled libraries allocate is
    counted. Linux only.

    Parameters
    ----------
    scenes : NAME or NAME,PARAMETER=NUMBER
    sizes : wanted numbers of unknowns
    """
    yield "scene", "n", "method", "A, MiB", "peak beyond the problem, MiB", "peak / A"
    for text in scenes:
        for n in sizes:
            command = [sys.executable, "-c", CHILD, json.dumps([text, n])]
            done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env=os.environ | RETURNED)
            unknowns, method, size, peak = json.loads(done.stdout)
            yield text, unknowns, method, size / 2**20, peak / 2**20, peak / size
