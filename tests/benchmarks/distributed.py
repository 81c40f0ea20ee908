"""To Res_D(z) <= 1e-8 Res_D(0) on ranks, set-up included."""

import faulthandler
import json
import os
import resource
import subprocess
import sys
import time
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from shutil import which

import numpy as np

import icpmodel as icp
from icpmodel.study.timing import run_interleaved

from .harness import scene

#: Open MPI may run as root, and on more ranks than there are cores; every rank has one thread
ENVIRONMENT = {
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
    "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
}
#: the unknowns of the problem that is solved before anything is measured
WARM = 400
HEADS = ("scene", "n", "method", "ranks", "solve, s", "lowest", "highest", "iterations", "Krylov steps")
HEADS += ("memory a rank, MiB", "beyond the programs, MiB", "time / serial", "note")


def table(
    scenes=("membrane",), sizes=(10_000, 100_000, 300_000), ranks=(1, 2), repeats=3, time_limit=100.0, snesvi=100_000
):
    """`icp.distributed.solve` on the ranks of MPI against the serial multilevel method and PETSc's SNESVI.

    Every run is one of processes of their own, which first solve a small problem, in turn. The time is that of the
    solve, set-up included and assembly not, on the rank that takes longest. SNESVI is PETSc's semismooth Newton
    method in the reduced space with BoomerAMG; it is run once. Memory is the most that a rank holds, and that less
    what it held after the small problem.

    Parameters
    ----------
    scenes : NAME, of those that can be assembled by rows
    sizes : wanted unknowns
    ranks : numbers of ranks
    repeats : rounds
    time_limit : seconds for one run, its start included
    snesvi : the number of unknowns up to which SNESVI is run
    """
    if not (find_spec("petsc4py") and find_spec("mpi4py") and which("mpiexec")):
        raise SystemExit("petsc4py, mpi4py and mpiexec are needed: docs/distributed.md says how to get them")
    yield HEADS
    for name in scenes:
        for n in sizes:
            keys = [("serial multilevel", 0), *(("distributed", one) for one in ranks)]
            calls = {key: partial(launched, *key, name, n, time_limit) for key in keys}
            runs = {key: [] for key in calls}
            for key, run in run_interleaved(calls, repeats):
                runs[key].append(run)
            if n <= snesvi:
                runs |= {("SNESVI", one): [launched("SNESVI", one, name, n, time_limit)] for one in ranks}
            serial = None
            for (method, count), many in runs.items():
                good = [run for run in many if run["note"] == "solved"]
                if not good:
                    yield name, n, method, count or None, *[None] * 8, many[-1]["note"]
                    continue
                seconds = [run["seconds"] for run in good]
                times = np.median(seconds), min(seconds), max(seconds)
                serial = serial or times[0]
                memory, beyond = (np.median([run[key] for run in good]) / 2**20 for key in ("memory", "beyond"))
                counts = good[0]["iterations"], good[0]["krylov"]
                yield name, good[0]["n"], method, count or None, *times, *counts, memory, beyond, times[0] / serial, ""


def launched(method, ranks, name, n, limit):
    """What a run tells; `ranks` 0 is a process without mpiexec, which may use all cores."""
    start = ["mpiexec", "-n", str(ranks)] if ranks else []
    job = json.dumps([method, name, n, limit])
    polite = {"OMPI_MCA_mpi_yield_when_idle": "1"} if ranks >= (os.cpu_count() or 1) else {}
    path = os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    environment = os.environ | {"PYTHONPATH": path} | (ENVIRONMENT | polite if ranks else {})
    command = [*start, sys.executable, "-m", "benchmarks.distributed", job]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    result = done.stdout[done.stdout.find("{") : done.stdout.rfind("}") + 1]  # mpiexec may print something around it
    if done.returncode == 0 and result:
        return json.loads(result)
    late = "Timeout (" in done.stderr
    errors = [line for line in done.stderr.splitlines() if "Error" in line]
    return {"note": f"not done in {limit:g} s" if late else (errors or ["killed"])[-1]}


def peak():
    """The most memory that this process has held so far, bytes."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def measured(make, solve, wait):
    """One run: `make` the problem and `solve` it; what it tells, and the numbers of this rank."""
    solve(make(WARM))
    before = peak()
    problem = make(None)
    wait()
    begin = time.perf_counter()
    result = solve(problem)
    seconds = time.perf_counter() - begin
    return result | {"n": problem.n}, {"seconds": seconds, "memory": peak(), "beyond": peak() - before}


def by_serial(problem):
    solution = problem.solve("multilevel", raise_on_failure=False)
    return {"note": solution.status.value, "iterations": solution.iterations, "krylov": None}


def on_ranks(problem):
    solution = icp.distributed.solve(problem, raise_on_failure=False)
    return {"note": solution.status.value, "iterations": solution.iterations, "krylov": solution.krylov_steps}


def by_snesvi(problem):
    """PETSc's method, CG (GMRES where A is not symmetric) and BoomerAMG (GAMG without hypre) of A, from z = 0."""
    from petsc4py import PETSc

    A, q, z = problem.A, problem.vector(problem.q), problem.vector()
    wanted = 1e-8 * problem.residual(z)
    snes = PETSc.SNES().create(problem.comm)
    snes.setType("vinewtonrsls")
    reason = PETSc.SNES.ConvergedReason

    def ended(it, count, norms):
        return reason.CONVERGED_FNORM_ABS if problem.residual(it.getSolution()) <= wanted else reason.ITERATING

    snes.setFunction(lambda _, x, f: A.multAdd(x, q, f), problem.vector())
    snes.setJacobian(lambda *_: None, A, A)
    low = problem.psi.fixed()
    high = np.full(low.size, np.inf) if problem.upper is None else problem.upper.fixed()
    snes.setVariableBounds(problem.vector(low), problem.vector(high))
    snes.setConvergenceTest(ended)
    snes.setTolerances(max_it=10_000)
    ksp = snes.getKSP()
    ksp.setType("cg" if A.isSymmetric() else "gmres")
    ksp.getPC().setType("hypre" if PETSc.Sys.hasExternalPackage("hypre") else "gamg")
    snes.solve(None, z)
    note = "solved" if problem.residual(z) <= wanted else f"not solved, reason {snes.getConvergedReason()}"
    return {"note": note, "iterations": snes.getIterationNumber(), "krylov": snes.getLinearSolveIterations()}


def main(job):
    """Measure the job; the numbers are those of the rank that has the most."""
    method, name, n, limit = json.loads(job)
    # what waits for another rank inside of MPI hears no signal
    faulthandler.dump_traceback_later(limit, exit=True)
    if method == "serial multilevel":
        result, most = measured(lambda small: scene(name, small or n).problem, by_serial, lambda: None)
    else:
        from mpi4py import MPI

        comm = MPI.COMM_WORLD
        make = lambda small: icp.distributed.by_rows(icp.scenes.by_rows(name, small or n))  # noqa: E731
        result, mine = measured(make, on_ranks if method == "distributed" else by_snesvi, comm.Barrier)
        most = {key: comm.allreduce(one, MPI.MAX) for key, one in mine.items()}
        if comm.rank:
            return
    print(json.dumps(result | most))


if __name__ == "__main__":
    main(sys.argv[1])
