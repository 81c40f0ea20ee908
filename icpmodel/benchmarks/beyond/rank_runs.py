"""`distributed.solve` on ranks against the serial multilevel method and against PETSc's SNESVI, measured."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from ...errors import InputError, Interrupted
from ...numerics.arrays import as_list, as_number
from ...present.table import Table
from ...solve.progress import status_line
from ...study.cases import as_sizes
from ...study.timing import interleaved, machine
from .launched import calibrated, launched, needs_petsc
from .rank_model import Calibration
from .run_on_ranks import scene_of_ranks

#: (by, ranks) of the run that all are compared with
_SERIAL = ("serial", 0)
_CALLED = {"serial": "serial multilevel", "own": "distributed", "snesvi": "SNESVI"}
_HEADS = (
    "scene",
    "n",
    "method",
    "ranks",
    "solve, s",
    "lowest",
    "highest",
    "processor, s",
    "certificate, s",
    "iterations",
    "Krylov steps",
    "memory a rank, MiB",
    "beyond the programs, MiB",
    "time / serial",
    "SNESVI / time",
    "1 rank / time",
    "model, s",
    "model / processor",
    "note",
)
_Run = dict[str, Any] | str


def distributed_cost(
    scenes: Sequence[str] = ("membrane",),
    sizes: Sequence[int] = (10_000, 100_000, 300_000),
    *,
    ranks: Sequence[int] = (1, 2),
    repeats: int = 3,
    time_limit: float = 100.0,
    fitted: int = 500_000,
    snesvi: bool = True,
    progress: bool = False,
) -> Table:
    """`icpmodel.distributed.solve` on the ranks of MPI against the serial multilevel method and PETSc's SNESVI.

    Every run is one of processes of their own, which first solve a small problem, in turn, to Res(z) ≤ 1e-8·Res(0),
    judged by the package for all; the time is that of the solve, set-up included and assembly not, on the rank that
    takes longest, the median of the rounds; so are the ratios, round by round. "processor" is the same by the clock of
    the processor, of all threads, which is what the model foresees: the machine may do other things. SNESVI is PETSc's
    semismooth Newton method in the reduced space with BoomerAMG, which knows A and nothing of the grid; it is run once,
    and not where it would take longer than the limit by its growth. Memory is the most that a rank holds, and that less
    what it held after the small problem. A run that dies or takes too long is a row that says so. The model is that of
    `distributed_model`, from counts and times of another size.

    Parameters: `scenes` as NAME or NAME,PARAMETER=NUMBER, of those that can be assembled by rows; `sizes` wanted
    unknowns; `ranks` numbers of ranks; `repeats` rounds, ≥ 1; `time_limit` seconds for one run, its start included;
    `fitted` the unknowns of the runs that the model is made from, 0 for none; `snesvi` says whether SNESVI is run,
    which from a million unknowns takes most of the time; `progress` shows a line on what is going on.
    Returns a `Table`. Raises InputError, NotApplicable without PETSc, and Interrupted, whose `report` is the table so
    far.

    >>> icp.benchmarks.distributed_cost(["membrane"], [10_000], ranks=[1, 1])
    Traceback (most recent call last):
    icpmodel.errors.InputError: ranks is [1, 1]; different numbers were expected
    """
    texts, wanted = as_scenes_by_rows(scenes), tuple(sorted(as_sizes(sizes)))
    counts = as_ranks(ranks)
    rounds = int(as_number(repeats, "repeats", least=1, whole=True))
    limit, fitted = (
        as_number(time_limit, "time_limit", above=0.0),
        int(as_number(fitted, "fitted", least=0, whole=True)),
    )
    needs_petsc()
    title = f"To Res(z) <= 1e-8 Res(0) on ranks, set-up included ({machine()})"
    rows: list[tuple[Any, ...]] = []
    try:
        with status_line(progress) as say:
            for text in texts:
                say(f"{text}: what the model is made from")
                model = calibrated(text, fitted, limit) if fitted and counts else None
                slow: dict[int, tuple[int, float]] = {}
                for n in wanted:
                    runs = _measured(text, n, counts, rounds, limit, say)
                    if snesvi:
                        runs |= _of_snesvi(text, n, counts, limit, slow, say)
                    rows += _rows(text, n, runs, model)
    except KeyboardInterrupt:
        raise Interrupted(Table(title, _HEADS, tuple(rows))) from None
    return Table(title, _HEADS, tuple(rows))


def as_scenes_by_rows(texts: Any) -> tuple[str, ...]:
    """The `texts` of scenes that can be assembled by rows. Raises InputError."""
    listed = tuple(as_list(texts, "scenes"))
    for text in listed:
        scene_of_ranks(text, 100)
    return listed


def as_ranks(ranks: Any) -> tuple[int, ...]:
    """Numbers of ranks, each once. Raises InputError."""
    found = [int(as_number(one, "ranks", least=1, whole=True)) for one in as_list(ranks, "ranks")]
    if len(set(found)) < len(found):
        raise InputError(f"ranks is {found}; different numbers were expected")
    return tuple(sorted(found))


def _measured(
    text: str, n: int, ranks: tuple[int, ...], rounds: int, limit: float, say: Callable[[str], None]
) -> dict[tuple[str, int], list[_Run]]:
    """(by, ranks) → its runs, of the serial method and of `solve`."""
    names = [_SERIAL, *(("own", one) for one in ranks)]
    calls = {name: partial(launched, name[0], text, n, name[1], limit) for name in names}
    found: defaultdict[tuple[str, int], list[_Run]] = defaultdict(list)
    for name, run in interleaved(calls, rounds, say=lambda done: say(f"{text}, n = {n}: round {done} of {rounds}")):
        found[name].append(run)
    return found


def _of_snesvi(
    text: str,
    n: int,
    ranks: tuple[int, ...],
    limit: float,
    slow: dict[int, tuple[int, float]],
    say: Callable[[str], None],
) -> dict[tuple[str, int], list[_Run]]:
    """The same of SNESVI. `slow` has its last size and time by ranks, and gets those of this one."""
    found: dict[tuple[str, int], list[_Run]] = {}
    for one in ranks:
        say(f"{text}, n = {n}: SNESVI on {one}")
        m, seconds = slow.get(one, (n, 0.0))
        # its steps grow with the free boundary, each with n
        expected = seconds * n / m
        last: _Run = (
            f"would take more than {expected:.2g} s" if expected > limit else launched("snesvi", text, n, one, limit)
        )
        found["snesvi", one] = [last]
        slow[one] = (n, limit if isinstance(last, str) else max(last["seconds"], seconds))
    return found


def _rows(
    text: str, n: int, runs: dict[tuple[str, int], list[_Run]], model: Calibration | str | None
) -> list[tuple[Any, ...]]:
    times = {name: np.array([_of(run, "seconds") for run in many]) for name, many in runs.items()}
    rows = []
    for (by, ranks), many in runs.items():
        good = [run for run in many if isinstance(run, dict)]
        notes = [run if isinstance(run, str) else run["status"] for run in many]
        note = next((one for one in notes if one != "solved"), "")
        head = (text, good[0]["n"] if good else n, _CALLED[by], ranks or None)
        if not np.isfinite(times[by, ranks]).any():
            rows.append((*head, *(None,) * (len(_HEADS) - 5), note))
            continue
        took = times[by, ranks]
        middle = {
            key: float(np.median([run[key] for run in good])) for key in ("cpu", "certificate", "memory", "beyond")
        }
        predicted = model.seconds(good[0]["n"], ranks) if by == "own" and isinstance(model, Calibration) else None
        steps = (good[0]["iterations"], good[0]["krylov"])
        rows.append(
            (
                *head,
                *(float(f(took)) for f in (np.nanmedian, np.nanmin, np.nanmax)),
                middle["cpu"],
                middle["certificate"],
                *steps,
                *(middle[key] / 2**20 for key in ("memory", "beyond")),
                _ratio(took, times[_SERIAL]),
                _ratio(times.get(("snesvi", ranks)), took) if by == "own" else None,
                _ratio(times.get((by, 1)), took) if by == "own" and ranks > 1 else None,
                predicted,
                None if predicted is None else predicted / middle["cpu"],
                note,
            )
        )
    return rows


def _of(run: _Run, name: str) -> float:
    return np.nan if isinstance(run, str) or run["status"] != "solved" else float(run[name])


def _ratio(one: Any, other: Any) -> float | None:
    """The median of one/other, round by round where both were run in rounds; None where there is none."""
    if one is None or other is None or not (np.isfinite(one).any() and np.isfinite(other).any()):
        return None
    quotient = one / other if one.size == other.size else np.nanmedian(one) / np.nanmedian(other)
    return float(np.nanmedian(quotient)) if np.isfinite(quotient).any() else None
