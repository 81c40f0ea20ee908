"""`mpiexec -n RANKS icpmodel distributed`: a scene of which every rank assembles its own rows, solved on all."""

from __future__ import annotations

from typing import Any

import click

from ..distributed import by_rows, solve
from ..distributed.ranks import world
from ..errors import IcpError
from ..present.card import Card
from ..scenes import by_rows as scene_by_rows
from ..solve.solution import Status
from .arguments import SCENE, from_signature, options, pairs
from .output import AS_JSON, complain, show_json

_LIMITS = {
    "rtol": "Stop at the residual rtol * Res(0) ...",
    "atol": "... or at atol, the larger of both.",
    "max_iter": "Iterations on the finest level.",
    "time_limit": "Seconds, looked at between two iterations.",
}


@click.command()
@click.argument("scene", type=SCENE)
@click.option("--n", type=float, help="Wanted number of unknowns; the scene takes the nearest it can have.")
@click.option("--set", "parameters", multiple=True, metavar="NAME=VALUE", help="A parameter of the scene; repeatable.")
@options(*from_signature(solve, _LIMITS))
@click.option("--bound/--no-bound", default=True, help="Compute the error bound, which costs about a linear solve.")
@AS_JSON
def distributed(
    scene: str, n: float | None, parameters: tuple[str, ...], bound: bool, as_json: bool, **limits: Any
) -> int:
    """Solve SCENE on the ranks of MPI: mpiexec -n 4 icpmodel distributed membrane --n 1e7. Needs petsc4py, mpi4py."""
    comm = world()
    try:
        return _solved(comm, scene, n, parameters, bound, as_json, limits)
    except IcpError as error:  # the same one on all ranks
        return complain(str(error)) if comm.rank == 0 else 2
    except click.ClickException:
        raise
    except BaseException as error:
        # nobody knows where the other ranks are
        complain(f"rank {comm.rank} of {comm.size}: {type(error).__name__}: {error}")
        comm.Abort(130 if isinstance(error, KeyboardInterrupt) else 1)
        raise


def _solved(
    comm: Any,
    scene: str,
    n: float | None,
    parameters: tuple[str, ...],
    bound: bool,
    as_json: bool,
    limits: dict[str, Any],
) -> int:
    size = None if n is None else int(n)
    problem = by_rows(scene_by_rows(scene, size, **pairs(parameters)), comm)
    solution = solve(problem, **limits, progress=True, raise_on_failure=False)
    if bound and solution.solved:
        solution.certify()
    if comm.rank == 0:
        show_json(solution.about()) if as_json else click.echo(str(Card(solution.summary())))
        if not solution.solved:
            complain(f"not solved: {solution.status.value}")
    return 130 if solution.status is Status.INTERRUPTED else 0 if solution.solved else 1
