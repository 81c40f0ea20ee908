"""Certified bounds on |z − z*|, from the first proof of uniqueness that succeeds.

`error_bound` tries the proofs of `proofs_for`, the cheapest first. A `Proof` turns the residuals p and r at z, with
their rounding errors, into a bound δ(z) ≥ |z − z*|. A better point ẑ sharpens it: |z − z*| ≤ |z − ẑ| + δ(ẑ).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

import numpy as np
import scipy.sparse as sp

from ...algebra.equations import Pattern
from ...algebra.linear_rows import has_linear_pieces
from ...errors import MapError, OutOfTime
from ...numerics import work
from ...numerics.arrays import ReadOnly, Vector, as_number, as_truth, not_finite
from ...numerics.rounding import UNIT_ROUNDOFF, public_entry, rounded_up
from ...present.display import Displayable
from ...problem.data import ProblemData, ProblemLike, as_problem
from ...problem.matrix import Matrix
from ...problem.two_sided import sides_of
from ...problem.user_code import map_violation
from ..answers import UNDECIDED
from ..matrices.classes import MatrixClasses
from .definite import prove as prove_definite
from .enumerated import EnumeratedProof
from .enumerated import prove as prove_enumerated
from .h_plus import HPlusProof
from .h_plus import prove as prove_h_plus
from .nearby import points_near
from .proof import Proof, norm_up
from .slopes import proofs_by_slopes
from .supersolution import prove as prove_supersolution

#: for matrices with at most this many entries bounds are always sharpened, in a few milliseconds
_SHARPEN_MAX_NNZ = 10_000
#: no further point ẑ is tried once δ(ẑ) is at most this share of |z − ẑ|: the bound is then within 4.1 per cent
_NEGLIGIBLE = 0.02
#: the default work limit of a bound, in counted nanoseconds
DEFAULT_WORK = 60e9
#: added to the sentence of a proof that relies on a user's Lipschitz constants of ψ
ASSUMED_PSI = ", given that psi is what the user says"
#: added if the proof relies on a user's f: an infinite upper slope allows jumps, with which there may be no solution
ASSUMED_F = ", given that f is continuous and has the slopes that the user says"
#: the largest number of points ẑ
_MAX_POINTS = 8


@dataclass(frozen=True, eq=False, repr=False)
class ErrorBound(ReadOnly, Displayable):
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
        The proof as a sentence, empty where there is none. It proves that the solution exists and
        is unique, whatever z is. It ends with the assumptions on a user's functions.
    reason : str
        Why there is no bound; empty where there is one.

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
        """Whether it is proved that the solution exists and is the only one, under the assumptions of `proof`."""
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
        assumption = "".join(word for word in (ASSUMED_PSI, ASSUMED_F) if word in self.proof)
        if self.value is not None:
            goal = "" if accuracy is None else f" ({accuracy:g} was asked for)"
            size = rounded_up(self.value, below=math.inf if accuracy is None else accuracy)
            return f"|z - z*| <= {size} in every entry{goal}; z* is the only solution{assumption}"
        if self.unique:
            return f"no bound: {self.reason}; z* exists and is the only solution{assumption}"
        return "no certified bound:" + bullet_list(self.reason)

    def __str__(self) -> str:
        return self.in_words() + (f"\nproof: {self.proof}" if self.proof else "")


def bullet_list(reason: str) -> str:
    """Format an `ErrorBound.reason`, which separates reasons by semicolons: several become a list, a line each."""
    several = reason.split("; ")
    return f" {reason}" if len(several) == 1 else "".join(f"\n- {one}" for one in several)


@contextmanager
def enforce_limits(time_limit: float | None, memory_limit: float | None) -> Iterator[None]:
    """Within the block, raise OutOfTime or OutOfMemory before a step that would exceed these seconds or bytes.

    Without any time limit, this one or an outer one, the limit is `DEFAULT_WORK`.
    """
    seconds, memory = (math.inf if limit is None else limit for limit in (time_limit, memory_limit))
    unlimited = time_limit is None and work.nanoseconds_left() == math.inf
    with work.work_limit(seconds, memory, DEFAULT_WORK if unlimited else math.inf):
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
    """Bound |z − z*| by the first proof of uniqueness that succeeds, or say why there is no bound.

    Parameters
    ----------
    problem : ICP
        The problem.
    z : array_like of shape (n,) or Solution
        The point.
    sharp : bool, optional
        True: improve the bound by a better point ẑ and |z − z*| ≤ |z − ẑ| + |ẑ − z*|. False: the
        bound of z itself. By default as True where A has at most 10 000 entries or the bound of z
        itself is known to be loose.
    rigorous : bool, default False
        Whether to refuse bounds that depend on the values of a user's function.
    time_limit : float, optional
        Seconds, as in `solve`; by default a minute of counted work.
    memory_limit : float, optional
        Bytes, as in `solve`; by default the free memory.

    Returns
    -------
    ErrorBound
        The bound. A step that would exceed a limit is not started. The result is then the bound
        without this step, or no bound and the reason.

    Raises
    ------
    MapError
        Where ψ fails at z.

    Notes
    -----
    Bounds on the rounding errors are included. So the bound is a proof for constant and affine ψ
    and for interventions given by a matrix. A user's function ψ is taken as exact to a few units in
    the last place. Its Lipschitz matrix is assumed to be right, unless ψ(z) and ψ(0) contradict
    it: then there is no bound. The same holds for f and its `slope_range`; f is assumed to be continuous.

    The point ẑ of a sharp bound comes from a few active-set Newton steps, a factorisation each.
    The sharp bound is mostly within a few per cent of the true error; the bound of z itself may be
    thousands of times too large. A nonlinear p is replaced by its tangents in the steps, but not in the
    bound of ẑ. By default, for larger A and affine p, ẑ comes from Newton steps with multigrid. They
    cost about half a linear solve with the levels of `solve`. No step is made if the bound of z
    itself is at most about ten times the error.

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
            as_number(limit, name, minimum=0)
    return limited_bound(lambda: _bound(problem, z, sharp), time_limit, memory_limit)


def limited_bound(
    compute: Callable[[], ErrorBound], time_limit: float | None = None, memory_limit: float | None = None
) -> ErrorBound:
    """The bound that `compute` returns, or none if it exceeds a limit; see `enforce_limits`.

    If neither limit is given, but there is an outer limit of time, exceeding that one raises.
    """
    if work.nanoseconds_left() < math.inf and time_limit is memory_limit is None:  # the outer limit raises
        return compute()
    try:
        with enforce_limits(time_limit, memory_limit):
            return compute()
    except OutOfTime:
        within = f"{1e-9 * DEFAULT_WORK:.0f} s of work" if time_limit is None else f"time_limit = {time_limit:g} s"
    except MemoryError as error:
        within = "the memory that there is" if memory_limit is None else f"memory_limit = {memory_limit:g} bytes"
        within += f": {error}" if str(error) else ""
    return ErrorBound.none(f"{UNDECIDED} within {within}")


def _bound(problem: ProblemData, z: Vector, sharp: bool | None) -> ErrorBound:
    """The bound of the first proof that succeeds, or why each failed. Raises OutOfTime, OutOfMemory."""
    if fault := lipschitz_violation(problem, z):
        return ErrorBound.none(fault)
    problem = _once(problem, _without_fixed_rows, problem) or problem
    reasons = []
    for proof in proofs_for(problem):
        if isinstance(proof, str):
            reasons.append(proof.replace("; ", ", "))
            continue
        delta, euclidean = proof.bound(problem, z, *problem.rounding(z))
        points: Iterator[Vector] = iter(())
        if sharp or (sharp is None and (proof.needs_sharpening or problem.A.nnz <= _SHARPEN_MAX_NNZ)):
            points = _newton_points(problem, z, proof)
        elif sharp is None and problem.f is None and isinstance(proof, HPlusProof):
            points = points_near(problem, z, proof, float(delta.max()))
        delta, euclidean = sharpened(problem, z, proof, points, delta, euclidean)
        sentence = proof.sentence + (ASSUMED_PSI if problem.psi.calls_user_code else "")
        sentence += ASSUMED_F if problem.f is not None else ""
        if (row := possible_crossing(problem, z, delta)) is not None:
            reason = (
                f"psi <= upper is not proved within {rounded_up(float(delta.max()))} of z, where z* would be: row {row}"
            )
            return ErrorBound.none(reason)
        if np.isfinite(delta).all():
            return ErrorBound(float(delta.max()), delta, euclidean, sentence, "")
        fault = not_finite(z, "z") or "the proof gives no bound at this z: it is too far from z*"
        return ErrorBound.none(fault, sentence)
    return ErrorBound.none("; ".join(dict.fromkeys(reasons)))  # several proofs may fail for one reason


def _without_fixed_rows(problem: ProblemData) -> ProblemData | None:
    """The problem with p_i replaced by z_i where ψ_i = ψ̄_i are constants: there p_i may have any value at a solution.

    Where the constants are 0, column i of A is set to 0 as well. None if there is no such row.
    """
    facts = problem.facts
    above = facts.upper_obstacle if problem.psi.is_constant and problem.f is None else None
    if above is None or not (fixed := facts.obstacle == above).any():
        return None
    rows = sp.diags_array(1.0 * ~fixed)
    columns = sp.diags_array(1.0 * ~(fixed & (above == 0.0)))
    A = sp.csr_array(rows @ problem.A @ columns + sp.diags_array(1.0 * fixed))
    return problem.with_matrix(Matrix(A), np.where(fixed, 0.0, problem.q))


def lipschitz_violation(problem: ProblemData, z: Vector) -> str:
    """A sentence if values at `z` and 0 contradict the Lipschitz matrix of ψ or ψ̄, or the slopes of f; else empty."""
    if problem.f is not None and (fault := problem.f.slope_violation(z)):
        return fault
    sides = zip(sides_of(problem.psi), ("psi", "upper"), strict=False)
    return next((fault for side, name in sides if (fault := map_violation(side, z, name))), "")


def possible_crossing(problem: ProblemData, z: Vector, delta: Vector) -> int | None:
    """A row in which ψ(x) > ψ̄(x) is possible for some |x − z| ≤ `delta`; None if there is none.

    Where the obstacles cross, a zero of the modulus equation need not be a solution.
    """
    psi = problem.psi
    r_upper = problem.r_upper(z)
    if r_upper is None or psi.parallel:
        return None
    r = problem.r(z)
    change = psi.change(delta)
    rounding_r = problem.rounding(z)[1]
    with np.errstate(over="ignore", invalid="ignore"):
        safe = np.isinf(r) | np.isinf(r_upper)
        if change is not None:
            safe |= r - r_upper > (2.0 * change + 2.0 * rounding_r) * (1 + 8 * UNIT_ROUNDOFF)
    return None if safe.all() else int(np.argmin(safe))


def perturbation_bound(problem: ProblemData, z: Vector, rounding_p: Vector, rounding_r: Vector) -> float | None:
    """A bound on max|z − z*|, p(z) and r(z) being known to `rounding_p` and `rounding_r`; None if none is proved."""
    problem = _once(problem, _without_fixed_rows, problem) or problem
    for proof in proofs_with_rounding(problem):
        if not isinstance(proof, str):
            largest = float(proof.bound(problem, z, rounding_p, rounding_r)[0].max())
            return largest if np.isfinite(largest) else None
    return None


Made = TypeVar("Made")
#: cache: matrix, facts or problem → function → its result
_MADE: WeakKeyDictionary[Any, dict[Any, Any]] = WeakKeyDictionary()


def _once(owner: Any, make: Callable[..., Made], *arguments: Any) -> Made:
    """`make(*arguments)`, computed once for the `owner`, on which alone it depends."""
    made: dict[Any, Made] = _MADE.setdefault(owner, {})
    if make not in made:
        made[make] = make(*arguments)
    return made[make]


def classes_of(problem: ProblemData) -> MatrixClasses:
    """The classes of A, shared by all problems with this A."""
    return _once(problem.matrix, MatrixClasses, problem.A)


def h_plus_proof(problem: ProblemData) -> HPlusProof | str:
    """The proof by `h_plus`, or why there is none, shared by all problems with this A and ψ."""
    return _once(problem.facts, prove_h_plus, problem.matrix, problem.psi)


def supersolution_proof(problem: ProblemData) -> Proof | str:
    """The proof for impulse control, or why there is none; it depends on q as well."""
    return _once(problem, prove_supersolution, problem)


def enumerated_proof(problem: ProblemData) -> EnumeratedProof | str:
    """The proof by all linear pieces, or why there is none; it depends on q as well."""
    return _once(problem, prove_enumerated, problem)


def proofs_with_rounding(problem: ProblemData) -> Iterator[Proof | str]:
    """The proofs that bound the effect of errors in p and r, or why one fails, cheapest and sharpest first."""
    yield h_plus_proof(problem)
    yield _once(problem.facts, prove_definite, problem.matrix, problem.psi)
    if problem.psi.has_policies and problem.upper is None:
        yield supersolution_proof(problem)


def proofs_for(problem: ProblemData) -> Iterator[Proof | str]:
    """All proofs for `problem`, or the sentence why one fails, in the order in which they are tried."""
    if problem.f is not None:
        yield from proofs_by_slopes(problem)
        return
    yield from proofs_with_rounding(problem)
    if has_linear_pieces(problem):
        yield enumerated_proof(problem)


def sharpened(
    problem: ProblemData, z: Vector, proof: Proof, points: Iterator[Vector], delta: Vector, euclidean: float
) -> tuple[Vector, float]:
    """The smallest of δ(z) and |z − ẑ| + δ(ẑ) over the `points` ẑ, and the same in the Euclidean norm.

    At most `_MAX_POINTS` are tried, and none after δ(ẑ) is a small share of |z − ẑ|.
    """
    # ψ may have no value at ẑ
    with suppress(MapError, OutOfTime, MemoryError):
        for point in islice(points, _MAX_POINTS):
            error, error_euclidean = proof.bound(problem, point, *problem.rounding(point))
            step = np.abs(z - point)
            candidate = (step + error) * (1 + 4 * UNIT_ROUNDOFF)
            if candidate.max() < delta.max() or not np.isfinite(delta).all():
                delta = candidate
                euclidean = (norm_up(step) + error_euclidean) * (1 + 4 * UNIT_ROUNDOFF)
            if error.max() <= _NEGLIGIBLE * step.max():
                break
    return delta, euclidean


def _newton_points(problem: ProblemData, z: Vector, proof: Proof) -> Iterator[Vector]:
    """The iterates of an active-set Newton iteration from `z`, a factorisation each.

    If p, ψ and ψ̄ are affine, it ends when the active set repeats, as the equations are then the same. If only p is
    nonlinear, it ends when the active set repeats and the step is no shorter than the last one: only rounding is left.
    """
    before: Pattern | None = None
    repeated = False
    length = math.inf
    while np.isfinite(z).all():
        if has_linear_pieces(problem):
            pattern = Pattern.at(problem, z)
            repeated = before is not None and before.same_sides(pattern)
            before = pattern
        iterate = None if repeated and problem.f is None else proof.newton_step(problem, z)
        if iterate is None:
            return
        last = length
        length = float(np.abs(iterate - z).max())
        if length == 0.0 or (repeated and length >= last):
            return
        z = iterate
        yield z
