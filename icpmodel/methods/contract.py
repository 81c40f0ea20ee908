"""The contract of a method.

A method is mathematics only: it yields iterates and knows no clock, no tolerance and no printing. To add one, write a
`Method` subclass with a new `name`, in a file of this folder or anywhere else. `solve("name")`, races and the command
line then find it.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from functools import wraps
from typing import Any, ClassVar, TypeVar, dataclass_transform

import numpy as np

from ..algebra.steps import Step, repeated_steps
from ..errors import InputError, check_arguments, did_you_mean
from ..numerics.arrays import ReadOnly, Vector, described
from ..numerics.plugins import load_plugins
from ..numerics.rounding import MIN_EXACT_PRODUCT
from ..present.display import Displayable
from ..problem.data import ProblemData
from ..theory.answers import Answer

_REGISTRY: dict[str, type[Method]] = {}
Class = TypeVar("Class", bound=type[Any])

#: squares of numbers between this one and its reciprocal, as a sweep sums them for Res_D, do not over- or underflow
SAFE_SIZE = math.sqrt(MIN_EXACT_PRODUCT)

#: a value below this share of the least one so far counts as reduced; and the steps without a reduction after which
#: inner iterations are given up
REDUCTION = 0.9
PATIENCE = 5

#: z with Res_D(z), or None where the step does not yield it for free
Iterate = tuple[Vector, float | None]


class LeastValue:
    """The `least` value, which only a value a tenth below replaces, and `idle`, the number of values since then."""

    def __init__(self, least: float = np.inf) -> None:
        self.least = least
        self.idle = 0

    def add(self, value: float) -> int:
        """Add a value, and return `idle`, which is 0 if the value is the new `least`."""
        self.idle += 1
        if value < REDUCTION * self.least:
            self.least = value
            self.idle = 0
        return self.idle


#: the sentence for a nonlinear p
NONLINEAR_P = "p is nonlinear, and this method needs affine p: leave out the method, or solve problem.linearised(z)"


def _check_f_first(own: Callable[[Any, ProblemData], str | None]) -> Callable[[Any, ProblemData], str | None]:
    """The `why_not` of a method that calls `why_not_f` first, then its `own`."""

    @wraps(own)
    def why_not(self: Any, problem: ProblemData) -> str | None:
        return self.why_not_f(problem) or own(self, problem)

    return why_not


class Infeasible(Exception):
    """Raised by a method that has proved that there is no solution: `answer` has the reason and the witness."""

    def __init__(self, answer: Answer) -> None:
        super().__init__(answer.reason)
        self.answer = answer


@dataclass_transform(kw_only_default=True, frozen_default=True, eq_default=False)
def with_options(cls: Class) -> Class:
    """Decorator: make a method a frozen keyword-only dataclass, its fields the options."""
    dataclass(frozen=True, kw_only=True, eq=False, repr=False)(cls)
    return check_arguments(cls)


@with_options
class Method(ReadOnly, Displayable, ABC):
    """An iterative method; subclasses with options are frozen keyword-only dataclasses that check them.

    A method never changes after it was made.

    Examples
    --------
    >>> from icpmodel.methods import named
    >>> named("mnmsor", theta1=1.2)
    MNMSOR(theta1=1.2)
    """

    #: the name that `solve` and the command line take
    name: ClassVar[str] = ""
    #: whether zᵏ alone decides zᵏ⁺¹, so that an iterate that comes back proves a cycle
    memoryless: ClassVar[bool] = False
    #: "paper" for the members printed in the paper, "modulus" for others derived from the same equation, "shortcut" for
    #: methods that solve small or narrow problems without it, "" for baselines
    family: ClassVar[str] = ""
    #: whether it ends after finitely many steps, so that the rate of its residual predicts nothing
    finite: ClassVar[bool] = False
    #: which of its options are worth another try where it stagnates, cycles or diverges, for the advice to the user
    to_try: ClassVar[str] = ""

    def __init_subclass__(cls) -> None:
        if "why_not" in cls.__dict__:
            cls.why_not = _check_f_first(cls.why_not)  # type: ignore[assignment, method-assign]
        if cls.__dict__.get("name"):  # not an inherited one
            _REGISTRY[cls.name] = cls

    def why_not(self, problem: ProblemData) -> str | None:
        """Why this method cannot take a problem.

        Parameters
        ----------
        problem : ProblemData
            The problem.

        Returns
        -------
        str or None
            One sentence, None where it can.

        Examples
        --------
        >>> icp.PSOR().why_not(ICP([[0.0]], [1.0]))
        'projected SOR divides by the diagonal of A, but A[0, 0] = 0'
        """
        return self.why_not_f(problem)

    def why_not_f(self, problem: ProblemData) -> str | None:
        """Why this method cannot take the f of a problem; `why_not` calls it first.

        Parameters
        ----------
        problem : ProblemData
            The problem.

        Returns
        -------
        str or None
            One sentence, None where it can.

        Examples
        --------
        >>> icp.Newton().why_not_f(ICP([[1.0]], [1.0]))
        """
        return None if problem.f is None else NONLINEAR_P

    @abstractmethod
    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[Iterate]:
        """Yield (zᵏ, Res_D(zᵏ)) for k = 0, 1, 2, …, and end when nothing new will come.

        Parameters
        ----------
        problem : ProblemData
            The problem.
        z : array of shape (n,)
            The start z⁰.

        Returns
        -------
        str, optional
            Why there is no further step, for the message of the run.

        Yields
        ------
        tuple of array and float or None
            zᵏ of shape (n,), which the method does not change afterwards, and its residual, None where
            the step does not yield it for free. The residual is a hint: the run judges zᵏ itself.

        Raises
        ------
        SingularOperator
            At the first step where the method's operator cannot be inverted.
        MapError
            Where ψ fails.
        Infeasible
            Where it is proved that there is no solution.

        Notes
        -----
        The iterator may have an attribute `adapted_method`: this method with the numbers that the run
        has adapted.

        Examples
        --------
        >>> path = icp.MNMGS().iterates(ICP([[2.0]], [-2.0]), np.array([3.0]))
        >>> next(path), next(path)
        ((array([3.]), 2.0), (array([1.]), 0.0))
        """

    def __repr__(self) -> str:
        options = []
        for option in fields(self):
            value = getattr(self, option.name)
            if isinstance(value, np.ndarray):
                options.append(f"{option.name}=<{value.size} values>")
            elif value is not option.default and not (np.isscalar(value) and value == option.default):
                options.append(f"{option.name}={value:.6g}" if isinstance(value, float) else f"{option.name}={value!r}")
        return f"{type(self).__name__}({', '.join(options)})"


class FixedPoint(Method):
    """A method whose iterates are those of one map: zᵏ⁺¹ = g(zᵏ). Such a method can be accelerated."""

    memoryless: ClassVar[bool] = True

    @abstractmethod
    def step_of(self, problem: ProblemData) -> Step:
        """z ↦ (g(z), Res_D(z)); the result is a fresh array. Raises SingularOperator."""

    def opening(self, problem: ProblemData) -> Step | None:
        """A cheaper first step, which may already solve the problem; None where there is none."""
        return None

    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[Iterate]:
        if (opening := self.opening(problem)) is not None:
            following, residual = opening(z)
            yield z, residual
            z = following
        step = self.step_of(problem)
        while True:
            for following, residual in repeated_steps(step, z):
                yield z, residual
                z = following


@check_arguments
def names() -> list[str]:
    """The names of all methods, sorted.

    Returns
    -------
    list of str
        The names.

    Examples
    --------
    >>> "mnmgs" in icp.methods.names()
    True
    """
    load_plugins()
    return sorted(_REGISTRY)


@check_arguments
def named(name: str, /, **options: Any) -> Method:
    """The method with this name and these options.

    Parameters
    ----------
    name : str
        A name of `names()`.
    **options
        The options of the method.

    Returns
    -------
    Method
        The method.

    Raises
    ------
    InputError
        For an unknown name or option; it lists the known ones.

    Examples
    --------
    >>> icp.methods.named("mnmgs", theta1=2)
    Traceback (most recent call last):
    icpmodel.errors.InputError: mnmgs has no option theta1; it takes phi, phi1, phi2
    """
    if not isinstance(name, str) or name.lower() not in names():
        expected = "; a name as 'newton' or 'mnmgs' of icpmodel.methods.names(), or a Method as Newton(), was expected"
        raise InputError(f"method is {described(name)}{did_you_mean(name, names()) or expected}")
    cls = _REGISTRY[name.lower()]
    known = [option.name for option in fields(cls)]
    for option in options:
        if option not in known:
            takes = f"it takes {', '.join(known)}" if known else "it takes none"
            raise InputError(f"{cls.name} has no option {option}; {takes}{did_you_mean(option, known)}")
    return cls(**options)


def why_not_diagonal(problem: ProblemData, use: str) -> str | None:
    """Why a method that needs a positive diagonal of A refuses; None if the diagonal is positive."""
    if problem.f is not None or problem.matrix.has_positive_diagonal:  # with an f `why_not_rows` asks for more
        return None
    diagonal = problem.matrix.rows.diagonal
    i = int(np.argmax(diagonal <= 0))
    return f"{use}, but A[{i}, {i}] = {diagonal[i]:g}"
