"""What a front end prints while a run goes on, where its user asks for it: `verbose` in CVXPY, `tee` in Pyomo."""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Callable, Iterator
from typing import Any, TextIO

from ..solve.progress import Progress

_LOG = logging.getLogger("icpmodel")


class _Onward(logging.Handler):
    """Gives the handlers above the logger what they would get if nobody had asked for more."""

    def emit(self, record: logging.LogRecord) -> None:
        if _LOG.parent is not None:
            _LOG.parent.handle(record)


_ONWARD = _Onward()
#: how many runs are told of, and the level of the logger without them
_LOCK, _runs, _level = threading.Lock(), 0, logging.NOTSET


@contextlib.contextmanager
def log_on(stream: TextIO, callback: Callable[[Progress], Any] | None = None) -> Iterator[Callable[[Progress], Any]]:
    """While it lasts, what the logger "icpmodel" says of this thread's runs at INFO is also written to `stream`. Yields
    a callback that adds the residuals of the iterates 0, 1, 2, 5, 10, 20, …, and then calls `callback`."""

    def tell(state: Progress) -> Any:
        if str(state.iteration).rstrip("0") in ("", "1", "2", "5"):
            line = f"iteration {state.iteration}: residual {state.residual:.3g} after {state.seconds:.3g} s"
            print(line, file=stream, flush=True)
        return None if callback is None else callback(state)

    global _runs, _level
    thread = threading.get_ident()
    handler = logging.StreamHandler(stream)
    handler.setLevel(logging.INFO)
    handler.addFilter(lambda record: record.thread == thread)
    with _LOCK:
        if not _runs:
            _level, _LOG.propagate = _LOG.level, False
            _ONWARD.setLevel(_LOG.getEffectiveLevel())
            _LOG.addHandler(_ONWARD)
        _runs += 1
        _LOG.addHandler(handler)
        if not _LOG.isEnabledFor(logging.INFO):
            _LOG.setLevel(logging.INFO)
    try:
        yield tell if callback is None or callable(callback) else callback  # which solve refuses
    finally:
        with _LOCK:
            _runs -= 1
            _LOG.removeHandler(handler)
            if not _runs:
                _LOG.removeHandler(_ONWARD)
                _LOG.propagate = True
                _LOG.setLevel(_level)
