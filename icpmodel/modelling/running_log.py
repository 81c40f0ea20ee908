"""What a front end prints while a run goes on, where its user asks for it: `verbose` in CVXPY, `tee` in Pyomo."""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Callable, Iterator
from typing import Any, TextIO

from ..solve.progress import Progress

_LOG = logging.getLogger("icpmodel")


@contextlib.contextmanager
def log_on(stream: TextIO, callback: Callable[[Progress], Any] | None = None) -> Iterator[Callable[[Progress], Any]]:
    """While it lasts, what the logger "icpmodel" says of this thread's runs at INFO is also written to `stream`. Yields
    a callback that adds the residuals of the iterates 0, 1, 2, 5, 10, 20, …, and then calls `callback`."""

    def tell(state: Progress) -> Any:
        if str(state.iteration).rstrip("0") in ("", "1", "2", "5"):
            line = f"iteration {state.iteration}: residual {state.residual:.3g} after {state.seconds:.3g} s"
            print(line, file=stream, flush=True)
        return None if callback is None else callback(state)

    thread, level = threading.get_ident(), _LOG.level
    handler = logging.StreamHandler(stream)
    handler.setLevel(logging.INFO)
    handler.addFilter(lambda record: record.thread == thread)
    _LOG.addHandler(handler)
    if not _LOG.isEnabledFor(logging.INFO):
        _LOG.setLevel(logging.INFO)
    try:
        yield tell if callback is None or callable(callback) else callback  # which solve refuses
    finally:
        _LOG.setLevel(level)
        _LOG.removeHandler(handler)
