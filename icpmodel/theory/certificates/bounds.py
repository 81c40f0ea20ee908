"""A posteriori: how wrong can z be?"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain, islice
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from ...errors import MapError, OutOfTime
from ...numerics import work
from ...numerics.arrays import ReadOnly, Vector, as_number, as_truth, not_finite
from ...numerics.rounding import UNIT_ROUNDOFF, at_most, public_entry
from ...present.shown import Shown
from ...problem.data import ProblemData, ProblemLike, as_problem
from ...problem.facts import Facts
from ...problem.map import Map
from ...problem.matrix import Matrix
from ...problem.two_sided import TwoSidedObstacle
from ..answers import UNDECIDED
from ..matrices.classes import MatrixClasses
from .definite import prove as prove_definite
from .enumerated import prove as prove_enumerated
from .h_plus import HPlusProof
from .h_plus import prove as prove_h_plus
from .nearby import points_near
from .proof import Proof, norm_up
from .slopes import proofs_by_slopes
from .supersolution import prove as prove_supersolution

_SHARPEN_UP_TO = 10_000  #: up to so many entries of A sharpening costs a few milliseconds and is not worth a question
_NEGLIGIBLE = 0.02  #: δ(ẑ) as a share of |z − ẑ| that is not worth another point: the bound is then good to 2 per cent
#: the work that a bound may cost, in counted nanoseconds, where nobody limits it
BUDGET = 60e9
#: added to the sentence of a proof that rests on what a user says of ψ
USERS_WORD = ", given that psi is what the user says"
_OF_F = ", given that f has the slopes that the user says"  #: the same of f
_FEW = 8.0  #: units in the last place to which a user's function is taken as exact
_POINTS = 8  #: points ẑ at the most


@dataclass(frozen=True, repr=False)
class ErrorBound(ReadOnly, Shown):
    """A bound on the distance of z to the solution; `print` says it in words.

    Attributes
    ----------
    value : float or None
        The largest entry of `componentwise`, in the units of z; None where nothing is proved.
    componentwise : array of shape (n,) or None
        δ with |z − z*| ≤ δ.
    euclidean : float or None
        A bound ≥ ‖z − z*‖₂.
    proof : str
        The sentence of the proof, empty where there is none. The proof says that the solution
        exists and is unique, whatever z is.
    reason : str
        Why nothing is proved, where nothing is.

    Examples
    --------
    >>> bound = error_bound(ICP([[2.0]], [-2.0]), [1.25])
    >>> bound.value >= 0.25, bound.proof
    (True, 'A is an H+-matrix (v = 1)')
    """

    value: float | None
    componentwise: Vector | None = field(repr=False)
    euclidean: float | None
    proof: str
    reason: str

    @classmethod
    def none(cls, reason: str, proof: str = "") -> ErrorBound:
        """An ErrorBound without a bound.

        Parameters
        ----------
        reason : str
            Why there is none.
        proof : str, optional
            The proof of uniqueness, where there is one all the same.

        Returns
        -------
        ErrorBound
            Its `value` is None.
        """
        return cls(None, None, None, proof, reason)

    @property
    def unique(self) -> bool:
        """Whether it is proved that the solution exists and is the only one."""
        return bool(self.proof)

    def in_words(self, accuracy: float | None = None) -> str:
        """State in words what is known of the error.

        Parameters
        ----------
        accuracy : float, optional
            The accuracy that was asked for.

        Returns
        -------
        str
            One line, or one for each reason where there is no bound.
        """
        given = "".join(word for word in (USERS_WORD, _OF_F) if word in self.proof)
        if self.value is not None:
            wanted = "" if accuracy is None else f" ({accuracy:g} was asked for)"
            size = at_most(self.value, below=math.inf if accuracy is None else accuracy)
            return f"|z - z*| <= {size} in every entry{wanted}; z* is the only solution{given}"
        if self.unique:
            return f"no bound: {self.reason}; z* exists and is the only solution{given}"
        return "no certified bound:" + listed(self.reason)

    def __str__(self) -> str:
        return self.in_words() + (f"\nproof: {self.proof}" if self.proof else "")


def listed(reason: str) -> str:
    """The reasons why nothing is proved, as `ErrorBound.reason` strings them together: a line each if several."""
    several = reason.split("; ")
    return f" {reason}" if len(several) == 1 else "".join(f"\n- {one}" for one in several)


@contextmanager
def limited(time_limit: float | None, memory_limit: float | None) -> Iterator[None]:
    """A block in which what is foreseen to take more than these seconds and bytes, or where nobody limits the time more
    work than `BUDGET`, raises OutOfTime or OutOfMemory."""
    with ExitStack() as kept:
        if time_limit is not None or memory_limit is not None:
            kept.enter_context(work.work_limit(*(math.inf if x is None else x for x in (time_limit, memory_limit))))
        if time_limit is None and work.nanoseconds_left() == math.inf:
            kept.enter_context(work.work_limit(nanoseconds=BUDGET))
        yield


@public_entry
@np.errstate(all="ignore")  # what overflows proves nothing
def error_bound(
    problem: ProblemLike,
    z: Any,
    *,
    sharp: bool | None = None,
    rigorous: bool = False,
    time_limit: float | None = None,
    memory_limit: float | None = None,
) -> ErrorBound:
    """Bound |z − z*| from one evaluation of p and r, or say why there is no bound.

    Parameters
    ----------
    problem : ICP
        The problem.
    z : array_like of shape (n,) or Solution
        The point.
    sharp : bool, optional
        True: improve the bound by a better point ẑ and |z − z*| ≤ |z − ẑ| + |ẑ − z*|. False: the
        bound of z itself. By default as True where A has at most 10 000 entries or the proof is a
        wide one.
    rigorous : bool, default False
        Whether there is no bound where it would rest on a user's word.
    time_limit : float, optional
        Seconds, as in `solve`; by default a minute of counted work.
    memory_limit : float, optional
        Bytes, as in `solve`; by default the free memory.

    Returns
    -------
    ErrorBound
        The bound. A step that would exceed a limit is not begun. Then there is the bound without
        it, or none, and the reason says so.

    Raises
    ------
    MapError
        Where ψ fails at z.

    Notes
    -----
    Bounds on the rounding errors are included. So the bound is a proof for constant and affine ψ
    and for interventions given by a matrix. A user's function ψ is taken as exact to a few units in
    the last place. Its Lipschitz matrix is taken at the user's word, unless ψ(z) and ψ(0)
    contradict it: then there is no bound. The same holds of f and its `slope_range`.

    The point ẑ of a sharp bound comes from a few active-set Newton steps, a factorisation each.
    That bound is mostly within a few per cent of the true error, where the bound of z itself may be
    thousands of times too wide. By default, for larger A, ẑ comes from Newton steps with multigrid. This
    costs about half a linear solve with the levels of `solve`. Nothing is done where the bound of z
    itself is about ten times the error or less.

    References
    ----------
    The files of `icpmodel.theory.certificates`: `h_plus`, `nearby`, `definite`, `supersolution`,
    `enumerated`.

    Examples
    --------
    >>> problem = ICP([[2, -1], [-1, 2]], [-1, -1])
    >>> bound = error_bound(problem, [1.0, 1.001])
    >>> (
    ...     0.001 <= bound.value <= 0.001001,
    ...     round(error_bound(problem, [1.0, 1.001], sharp=False).value, 9),
    ... )
    (True, 0.002)
    """
    problem = as_problem(problem, nonlinear=True)
    z = problem.vector(z)
    if sharp is not None:
        as_truth(sharp, "sharp")
    if as_truth(rigorous, "rigorous") and (problem.psi.calls_user_code or problem.f is not None):
        return ErrorBound.none("psi or f is computed by a user's function, whose rounding errors are not known")
    for name, limit in (("time_limit", time_limit), ("memory_limit", memory_limit)):
        if limit is not None:
            as_number(limit, name, least=0)
    if work.nanoseconds_left() < math.inf and time_limit is memory_limit is None:  # whoever limits it is told
        return _bound(problem, z, sharp)
    try:
        with limited(time_limit, memory_limit):
            return _bound(problem, z, sharp)
    except OutOfTime:
        within = f"{1e-9 * BUDGET:.0f} s of work" if time_limit is None else f"time_limit = {time_limit:g} s"
    except MemoryError:
        within = "the memory that there is" if memory_limit is None else f"memory_limit = {memory_limit:g} bytes"
    return ErrorBound.none(f"{UNDECIDED} within {within}")


def _bound(problem: ProblemData, z: Vector, sharp: bool | None) -> ErrorBound:
    """The bound of the first proof that there is, or all reasons why there is none. Raises OutOfTime, OutOfMemory."""
    if fault := broken_promise(problem, z):
        return ErrorBound.none(fault)
    reasons = []
    for proof in proofs_for(problem):
        if isinstance(proof, str):
            reasons.append(proof.replace("; ", ", "))
            continue
        delta, euclidean = proof.bound(problem, z, *problem.rounding(z))
        points: Iterator[Vector] = iter(())
        if problem.f is not None:
            sharp = False
        if sharp or (sharp is None and (proof.wide or problem.A.nnz <= _SHARPEN_UP_TO)):
            points = _newton_points(problem, z, proof)
        elif sharp is None and isinstance(proof, HPlusProof):
            points = points_near(problem, z, proof, float(delta.max()))
        delta, euclidean = sharpened(problem, z, proof, points, delta, euclidean)
        sentence = proof.sentence + (USERS_WORD if problem.psi.calls_user_code else "")
        sentence += _OF_F if problem.f is not None else ""
        if (row := may_cross(problem, z, delta)) is not None:
            told = f"psi <= upper is not proved within {at_most(float(delta.max()))} of z, where z* would be: row {row}"
            return ErrorBound.none(told)
        if np.isfinite(delta).all():
            return ErrorBound(float(delta.max()), delta, euclidean, sentence, "")
        fault = not_finite(z, "z") or "the proof gives no bound at this z: it is too far from z*"
        return ErrorBound.none(fault, sentence)
    return ErrorBound.none("; ".join(dict.fromkeys(reasons)))  # several proofs may fail for one reason


def broken_promise(problem: ProblemData, z: Vector) -> str:
    """Between `z` and 0, where ψ costs next to nothing beside a proof: that it moves by more than the Lipschitz matrix
    of its user allows, beyond rounding. Empty where that is not seen."""
    if problem.f is not None and (fault := problem.f.broken_promise(z)):
        return fault
    psi = problem.psi
    sides = {"psi": psi} if problem.upper is None else {"psi": psi.lower, "upper": psi.upper}  # type: ignore[attr-defined]
    for name, one in sides.items():
        allowed = one.change(np.abs(z)) if one.calls_user_code else None
        if allowed is None:
            continue
        with suppress(MapError), np.errstate(all="ignore"):  # 0 may be outside of where ψ has a value
            here = one.value(z)
            there = one.value(np.zeros(z.size))
            moved = np.abs(here - there)
            excess = moved - allowed - _FEW * UNIT_ROUNDOFF * (np.abs(here) + np.abs(there))
            if (excess > 0.0).any():
                i = int(np.nanargmax(excess))
                seen = f"{name}_{i} differs by {moved[i]:.6g} between z and 0, and it allows {allowed[i]:.6g}"
                return f"{name}.lipschitz is too small: {seen} (give a larger one, or none)"
    return ""


def never_cross(psi: Map) -> bool:
    """Whether there is one obstacle, or two with ψ ≤ ψ̄ at every z, because both are fixed, or move alike."""
    return not isinstance(psi, TwoSidedObstacle) or psi.parallel


def may_cross(problem: ProblemData, z: Vector, delta: Vector) -> int | None:
    """A row in which ψ ≤ ψ̄ is not certain for all |x − z| ≤ `delta`; None where there is none.

    There a zero of F need not be a solution.
    """
    psi = problem.psi
    above = problem.r_upper(z)
    if above is None or never_cross(psi):
        return None
    below = problem.r(z)
    change = psi.change(delta)
    for_r = problem.rounding(z)[1]
    with np.errstate(over="ignore", invalid="ignore"):
        safe = np.isinf(below) | np.isinf(above)
        if change is not None:
            safe |= below - above > (2.0 * change + 2.0 * for_r) * (1 + 8 * UNIT_ROUNDOFF)
    return None if safe.all() else int(np.argmin(safe))


def bound_of_change(problem: ProblemData, z: Vector, for_p: Vector, for_r: Vector) -> float | None:
    """How far, at most, z is from z* in any entry if p and r are wrong at z by up to `for_p` and `for_r`, or None."""
    for proof in proofs_of(problem).tried(problem):
        if not isinstance(proof, str):
            largest = float(proof.bound(problem, z, for_p, for_r)[0].max())
            return largest if np.isfinite(largest) else None
    return None


class Proofs:
    """The classes of A, and each proof of uniqueness for A and ψ, or why there is none, made when it is asked for."""

    def __init__(self, matrix: Matrix, psi: Map) -> None:
        self.matrix, self.psi = matrix, psi
        # those that rest on q as well
        self._of_problem: WeakKeyDictionary[ProblemData, dict[Any, Proof | str]] = WeakKeyDictionary()

    @cached_property
    def classes(self) -> MatrixClasses:
        """Those of A are made once whatever ψ is."""
        if self.matrix not in _CLASSES:
            _CLASSES[self.matrix] = MatrixClasses(self.matrix.sparse)
        return _CLASSES[self.matrix]

    h_plus = cached_property(lambda self: prove_h_plus(self.matrix, self.psi))
    definite = cached_property(lambda self: prove_definite(self.matrix, self.psi))

    def supersolution(self, problem: ProblemData) -> Proof | str:
        """The proof for impulse control, which rests on q as well."""
        return self._by_q(problem, prove_supersolution)

    def tried(self, problem: ProblemData) -> Iterator[Proof | str]:
        """Those that ψ may have, the cheapest and sharpest first; they bound the effect of any error in p and r."""
        yield self.h_plus
        yield self.definite
        if self.psi.has_policies and self.psi.upper is None:
            yield self.supersolution(problem)

    def enumerated(self, problem: ProblemData) -> Iterator[Proof | str]:
        """The proof for a few unknowns, of the distance to z* alone; nothing where an obstacle is not affine."""
        if self.psi.linear is not None and (self.psi.upper is None or self.psi.upper.linear is not None):
            yield self._by_q(problem, prove_enumerated)

    def _by_q(self, problem: ProblemData, prove: Callable[[ProblemData], Proof | str]) -> Proof | str:
        known = self._of_problem.setdefault(problem, {})
        if prove not in known:
            known[prove] = prove(problem)
        return known[prove]


_CLASSES: WeakKeyDictionary[Matrix, MatrixClasses] = WeakKeyDictionary()
_PROOFS: WeakKeyDictionary[Facts, Proofs] = WeakKeyDictionary()


def proofs_of(problem: ProblemData) -> Proofs:
    """The proofs that `problem` shares with all others of the same A and ψ."""
    if problem.facts not in _PROOFS:
        _PROOFS[problem.facts] = Proofs(problem.matrix, problem.psi)
    return _PROOFS[problem.facts]


def proofs_for(problem: ProblemData) -> Iterator[Proof | str]:
    """Each proof for `problem`, or why there is none."""
    if problem.f is not None:
        return proofs_by_slopes(problem)
    proofs = proofs_of(problem)
    return chain(proofs.tried(problem), proofs.enumerated(problem))


def sharpened(
    problem: ProblemData, z: Vector, proof: Proof, points: Iterator[Vector], delta: Vector, euclidean: float
) -> tuple[Vector, float]:
    """The best of δ(z) and |z − ẑ| + δ(ẑ) over the first `points` ẑ, and the like for the Euclidean norms.

    It ends where δ(ẑ) is a small share of |z − ẑ|.
    """
    # ψ need not have a value anywhere but at z
    with suppress(MapError, OutOfTime, MemoryError):
        for better in islice(points, _POINTS):
            beyond, beyond_euclidean = proof.bound(problem, better, *problem.rounding(better))
            step = np.abs(z - better)
            candidate = (step + beyond) * (1 + 4 * UNIT_ROUNDOFF)
            if candidate.max() < delta.max() or not np.isfinite(delta).all():
                delta = candidate
                euclidean = (norm_up(step) + beyond_euclidean) * (1 + 4 * UNIT_ROUNDOFF)
            if beyond.max() <= _NEGLIGIBLE * step.max():
                break
    return delta, euclidean


def _newton_points(problem: ProblemData, z: Vector, proof: Proof) -> Iterator[Vector]:
    """The points of an active-set Newton iteration from `z`, a factorisation each."""
    found: Vector | None = z
    while found is not None and np.isfinite(found).all():
        z = found
        found = proof.nearer(problem, z)
        if found is None or np.array_equal(found, z):
            return
        yield found
