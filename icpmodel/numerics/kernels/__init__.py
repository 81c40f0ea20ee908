"""Compiled loops. Importing this room loads numba, so the rest of the package imports it inside functions.

Positions are unsigned (`uint`): a signed one makes numba look for a negative index at every access, which costs a
third of a sweep. Of the fast-math flags "contract" is set, which lets a·b + c be fused, and "reassoc" where only inner
products are summed; both leave NaN and infinities alone.

Loops over the entries of a row increment by `one()`, so that LLVM cannot unroll them. Rows have few entries, and the
choice among eight unrolled copies takes up to a third of a sweep. Consecutive entries, as in full rows, are multiplied
as an inner product of two pieces of memory. That takes a third to an eighth of the time (n = 3000 … 800).
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import sys
import warnings
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.event import Listener, register
from numba.extending import intrinsic

from ...errors import IcpError
from ..plugins import in_notebook
from ..work import COMPILER

if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
    raise IcpError("NUMBA_DISABLE_JIT is set, and the loops of icpmodel exist only as compiled code; unset it")
_LOG = logging.getLogger("icpmodel.compiler")
#: a position in an array
uint = np.uint64
_OPTIONS: dict[str, Any] = {"fastmath": {"contract"}, "error_model": "numpy", "nogil": True}
_SUMS: dict[str, Any] = _OPTIONS | {"fastmath": {"contract", "reassoc"}}
#: the least number of adjacent entries that are summed by vector instructions, in two fifths of the time of a loop
_MIN_VECTOR_LENGTH = uint(16)

#: a function that becomes part of the compiled ones that call it
inlined = numba.njit(forceinline=True, **_OPTIONS)
#: a function that compiled ones call, and one in which sums may be added up in another order
compiled_helper = numba.njit(**_OPTIONS)
reassociated_helper = numba.njit(**_SUMS)


class _CacheFiles(IndexDataCacheFile):
    """numba's cache files of a function, safe against processes that compile at the same time.

    numba numbers the files, and such processes may choose the same number. The index then leads a third process to code
    that was compiled for other types. Here the number is a hash of the key, and a file is written before the index.
    """

    def save(self, key: Any, data: Any) -> None:
        overloads = self._load_index()
        number = int.from_bytes(hashlib.sha256(repr(key).encode()).digest()[:8])
        overloads[key] = self._data_name(number)
        self._save_data(overloads[key], data)
        self._save_index(overloads)


class Cache(FunctionCache):
    """Compiled code on disk. Where it cannot be read or written the process compiles for itself."""

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        locator = self._impl.locator
        self._cache_file = _CacheFiles(self._cache_path, self._impl.filename_base, locator.get_source_stamp())

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the code, or None where it cannot be read."""
        try:
            return super().load_overload(sig, target_context)
        except Exception:
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write the code; warn where that fails, for example on a full disk."""
        try:
            super().save_overload(sig, data)
        except Exception as error:
            advice = "every process compiles again; NUMBA_CACHE_DIR may name another folder"
            warnings.warn(f"compiled code cannot be kept in {self.cache_path} ({error}): {advice}", stacklevel=2)


def _announce(what: str) -> None:
    if sys.stderr is not None and (in_notebook() or sys.stderr.isatty()):
        print(f"icpmodel {what}", file=sys.stderr)
    else:  # standard error may be a file for something else: its owner, or a command, switches the log on
        _LOG.info(what)


class _CompilerListener(Listener):
    """A listener to numba: it stops the clock of runs while numba compiles, and announces that on standard error."""

    announced = False

    def on_start(self, event: Any) -> None:
        if event.kind == _LOCK:
            COMPILER.begin()
        elif not _CompilerListener.announced and _is_of_icpmodel(event.data["dispatcher"].py_func):
            _CompilerListener.announced = True
            _announce("compiles loops, each once per installation")

    def on_end(self, event: Any) -> None:
        if event.kind == _LOCK:
            COMPILER.end()


def _is_of_icpmodel(function: Any) -> bool:
    module = function.__module__  # None where code was generated
    return module is not None and module.startswith("icpmodel.")


_LOCK = "numba:compiler_lock"
_COMPILE = "numba:compile"
_listener = _CompilerListener()
register(_LOCK, _listener)
register(_COMPILE, _listener)


def _one(typing_context: Any) -> Any:
    # the position 1, hidden from LLVM as the output of an empty piece of assembler
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word = ir.IntType(64)
        return builder.asm(ir.FunctionType(word, [word]), "", "=r,0", [ir.Constant(word, 1)], side_effect=False)

    return numba.uint64(), generate


one: Any = intrinsic(_one)


@inlined
def run_end(k, stop, indices):
    # returns stop if the entries k <= e < stop of a row, whose indices rise, are many and adjacent, else k. (A call of
    # a function that is not inlined needs an `if` of its own: a return from within one costs 50 ns.)
    end = k
    if stop >= k + _MIN_VECTOR_LENGTH:
        last = stop - uint(1)
        if uint(indices[last]) - uint(indices[k]) == last - k:
            end = stop
    return end


@reassociated_helper
def _run_sum(total, k, stop, j, data, z):
    for e in range(stop - k):
        total += data[k + e] * z[j + e]
    return total


@reassociated_helper
def two_run_sums(k, stop, j, data, z, y):
    # the sums of data_e z_e and of data_e y_e over a run that begins with column j
    first = 0.0
    second = 0.0
    for e in range(stop - k):
        first += data[k + e] * z[j + e]
        second += data[k + e] * y[j + e]
    return first, second


@inlined
def row_sum(total, k, stop, indices, data, z):
    # total + the sum of data_e z_(indices_e) over k <= e < stop; the indices rise
    k = uint(k)
    stop = uint(stop)
    end = run_end(k, stop, indices)
    if end > k:
        total = _run_sum(total, k, end, uint(indices[k]), data, z)
        k = end
    while k < stop:
        total += data[k] * z[uint(indices[k])]
        k += one()
    return total


def compiled(function: Any, *, reassociate: bool = False, exact: bool = False) -> Any:
    """`function` compiled by numba; the code is kept on disk between runs.

    With `reassociate` sums may be added up in another order, which lets inner products run in vector instructions. With
    `exact` every operation is rounded by itself.
    """
    options = _OPTIONS | {"fastmath": False} if exact else _SUMS if reassociate else _OPTIONS
    code = numba.njit(function, **options)
    # without a writable folder for its cache numba raises; then every process compiles anew
    with contextlib.suppress(RuntimeError, OSError):
        code._cache = Cache(function)  # as its `enable_caching` does
    return code
