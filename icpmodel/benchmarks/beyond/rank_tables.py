"""What a solve on ranks sends, by step and by level, and what the model makes of that for ranks that are not here."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ...errors import InputError
from ...numerics.arrays import as_number
from ...present.table import Table
from ...study.timing import machine
from .launched import calibrated, launched, needs_petsc
from .rank_model import LevelShape, Machine, spread
from .rank_runs import as_ranks, as_scenes_by_rows

#: what is counted, in words
_NAMES = {
    "steps": "a Krylov step",
    "cycle": "the V-cycle in it",
    "looks": "a look",
    "sweeps": "a round of sweeps",
    "masks": "a new active set",
}
#: what an iteration on the finest level does besides Krylov's steps
_ITERATION = "an iteration"
_GIB = 2.0**30
#: what the time consists of, in the order of `Spent`
_PARTS = ("making levels", "work", "searches", "levels", "messages", "bytes", "reductions")
_HEADS = (
    "ranks",
    "rows a rank",
    "memory a rank, GiB",
    *(f"{name}, s" for name in _PARTS),
    "in all, s",
    "efficiency",
    "messages a rank",
    "MiB a rank",
    "reductions",
    "most is",
)


def distributed_counts(scene: str = "membrane", n: int = 100_000, ranks: int = 2, time_limit: float = 100.0) -> Table:
    """What a rank sends, reduces and takes in each part of a solve on ranks, and how the levels are spread.

    Messages and bytes are those that PETSc's log counts, of the rank that has the most, and so are reductions. An
    iteration is all that the finest level did, divided by the iterations: Krylov steps, looks, sweeps and masks. Of
    each level the table has the ghosts, unknowns of other ranks that a product needs, and how many ranks these are on,
    as they are here and as the model has them. The coarsest level is solved by every rank, from all of its rows.

    Parameters: `scene` as NAME or NAME,PARAMETER=NUMBER; `n` wanted unknowns; `ranks`, which need not have cores of
    their own where it is counts that matter; `time_limit` seconds. Returns a `Table`. Raises InputError, NotApplicable
    without PETSc.

    >>> icp.benchmarks.distributed_counts("membrane", n=10_000, ranks=0)
    Traceback (most recent call last):
    icpmodel.errors.InputError: ranks is 0; a whole number >= 1 was expected
    """
    (text,), (many,) = as_scenes_by_rows([scene]), as_ranks([ranks])
    size = int(as_number(n, "n", least=1, whole=True))
    needs_petsc()
    told = launched("counts", text, size, many, as_number(time_limit, "time_limit", above=0.0))
    if isinstance(told, str) or not told["shapes"]:
        raise InputError(f"{text}, n = {size}: {told if isinstance(told, str) else 'PETSc makes no levels of it'}")
    done, parts = {(what, level): count for what, level, count in told["done"]}, told["parts"]
    rounds = max(done.get(("looks", 0), 1) - 1, 1)
    whole = {
        key: sum(done.get((what, 0), 0) * parts[what][key] for what in parts if what != "cycle") / rounds
        for key in ("messages", "bytes", "reductions", "seconds")
    }
    rows: list[tuple[Any, ...]] = []
    for name, part in ((_ITERATION, whole), *((_NAMES[what], part) for what, part in parts.items())):
        sent = (part["messages"], part["bytes"], part["reductions"], 1e3 * part["seconds"])
        rows.append((name, *sent, None, None, None, None, None))
    for k, shape in enumerate(told["shapes"]):
        here = (
            shape["rows"] / many,
            (shape["entries"] + shape["transfer"]) / many,
            shape["ghosts"],
            shape["neighbours"],
        )
        # what one side asks for, as the model takes it from two ranks
        side = LevelShape(shape["rows"], shape["entries"], shape["transfer"], shape["ghosts"] / (2 if many > 2 else 1))
        rows.append((f"level {k}", None, None, None, None, *here, spread(side, many)[0]))
    heads = ("part", "messages", "bytes", "reductions", "ms", "rows a rank", "entries a rank", "ghosts", "neighbours")
    title = f"{text}, n = {told['n']}, on {many} rank{'s' if many > 1 else ''} ({machine()})"
    return Table(title, (*heads, "neighbours by the model"), tuple(rows))


def distributed_model(
    scene: str = "membrane",
    n: float = 1e9,
    *,
    ranks: Sequence[int] = (16, 256, 4096),
    fitted: int = 1_000_000,
    latency: float = 2e-6,
    bandwidth: float = 1e9,
    memory: float = 3.2e9,
    time_limit: float = 300.0,
) -> Table:
    """The expected time, and memory, of a solve with n unknowns on ranks that are not here, on paper.

    The levels, the counts and the prices of all that one rank does are those of runs here, on one rank and on two, at
    about `fitted` and at 2 000 unknowns; see `distributed_counts`. Work takes as many times as long as products get
    less from memory there than here. The default machine: 2 µs between neighbours is what was required of the network
    of Red Storm (Brightwell et al., 2005) and more than InfiniBand needs now; 3.2 GB/s are the share of a core in a
    node of 128 with 16 channels of DDR4-3200, 25.6 GB/s each; and with 1 GB/s a rank twelve ranks of a node fill a
    network of 100 Gb/s, where most neighbours are in the same node. To the latency comes what PETSc needs for a
    message, as measured here, and searches, where hypre makes the levels without tables, take as long as here.

    Parameters: `scene` as NAME or NAME,PARAMETER=NUMBER; `n` unknowns; `ranks` numbers of ranks; `fitted` unknowns of
    the runs here, better more than fit into caches; `latency` seconds of a message there; `bandwidth` bytes a second
    between two ranks; `memory` bytes a second of a rank from memory; `time_limit` seconds for one run. Returns a
    `Table` (seconds). Raises InputError, NotApplicable without PETSc.

    >>> icp.benchmarks.distributed_model("membrane", n=1e9, latency=0.0)
    Traceback (most recent call last):
    icpmodel.errors.InputError: latency is 0.0; a finite number > 0 was expected
    """
    (text,), many = as_scenes_by_rows([scene]), as_ranks(ranks)
    n, limit = as_number(n, "n", least=1), as_number(time_limit, "time_limit", above=0.0)
    latency, bandwidth, memory = (
        as_number(value, name, above=0.0)
        for value, name in ((latency, "latency"), (bandwidth, "bandwidth"), (memory, "memory"))
    )
    needs_petsc()
    model = calibrated(text, int(as_number(fitted, "fitted", least=1, whole=True)), limit)
    if isinstance(model, str):
        raise InputError(model)
    there = Machine(latency + model.overhead, 1.0 / bandwidth, model.bandwidth / memory)
    rows, first = [], None
    for one in many:
        expected = model.expected(n, one, there)
        first = first or expected.seconds * one
        parts = dict(zip(_PARTS, expected[: len(_PARTS)], strict=True))
        rows.append(
            (
                one,
                n / one,
                (model.memory * n / one + model.programs) / _GIB,
                *parts.values(),
                expected.seconds,
                first / (expected.seconds * one),
                expected.sent,
                expected.size / 2**20,
                expected.rounds,
                max(parts, key=lambda name: parts[name]),
            )
        )
    by = f"by runs with n = {model.shapes[0].rows:.0f} here"
    prices = (
        f"a message {there.message:.2g} s, a byte {there.byte:.2g} s, work {there.slower:.2g} times as long as here"
    )
    title = f"{text}, n = {n:g}, {len(model.levels(n))} levels, {by}; {prices} ({machine()})"
    return Table(title, _HEADS, tuple(rows))
