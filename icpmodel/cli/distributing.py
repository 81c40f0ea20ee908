"""`mpiexec -n RANKS icpmodel distributed`: every rank makes or reads its own rows of a problem; all ranks solve it."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import click

from ..distributed import DistributedSolution, by_rows, load_problem, save_solution, solve
from ..distributed.files_on_ranks import WRITABLE_SUFFIXES, check_place_on_ranks, vector_in
from ..distributed.ranks import FailedOnRank, together, world
from ..errors import IcpError
from ..present.card import Card
from ..scenes import by_rows as scene_by_rows
from ..solve.solution import Status
from .arguments import SOURCE_OPTIONS, from_signature, named_source, note_size, options
from .output import AS_JSON, complain, show_json, wrote

_LIMITS = ("rtol", "atol", "max_iter", "time_limit")

#: seconds within which rank 0 reports the error that ended all ranks
_MESSAGE_SECONDS = 0.5


class _OnRanks(click.Command):
    """A command for which only rank 0 reports wrong arguments."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        try:
            return super().parse_args(ctx, args)
        except click.UsageError:
            if world().rank:
                raise click.exceptions.Exit(2) from None
            raise


@click.command(
    cls=_OnRanks,
    epilog="""SOURCE is the name of a scene that is assembled by rows, or a file of --save-problem. Without SOURCE give
--A and --q, and --psi and --upper for obstacles other than 0. Each rank reads its rows of .bin files (PETSc's), and
rank 0 all other files.""",
)
@options(*SOURCE_OPTIONS)
@click.option("--z0", "z0_file", type=click.Path(), help="Start from the vector in this file.")
@options(*from_signature(solve, *_LIMITS))
@click.option("--bound/--no-bound", default=True, help="Compute the error bound, which costs about a linear solve.")
@click.option(
    "-o", "--output", type=click.Path(), help=f"Write the answer to this file, {' or '.join(WRITABLE_SUFFIXES)}."
)
@AS_JSON
def distributed(as_json: bool, **arguments: Any) -> int:
    """Solve the problem SOURCE on MPI ranks: mpiexec -n 4 icpmodel distributed membrane --n 1e7.

    Needs petsc4py and mpi4py.
    """
    comm = world()
    with _ended_together(comm):
        try:
            return _carried_out(comm, as_json, arguments)
        except (IcpError, FailedOnRank) as error:  # the same error on all ranks
            code = 1 if isinstance(error, FailedOnRank) else 2
            return complain(str(error), code) if comm.rank == 0 else code


@contextmanager
def _ended_together(comm: Any) -> Iterator[None]:
    """A block whose failure on one rank ends all ranks, since the others may wait for it.

    Rank 0 reports its error at once; another rank waits 0.5 s first, for rank 0 to end the run. mpiexec
    sends SIGTERM to all ranks after Ctrl-C, and after the end of one.
    """
    sent = list[int]()

    def stop(signum: int, frame: Any) -> None:
        sent.append(signum)
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    except BaseException as error:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        interrupted = isinstance(error, KeyboardInterrupt)
        if comm.rank and not sent:
            time.sleep(_MESSAGE_SECONDS)
        if not (comm.rank and sent):
            where = (
                "interrupted" if interrupted else f"rank {comm.rank} of {comm.size}: {type(error).__name__}: {error}"
            )
            complain(where)
        if sent:  # mpiexec ends the other ranks itself, and would print more after `Abort`
            os._exit(130)
        comm.Abort(130 if interrupted else 1)
    finally:
        signal.signal(signal.SIGTERM, before)


def _carried_out(comm: Any, as_json: bool, arguments: dict[str, Any]) -> int:
    """Solve, save, certify and print; return the exit code of this rank. Collective."""
    solution = _solve(comm, arguments)
    first = comm.rank == 0
    if arguments["output"] is not None:  # before the bound, which Ctrl-C may end
        save_solution(solution, arguments["output"])
        if first:
            wrote(arguments["output"])
    if arguments["bound"] and solution.solved:
        solution.certify()
    if first:
        show_json(solution.about()) if as_json else click.echo(str(Card(solution.summary())))
        if not solution.solved:
            complain(f"not solved: {solution.status.value}")
    return 130 if solution.status is Status.INTERRUPTED else 0 if solution.solved else 1


def _solve(comm: Any, arguments: dict[str, Any]) -> DistributedSolution:
    """Make or read the problem, and solve it. Collective."""
    output = arguments["output"]
    z0_file = arguments["z0_file"]
    with together(comm):
        named = named_source(arguments)
    if output is not None:
        check_place_on_ranks(output, comm)
    if named.scene is None:
        problem = load_problem(*named.files)
    else:
        with together(comm):
            assembly = scene_by_rows(named.scene, named.n, **named.parameters)
        if comm.rank == 0:
            note_size(named, assembly.n)
        problem = by_rows(assembly, comm)
    z0 = None if z0_file is None else problem.vector(vector_in(z0_file, problem.A, "z0"))
    limits = {name: arguments[name] for name in _LIMITS}
    return solve(problem, z0=z0, **limits, progress=True, raise_on_failure=False)
