"""The smallest trial that still shows a lie: fewer questions, fewer rows, simpler numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from .trial import Trial, tuples


def shrunk(trial: Trial, shows: Callable[[Trial], bool], tries: int) -> Trial:
    """A trial of which none of the simpler ones that `_simpler` knows `shows` the lie, after `tries` at the most."""
    simpler = _simpler(trial)
    while tries > 0 and (one := next(simpler, None)) is not None:
        tries -= 1
        if shows(one):
            trial, simpler = one, _simpler(one)
    return trial


def _simpler(trial: Trial) -> Iterator[Trial]:
    """Trials that are simpler by one step each, the largest steps first."""
    if trial.raising:
        yield replace(trial, raising=False)
    for k in range(len(trial.options)):
        yield replace(trial, options=trial.options[:k] + trial.options[k + 1 :])
    if trial.asked:
        yield replace(trial, asked="")
    if trial.source:
        return
    if trial.upper:
        yield replace(trial, upper="", d=(), H=(), known=None)
    if trial.front == "file":
        yield replace(trial, front="solve")
    if trial.method is not None:
        yield replace(trial, method=None)
    yield from (_without(trial, k) for k in range(len(trial.q)) if len(trial.q) > 1)
    if trial.front == "cvxpy":
        for k in range(trial.equal, len(trial.c) if len(trial.c) > 1 else 0):
            yield replace(trial, c=_dropped(trial.c, k), G=_dropped(trial.G, k))
    if trial.psi not in ("zero", "constant") and trial.front != "cvxpy":
        yield replace(trial, psi="zero", known=None)
    if trial.upper not in ("", "constant"):
        yield replace(trial, upper="constant", known=None)
    trial = replace(trial, known=None)
    parts = {part: np.array(getattr(trial, part)) for part in ("A", "q", "c", "G", "d", "H") if getattr(trial, part)}
    for digits in (0, 1, 2, 4):
        for part, values in parts.items():
            rounded = np.vectorize(partial(_rounded, digits=digits), otypes=[np.float64])(values)
            if not np.array_equal(rounded, values):
                yield replace(trial, **{part: tuples(rounded)})
    for part, values in parts.items():
        for k, x in enumerate(values.ravel().tolist()):
            for simple in (0.0, 1.0, -1.0, _rounded(x, 0), _rounded(x, 1), _rounded(x, 3)):
                if _weight(simple) < _weight(x):
                    other = values.copy()
                    other.flat[k] = simple
                    yield replace(trial, **{part: tuples(other)})


def _without(trial: Trial, k: int) -> Trial:
    """The trial without the unknown `k`, and its row if it has one."""
    A, q = tuple(_dropped(row, k) for row in _dropped(trial.A, k)), _dropped(trial.q, k)
    program = trial.front == "cvxpy"
    G, c = (trial.G, trial.c) if program else (_dropped(trial.G, k), _dropped(trial.c, k))
    d, H = _dropped(trial.d, k), tuple(_dropped(row, k) for row in _dropped(trial.H, k))
    return replace(trial, A=A, q=q, c=c, G=tuple(_dropped(row, k) for row in G), d=d, H=H, known=None)


def _dropped(values: tuple[Any, ...], k: int) -> tuple[Any, ...]:
    return values[:k] + values[k + 1 :]


def _rounded(x: float, digits: int) -> float:
    """To so many significant digits after the first; 0: to the next power of ten."""
    if x == 0.0 or abs(x) == float("inf"):
        return x
    return float(f"{x:.{digits}e}") if digits else float(f"{x / abs(x):.0f}e{f'{abs(x):e}'.partition('e')[2]}")


def _weight(x: float) -> tuple[int, bool, bool]:
    """How much there is to read in a number."""
    return len(f"{x!r}".replace(".0", "").replace("e", " " * 10)), x != 0.0, x < 0.0
