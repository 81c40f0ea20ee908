"""The functions that JAX calls back, with NumPy arrays and outside its own threads: solves and derivatives."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from math import prod
from threading import RLock, get_ident
from typing import Any, TypeAlias

import numpy as np

from ...derivatives.derivative import Derivative
from ...errors import IcpError, MapError, SingularOperator
from ...numerics.arrays import Vector
from ...numerics.threads import one_blas_thread
from ...problem.affine import Constant
from ...problem.data import ProblemData
from ...solve.driver import solve
from ...solve.many import solve_many
from ...solve.solution import Solution, Status
from .argument_forms import Argument, Shape, obstacles, the_package

#: argument → its arrays, and argument → the shapes of a single one of each
Arrays: TypeAlias = dict[str, tuple[Any, ...]]
Shapes: TypeAlias = dict[str, tuple[Shape, ...]]
#: the statuses with which z is an answer
_ANSWERS = (Status.SOLVED, Status.PRECISION_LIMIT)


@lru_cache(maxsize=1)
def worker_threads() -> tuple[ThreadPoolExecutor, ThreadPoolExecutor]:
    """Two pools of threads that round like the user's thread, which must make the first call.

    Threads of JAX flush subnormal numbers to zero, and so do threads that they start. So the one thread of the first
    pool starts those of the second, one for each call that waits at a time: a user's map may call another layer.
    """
    first = ThreadPoolExecutor(1, "icpmodel")
    first.submit(int).result()
    return first, ThreadPoolExecutor(sys.maxsize, "icpmodel")


def in_worker_thread(call: Callable[..., Any], *arguments: Any) -> Any:
    """Run `call` in a thread of `worker_threads` and return its result."""
    first, others = worker_threads()
    thread: list[int] = []
    answer = first.submit(others.submit, _in_float64, thread, call, *arguments).result()
    try:
        return answer.result()
    except KeyboardInterrupt:  # Python interrupts only this thread, which waits
        for ident in thread:
            ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(ident), ctypes.py_object(KeyboardInterrupt))
        return answer.result()


def _in_float64(thread: list[int], call: Callable[..., Any], *arguments: Any) -> Any:
    thread.append(get_ident())
    try:
        # a user's map may compute with JAX, whose setting may hold in one thread only
        with the_package().enable_x64(True):
            return call(*arguments)
    finally:
        thread.clear()


def _renew_threads() -> None:
    """Threads do not survive a fork."""
    if worker_threads.cache_info().currsize:
        worker_threads.cache_clear()
        worker_threads()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renew_threads)


class LastDerivative:
    """The derivative that was used last, with its factors; its `key` is the bytes of its arrays and z."""

    def __init__(self) -> None:
        self.lock = RLock()
        self.forget()

    def forget(self) -> None:
        """Forget the derivative."""
        self.key: tuple[tuple[str, bytes], ...] = ()
        self.derivative: Derivative | None = None


class MappedArrays:
    """The arrays of a callback, with batch axes if JAX has mapped over them: one problem per index of `batch_shape`.

    `shapes` are those of a single problem.
    """

    def __init__(self, arrays: Arrays, shapes: Shapes) -> None:
        parts = [
            (name, np.asarray(one), shape)
            for name, several in arrays.items()
            for one, shape in zip(several, shapes[name], strict=True)
        ]
        self.batch_shape = np.broadcast_shapes(*(one.shape[: one.ndim - len(shape)] for _, one, shape in parts))
        self.count = prod(self.batch_shape)
        #: the arguments that differ between rows
        self.mapped = {name for name, one, shape in parts if one.size > prod(shape)}
        self.arrays: dict[str, list[Any]] = {name: [] for name in arrays}
        for name, one, shape in parts:
            self.arrays[name].append(np.broadcast_to(one, self.batch_shape + shape).reshape(self.count, *shape))

    def at(self, row: int) -> Arrays:
        """The arrays of one row."""
        return {name: tuple(one[row] for one in several) for name, several in self.arrays.items()}


@dataclass(frozen=True, eq=False)
class Callbacks:
    """The three callbacks of a problem for arguments of these `forms`: `solved`, `forward` and `adjoint`."""

    problem: ProblemData
    forms: dict[str, Argument]
    shapes: Shapes
    options: dict[str, Any]
    raise_on_failure: bool
    last: LastDerivative

    @cached_property
    def sizes(self) -> dict[str, int]:
        """Argument → the length of its change as passed to the callback; a change of A is passed as one of q."""
        sizes = {"q": self.problem.n} if "A" in self.forms or "q" in self.forms else {}
        return sizes | {name: self.shapes[name][-1][0] for name in ("psi", "upper") if name in self.forms}

    def solved(self, arrays: Arrays) -> Any:
        """z of all rows, NaN in rows without a solution."""
        rows = MappedArrays(arrays, self.shapes)
        Z = np.full((rows.count, self.problem.n), np.nan)
        for k, (status, z) in enumerate(self.answers(rows)):
            if status in _ANSWERS:
                Z[k] = z
        return Z.reshape(*rows.batch_shape, self.problem.n)

    def answers(self, rows: MappedArrays) -> Iterable[tuple[Any, Any]]:
        """Status and z of all rows; both are None in a row with an error that is not to be raised."""
        if rows.count > 1:
            try:
                several = solve_many(**self.many(rows), raise_on_failure=self.raise_on_failure, **self.options)
                return zip(several.statuses, several.Z, strict=True)
            except IcpError:  # an error of one row
                if self.raise_on_failure:
                    raise
        alone = map(self.answer, map(rows.at, range(rows.count)))
        return [(None, None) if one is None else (one.status, one.z) for one in alone]

    def many(self, rows: MappedArrays) -> dict[str, Any]:
        """The arguments of `solve_many`: lists, or matrices with a row per problem, where problems differ."""
        problem = self.problem
        arguments: dict[str, Any] = {"A": problem.A, "q": problem.q, "z0": None, **obstacles(problem)}
        for name, form in self.forms.items():
            several = rows.arrays[name]
            if name not in rows.mapped:
                arguments[name] = form.to_icp(*(one[0] for one in several))
            elif form.make in (None, Constant):
                arguments[name] = several[0]
            else:
                arguments[name] = list(map(form.to_icp, *several))
        Q = np.broadcast_to(arguments.pop("q"), (rows.count, problem.n))
        return {"Q": Q, "Z0": arguments.pop("z0"), **arguments}

    def answer(self, row: Arrays) -> Solution | None:
        """The solution of one row."""
        try:
            problem = self.stated(row)
            start = row.get("z0", (None,))[0]
            return solve(problem, z0=start, raise_on_failure=self.raise_on_failure, **self.options)
        except IcpError:
            if self.raise_on_failure:
                raise
            return None

    def stated(self, row: Arrays) -> ProblemData:
        """The problem of one row; it shares what does not change with `problem`."""
        problem = self.problem
        arguments = {name: self.forms[name].to_icp(*row[name]) for name in self.forms}
        sides = [arguments.get(name, own) for name, own in obstacles(problem).items()]
        if "A" in arguments:
            return type(problem)(arguments["A"], arguments.get("q", problem.q), *sides)
        if "q" in arguments:
            problem = problem.with_q(arguments["q"])
        return problem.with_sides(*sides) if "psi" in arguments or "upper" in arguments else problem

    def forward(self, residuals: Arrays, changes: Any) -> Any:
        """dz of all rows and directions; `changes` are the concatenated changes of all arguments."""
        ends = np.cumsum(list(self.sizes.values()))[:-1]

        def act(derivative: Derivative, change: Vector) -> Vector:
            parts = dict(zip(self.sizes, np.split(change, ends), strict=True))
            own = {name: self.forms[name].direction(one) if name in self.forms else one for name, one in parts.items()}
            return derivative.forward(**{f"d{name}": one for name, one in own.items()})

        return self.each(residuals, changes, act, self.problem.n)

    def adjoint(self, residuals: Arrays, zbar: Any) -> Any:
        """The gradients in the `changes` of `forward`, of all rows and weights. Raises MapError."""

        def act(derivative: Derivative, weight: Vector) -> Vector:
            gradient = derivative.adjoint(weight)
            parts = {"q": gradient.q}
            for name, values in (("psi", gradient.psi_values), ("upper", gradient.upper_values)):
                if name in self.sizes:
                    parts[name] = self.forms[name].gradient(partial(getattr, gradient, name), values)
                    if parts[name].size != self.sizes[name]:
                        sizes = f"{self.sizes[name]} parameters, its parameter_derivative {parts[name].size} columns"
                        raise MapError(f"{name} has {sizes}; as many were expected")
            return np.concatenate([parts[name] for name in self.sizes])

        return self.each(residuals, zbar, act, sum(self.sizes.values()))

    def each(self, residuals: Arrays, vectors: Any, act: Callable[[Derivative, Vector], Vector], size: int) -> Any:
        """The results of `act`, of length `size`, on all derivatives and their vectors; NaN without a derivative."""
        rows = MappedArrays(residuals, self.shapes | {"z": ((self.problem.n,),)})
        directions = np.asarray(vectors)
        batch_shape = np.broadcast_shapes(rows.batch_shape, directions.shape[:-1])
        row_numbers = np.broadcast_to(np.arange(rows.count).reshape(rows.batch_shape), batch_shape).reshape(-1)
        directions = np.broadcast_to(directions, batch_shape + directions.shape[-1:]).reshape(row_numbers.size, -1)
        results = np.full((row_numbers.size, size), np.nan)
        with self.last.lock, one_blas_thread():
            for k in np.argsort(row_numbers, kind="stable"):  # row by row: one derivative is kept at a time
                derivative = self.derivative(rows.at(row_numbers[k]))
                if derivative is None or not np.isfinite(directions[k]).all():
                    continue
                try:
                    results[k] = act(derivative, directions[k])
                except SingularOperator:
                    if self.raise_on_failure:
                        raise
        return results.reshape(*batch_shape, size)

    def derivative(self, row: Arrays) -> Derivative | None:
        """The derivative of one row after a solve from its z, which ends at once; None if that fails. Sets `last`."""
        key = tuple((name, np.ascontiguousarray(one).tobytes()) for name, several in row.items() for one in several)
        if key == self.last.key:
            return self.last.derivative
        if np.isnan(row["z"][0]).any():
            return None
        solution = self.answer({name: several for name, several in row.items() if name != "z"} | {"z0": row["z"]})
        self.last.derivative = Derivative(solution) if solution is not None and solution.status in _ANSWERS else None
        self.last.key = key
        return self.last.derivative
