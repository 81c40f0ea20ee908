"""One run of a comparison, in processes of its own, see `launched`: `main`, alone or under mpiexec, takes a job in JSON
as its argument; rank 0 prints what was measured as JSON."""

from __future__ import annotations

import faulthandler
import json
import resource
import sys
import time
from typing import Any

import numpy as np

from ...distributed import DistributedICP, by_rows, certify, solve
from ...distributed.ranks import largest, petsc, world
from ...scenes import by_rows as scene_by_rows
from ...solve.goal import RTOL
from ...study.cases import built
from .rank_counts import counted, searched

#: a problem of so many unknowns is solved before anything is measured: it loads and compiles
_WARM = 400
#: bytes in a unit of `ru_maxrss`
_UNIT = 1 if sys.platform == "darwin" else 1024


class _Clock:
    """Seconds, of the wall and of the processor, since it was made or asked last."""

    def __init__(self) -> None:
        self.mark = time.perf_counter(), time.process_time()

    def lap(self) -> tuple[float, float]:
        now = time.perf_counter(), time.process_time()
        laps = now[0] - self.mark[0], now[1] - self.mark[1]
        self.mark = time.perf_counter(), time.process_time()
        return laps


def scene_of_ranks(text: str, n: int) -> Any:
    """The scene NAME or NAME,PARAMETER=NUMBER,… by rows. Raises InputError."""
    name, *pairs = text.split(",")
    given = {key: float(value) for key, _, value in (pair.partition("=") for pair in pairs)}
    return scene_by_rows(name, n, **{key: int(x) if x.is_integer() else x for key, x in given.items()})


def peak() -> float:
    """The most memory that this process has held so far, bytes."""
    return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * _UNIT)


def by_serial(text: str, n: int) -> dict[str, Any]:
    """`Multilevel` in one process, the hierarchy built."""
    built(text, _WARM).problem.solve("multilevel", raise_on_failure=False).certificate.bound  # noqa: B018
    before, clock = peak(), _Clock()
    problem = built(text, n).problem
    clock.lap()
    solution = problem.solve("multilevel", raise_on_failure=False)
    seconds, cpu = clock.lap()
    memory = peak()
    clock.lap()
    solution.certificate.bound  # noqa: B018
    certificate, _ = clock.lap()
    told = {"n": problem.n, "status": solution.status.value, "iterations": solution.iterations, "krylov": None}
    return told | {
        "seconds": seconds,
        "cpu": cpu,
        "certificate": certificate,
        "memory": memory,
        "beyond": memory - before,
    }


def on_ranks(text: str, n: int, by: str) -> dict[str, Any]:
    """`solve` on all ranks, or SNESVI, `by` name; the numbers are those of the rank that has the most."""
    comm = world()
    run = _own if by == "own" else _snesvi
    run(by_rows(scene_of_ranks(text, _WARM)))
    before = peak()
    comm.Barrier()
    clock = _Clock()
    problem = by_rows(scene_of_ranks(text, n))
    comm.Barrier()
    clock.lap()
    told, certified = run(problem)
    seconds, cpu = clock.lap()
    memory = peak()
    comm.Barrier()
    clock.lap()
    certified()
    certificate, _ = clock.lap()
    most = largest(comm, seconds, cpu, certificate, memory, memory - before)
    names = ("seconds", "cpu", "certificate", "memory", "beyond")
    return told | {"n": problem.n} | dict(zip(names, most, strict=True))


def _own(problem: DistributedICP) -> tuple[dict[str, Any], Any]:
    solution = solve(problem, raise_on_failure=False)
    told = {"status": solution.status.value, "iterations": solution.iterations, "krylov": solution.krylov_steps}
    return told, solution.certify


def _snesvi(problem: DistributedICP) -> tuple[dict[str, Any], Any]:
    """PETSc's semismooth Newton method in the reduced space, conjugate gradients (GMRES where A is not symmetric) and
    BoomerAMG (GAMG where hypre is not built in) of A alone, from z = 0 until Res(z) ≤ 1e-8·Res(0)."""
    PETSc = petsc()
    A, q, z = problem.A, problem.vector(problem.q), problem.vector()
    wanted = RTOL * problem.residual(z)
    snes = PETSc.SNES().create(problem.comm)
    snes.setType("vinewtonrsls")

    def function(_: Any, x: Any, f: Any) -> None:
        A.multAdd(x, q, f)

    def ended(it: Any, count: int, norms: Any) -> int:
        reason = PETSc.SNES.ConvergedReason
        return int(reason.CONVERGED_FNORM_ABS if problem.residual(it.getSolution()) <= wanted else reason.ITERATING)

    snes.setFunction(function, problem.vector())
    snes.setJacobian(lambda *_: None, A, A)
    low = problem.psi.fixed()
    high = np.full(low.size, np.inf) if problem.upper is None else problem.upper.fixed()
    snes.setVariableBounds(problem.vector(low), problem.vector(high))
    snes.setConvergenceTest(ended)
    snes.setTolerances(max_it=10_000)
    ksp = snes.getKSP()
    ksp.setType("cg" if problem.matrix.is_symmetric else "gmres")
    ksp.getPC().setType("hypre" if PETSc.Sys.hasExternalPackage("hypre") else "gamg")
    snes.solve(None, z)
    solved = problem.residual(z) <= wanted
    told = {"status": "solved" if solved else f"not solved, reason {snes.getConvergedReason()}"}
    told |= {"iterations": snes.getIterationNumber(), "krylov": snes.getLinearSolveIterations()}
    return told, lambda: certify(problem, z)


def main() -> None:
    """The job of the command line."""
    job = json.loads(sys.argv[1])
    # what waits for another rank inside of MPI hears no signal
    faulthandler.dump_traceback_later(job["limit"], exit=True)
    by, text, n = job["by"], job["scene"], job["n"]
    if by == "serial":
        print(json.dumps(by_serial(text, n)))
        return
    if by == "search":
        told = {"search": searched()}
    else:
        told = counted(scene_of_ranks(text, n)) if by == "counts" else on_ranks(text, n, by)
    if world().rank == 0:
        print(json.dumps(told))
