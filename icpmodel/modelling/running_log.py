"""Print the progress of a run: `verbose` in CVXPY, `tee` in Pyomo."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TextIO

from ..solve.progress import Progress


def printed_on(stream: TextIO, callback: Callable[[Progress], Any] | None) -> Callable[[Progress], Any]:
    """A callback that prints the residuals of the iterates 0, 1, 2, 5, 10, 20, … on `stream`, then calls `callback`.

    The logger "icpmodel" says at INFO which methods run.
    """

    def tell(state: Progress) -> Any:
        if str(state.iteration).rstrip("0") in ("", "1", "2", "5"):
            line = f"iteration {state.iteration}: residual {state.residual:.3g} after {state.seconds:.3g} s"
            print(line, file=stream, flush=True)
        return None if callback is None else callback(state)

    return tell if callback is None or callable(callback) else callback  # which solve refuses
