"""The errors of the package, and the checks of arguments that raise them.

IcpError
├── InputError (also a ValueError)   an argument is wrong: which, the actual and the expected value.
├── FileError (also an OSError)      a file is missing, truncated, not what it claims to be, or not writable.
├── MapError                         the user's ψ or f raised or returned something unusable.
├── NotApplicable                    a method or solver cannot take this problem; the message says why.
│   └── SingularOperator             a matrix such as X = M₁ + φ + Ω is singular; ``row`` says where.
├── OutOfTime                        a step was not begun, or was ended, as the time is too short for it.
├── OutOfMemory (also a MemoryError) a step was not begun, as the free memory is too small for it.
└── NotSolved                        the run ended without a solution; ``solution`` has the best iterate.

Interrupted (a KeyboardInterrupt)    Ctrl-C where no status can say so; ``report`` has the results so far.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from difflib import get_close_matches
from functools import wraps
from inspect import Parameter, signature, unwrap
from traceback import walk_tb
from typing import Any, TypeVar, cast

Call = TypeVar("Call", bound=Callable[..., Any])

#: the end of a message about another name for an obstacle, and of one about a missing problem
_OBSTACLES = "; the lower obstacle, z >= psi(z), is called psi, the upper obstacle is called upper"
HOW_TO_BUILD = "; icpmodel.ICP(A, q, psi) makes a problem of arrays, and icpmodel.ICP(A, q, psi).solve() solves it"
#: the name of an argument in other packages → its name here
_ELSEWHERE = {
    "tol": "rtol",
    "tolerance": "rtol",
    "eps": "atol",
    "maxiter": "max_iter",
    "maxit": "max_iter",
    "derivative": "jacobian",
    "lower": "psi",
}


def did_you_mean(name: Any, known: Iterable[str]) -> str:
    """The end of a message on `name`, which is not among the `known` names: "; did you mean …?", or nothing."""
    if not isinstance(name, str):
        return ""
    translated = _ELSEWHERE.get(name.lower(), name.lower())
    near = get_close_matches(translated, list(known), n=1)
    return f"; did you mean {near[0]}?" if near else ""


def check_arguments(target: Call) -> Call:
    """Decorator: turn the TypeError for unknown or missing arguments into an InputError with the accepted names.

    Parameters
    ----------
    target : function or class
        A public function, or a class, whose constructor is then decorated in place.
    """
    if isinstance(target, type):
        constructor = "__new__" if issubclass(target, tuple) else "__init__"
        setattr(target, constructor, check_arguments(getattr(target, constructor)))
        return target
    code = unwrap(target).__code__
    names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
    hint = _OBSTACLES if {"psi", "upper"} <= set(names) else HOW_TO_BUILD if "problem" in names else ""

    @wraps(target)
    def checked(*args: Any, **kwargs: Any) -> Any:
        try:
            return target(*args, **kwargs)
        except TypeError as error:
            if any(frame.f_code is code for frame, _ in walk_tb(error.__traceback__)):
                raise  # the body of `target` has raised it
        name = target.__qualname__
        if target.__name__ in ("__init__", "__new__") or names[:1] == ("cls",):
            owner = getattr(args[0], "__name__", type(args[0]).__name__)
            name = f"{owner}.{target.__name__}".removesuffix(".__init__").removesuffix(".__new__")
        takes = f"it takes {', '.join(one for one in names if one not in ('self', 'cls', '_cls')) or 'none'}"
        if unknown := [one for one in kwargs if one not in names]:
            raise InputError(f"{name} has no argument {unknown[0]}; {takes}{did_you_mean(unknown[0], names) or hint}")
        parameters = signature(target).parameters
        rest = [one for one in names[len(args) :] if one not in kwargs]
        if lacks := [one for one in rest if parameters[one].default is Parameter.empty]:
            raise InputError(f"{name} was not given {' and '.join(lacks)}; {takes}{hint}")
        raise InputError(f"{name} was given an argument twice, or too many without a name; {takes}{hint}")

    return cast(Call, checked)


class IcpError(Exception):
    """Base of every error that icpmodel raises on purpose.

    Examples
    --------
    >>> issubclass(InputError, IcpError) and issubclass(InputError, ValueError)
    True
    """


class InputError(IcpError, ValueError):
    """An argument is wrong. The message names it, what was found and what was expected.

    Examples
    --------
    >>> ICP([[1.0, 2.0]], [1.0])
    Traceback (most recent call last):
    icpmodel.errors.InputError: A has shape (1, 2); a square matrix was expected
    """


class FileError(IcpError, OSError):
    """A file cannot be read as what it should be, or cannot be written. The message names the file.

    Examples
    --------
    >>> icp.load_problem("nowhere.npz")
    Traceback (most recent call last):
    icpmodel.errors.FileError: nowhere.npz: no such file or folder
    """


class MapError(IcpError):
    """The map ψ or f, or its derivative, raised or returned something unusable, such as a vector of another shape.

    Examples
    --------
    >>> ICP([[1.0]], [1.0], psi=lambda z: [1.0, 2.0]).r([0.0])
    Traceback (most recent call last):
    icpmodel.errors.MapError: psi(z) has shape (2,); shape (1,) was expected
    """


class NotApplicable(IcpError):
    """A method or an independent solver cannot take this problem; the message is its `why_not`.

    Examples
    --------
    >>> ICP([[0.0, 1.0], [1.0, 2.0]], [0.0, 0.0]).solve("psor")
    Traceback (most recent call last):
    icpmodel.errors.NotApplicable: psor: projected SOR divides by the diagonal of A, but A[0, 0] = 0
    """


class SingularOperator(NotApplicable):
    """A matrix that must be inverted is singular, such as X = M₁ + φ + Ω of a method or that of a derivative.

    Attributes
    ----------
    row : int
        A row that causes it; 0 where none is known.

    Examples
    --------
    >>> try:
    ...     ICP([[1.0]], [1.0]).solve("mnmgs", phi=-2.0)
    ... except icp.SingularOperator as error:
    ...     error.row
    0
    """

    def __init__(self, message: str, row: int) -> None:
        super().__init__(message)
        self.row = row

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (str(self), self.row)


class OutOfTime(IcpError):
    """A step takes, or is expected to take, longer than `time_limit` leaves; the run ends with its best iterate."""


class OutOfMemory(IcpError, MemoryError):
    """A step is expected to need more memory than there is or `memory_limit` leaves; the run goes on without it."""


class NotSolved(IcpError):
    """A run ended without a solution.

    Attributes
    ----------
    solution : Solution or Solutions
        The best iterate and its certificate; from `solve_many` the answers of all rows.

    Examples
    --------
    >>> try:
    ...     ICP([[2.0, -1.0], [-1.0, 2.0]], [-1.0, 1.0]).solve("mnmgs", max_iter=2)
    ... except icp.NotSolved as error:
    ...     error.solution.status
    <Status.ITERATION_LIMIT: 'iteration limit'>
    """

    def __init__(self, solution: Any) -> None:
        super().__init__(solution.message)
        self.solution = solution

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.solution,)


class Interrupted(KeyboardInterrupt):
    """Ctrl-C in a cross-check, race, map, program of CVXPY or `all_solutions`; it ends a script as Ctrl-C should.

    Attributes
    ----------
    report : Report, Race, StabilityMap, ProgramSolution or SolutionSet
        The results so far; the rest is missing or marked as not done.

    Examples
    --------
    >>> issubclass(Interrupted, KeyboardInterrupt), issubclass(Interrupted, Exception)
    (True, False)
    """

    def __init__(self, report: Any) -> None:
        super().__init__("interrupted")
        self.report = report

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.report,)
