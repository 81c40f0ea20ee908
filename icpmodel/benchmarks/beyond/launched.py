"""Processes that measure: `run_on_ranks` alone or under mpiexec, and what comes back or why nothing does."""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from ...errors import NotApplicable
from .rank_model import Calibration, fitted

#: what mpiexec is given where nothing else is asked for: Open MPI may run as root, and on more ranks than there are
#: cores; every rank has one thread
_ENVIRONMENT = {
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
    "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
}
#: unknowns of the run whose times are those of levels, whatever their size
_SMALL = 2_000
#: seconds more than its limit after which a run that has not ended itself is ended
_GRACE = 30.0


def needs_petsc() -> None:
    """Raise NotApplicable where ranks cannot be started here."""
    missing = [name for name in ("petsc4py", "mpi4py") if importlib.util.find_spec(name) is None]
    missing += [] if shutil.which("mpiexec") else ["mpiexec"]
    if missing:
        raise NotApplicable(
            f"runs on ranks need {' and '.join(missing)}, which did not come with icpmodel: docs/distributed.md and "
            "CONTRIBUTING.md say how to get PETSc"
        )


def launched(by: str, scene: str, n: int, ranks: int, limit: float) -> dict[str, Any] | str:
    """What the job `by` on `scene` with about `n` unknowns tells, or, in words, why it tells nothing. `ranks` 0 is a
    process without mpiexec, which may use all cores; `limit` seconds for all of it."""
    job = json.dumps({"by": by, "scene": scene, "n": n, "limit": limit})
    start = ["mpiexec", "-n", str(ranks)] if ranks else []
    command = [*start, sys.executable, "-c", f"from {__package__}.run_on_ranks import main; main()", job]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, env=_environment(ranks), timeout=limit + _GRACE
        )
    except subprocess.TimeoutExpired:
        return f"not done in {limit:g} s"
    lines = done.stdout.strip().splitlines()
    if done.returncode == 0 and lines:
        told: dict[str, Any] = json.loads(lines[-1])
        return told
    if "Timeout (" in done.stderr:
        return f"not done in {limit:g} s"
    said = [line for line in done.stderr.splitlines() if line.partition(":")[0].endswith(("Error", "NotApplicable"))]
    return f"ended with {done.returncode}: {said[-1] if said else 'killed, or out of memory'}"


def _environment(ranks: int) -> dict[str, str]:
    """This package's, whatever the folder; ranks that have no core for themselves give way to each other."""
    house = str(Path(__file__).parents[3])
    path = os.pathsep.join([house, *filter(None, [os.environ.get("PYTHONPATH")])])
    polite = {"OMPI_MCA_mpi_yield_when_idle": "1"} if ranks >= (os.cpu_count() or 1) else {}
    return (_ENVIRONMENT | polite if ranks else {}) | os.environ | {"PYTHONPATH": path}


def calibrated(scene: str, n: int, limit: float) -> Calibration | str:
    """The model of `scene` from counts and times at about `n` unknowns and at few, on one rank and on two, or why there
    is none."""
    told = {}
    for name, by, size, ranks in (
        ("small", "counts", _SMALL, 1),
        ("large", "counts", n, 1),
        ("small pair", "counts", _SMALL, 2),
        ("pair", "counts", n, 2),
        ("own", "own", n, 1),
        ("search", "search", n, 2),
    ):
        found = launched(by, scene, size, ranks, limit)
        if isinstance(found, str):
            return f"{scene}, n = {size}, on {ranks}: {found}"
        if by == "counts" and not found["shapes"]:
            return f"{scene}, n = {size}: PETSc makes no levels of it"
        told[name] = found
    pair = told["pair"] | told["search"] | {"small": told["small pair"]}
    return fitted(told["small"], told["large"], pair, told["own"])
