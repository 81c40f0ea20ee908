"""The convergence theorems for the modulus family, corrected and as printed, checked on a problem and a method."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from ...algebra.splittings import Member
from ...errors import InputError, OutOfTime, SingularOperator, check_arguments
from ...numerics import work
from ...numerics.arrays import Vector, as_truth, described
from ...numerics.fill import dense_cost
from ...numerics.rounding import UNIT_ROUNDOFF, rounded_down, rounded_up
from ...problem.data import ProblemData
from ..answers import UNLIMITED, Allowance, Answer
from ..certificates.bounds import h_plus_proof
from ..certificates.proof import no_lipschitz
from .conditions import StepMatrices, printed_42, printed_44, sharper, theorem_41, theorem_42, theorem_43, theorem_44
from .contraction import HomogeneousMap, radius
from .rowwise import rowwise
from .structural import DEFINITE, MONOTONE, definite, monotone


@dataclass(frozen=True, eq=False, repr=False)
class Check(Answer):
    """Whether the hypotheses of a theorem hold: an `Answer` with the theorem beside it.

    Attributes
    ----------
    holds : bool or None
        False says that the theorem does not apply, not that the method fails.
    number : float
        A proved upper bound of the spectral radius that the theorem requires to be below 1, or for
        4.3 below min(1, θ₁)/max(θ₁, θ₂). For "definite" it is the factor σ.
    witness : array of shape (n,)
        The scaling v > 0 that proves it, also called `vector`.
    theorem : str
        The name.
    sentence : str
        The statement.
    as_printed : bool
        Whether it is the paper's own statement.
    false_as_printed : str
        The counterexample to the paper's own statement, in words; empty if that is true.

    Examples
    --------
    >>> from icpmodel import MNMJ
    >>> found = check("4.1", ICP([[2, -1], [-1, 2]], [0, 0]), MNMJ())
    >>> found.holds, round(found.number, 6), found.vector
    (True, 0.5, array([1., 1.]))
    """

    theorem: str = ""
    sentence: str = ""
    as_printed: bool = False
    false_as_printed: str = ""

    @property
    def vector(self) -> Vector | None:
        """The scaling v > 0, shape (n,), or None."""
        return self.witness

    def __str__(self) -> str:
        misleads = self.holds and self.as_printed and self.false_as_printed
        return super().__str__() + (" (but the theorem as printed is false)" if misleads else "")


@dataclass(frozen=True)
class _Theorem:
    sentence: str
    decide: Callable[[StepMatrices], Answer]
    printed_sentence: str = ""
    printed: Callable[[StepMatrices], Answer] | None = None
    false: str = ""
    #: True if it is about members whose modulus uses the newest values, False if the previous iterate, None if both
    newest: bool | None = False


@check_arguments
def theorems() -> dict[str, str]:
    """Every theorem in one sentence, as corrected.

    Returns
    -------
    dict
        Name → sentence.

    Examples
    --------
    >>> list(theorems())
    ['4.1', '4.2', '4.3', '4.4', 'sharper', 'rowwise', 'monotone', 'definite']
    """
    return {name: theorem.sentence for name, theorem in _THEOREMS.items()}


@check_arguments
def check(theorem: str, problem: ProblemData, member: Member, as_printed: bool = False) -> Check:
    """Whether `member` meets the hypotheses of `theorem` on `problem`, rounding included.

    Parameters
    ----------
    theorem : str
        One of `theorems()`.
    problem : ProblemData
        The problem.
    member : Member
        A method of the modulus family, as an object.
    as_printed : bool, default False
        Whether to check the paper's own statement. It may be false (`Check.false_as_printed`) and
        is kept for comparison.

    Returns
    -------
    Check
        The answer.

    Raises
    ------
    InputError
        For an unknown theorem, or one that the paper does not print.

    References
    ----------
    The docstrings of `icpmodel.theory.convergence.conditions`, `.rowwise` and `.structural` hold
    statements and proofs.

    Examples
    --------
    >>> from icpmodel import MNMGS
    >>> print(check("4.3", ICP([[1.0]], [-1.0]), MNMGS(phi=-1.5)))
    no: phi has the negative entry -1.5
    """
    return _check(theorem, StepMatrices(problem, member), as_truth(as_printed, "as_printed"))


@check_arguments
def check_all(problem: ProblemData, member: Member, limit: Allowance = UNLIMITED) -> dict[str, Check]:
    """Check every theorem, as corrected.

    Parameters
    ----------
    problem : ProblemData
        The problem.
    member : Member
        The method.
    limit : Allowance, optional
        The limit of each check; none by default.

    Returns
    -------
    dict
        Name → `Check`.

    Raises
    ------
    InputError
        For a limit that is no `Allowance`.

    Notes
    -----
    The vector that serves one theorem is tried first on the next.

    Examples
    --------
    >>> from icpmodel import MNMGS
    >>> [
    ...     name
    ...     for name, found in check_all(ICP([[2, -1], [-1, 2]], [0, 0]), MNMGS()).items()
    ...     if found.holds
    ... ]
    ['4.1', '4.2', '4.3', '4.4', 'sharper']
    """
    if not isinstance(limit, Allowance):
        raise InputError(f"limit is {described(limit)}; an Allowance of icpmodel.theory.answers was expected")
    try:
        with limit.enforced():
            step = StepMatrices(problem, member)
    except (OutOfTime, MemoryError) as error:
        return {name: _of(name, Answer(None, limit.undecided(error))) for name in _THEOREMS}
    checks: dict[str, Check] = {}
    for name in _ORDER:
        try:
            with limit.enforced():
                checks[name] = _check(name, step, False)
        except (OutOfTime, MemoryError) as error:
            checks[name] = _of(name, Answer(None, limit.undecided(error)))
            for stronger in _STRONGER_THEOREMS.get(name, ()):
                if stronger in checks and checks[stronger].holds:
                    reason = f"it follows from theorem {stronger}, with the same v"
                    checks[name] = _of(name, Answer(True, reason, checks[stronger].vector))
    return {name: checks[name] for name in _THEOREMS}


def holding(problem: ProblemData, member: Member, names: Iterable[str], printed: Iterable[str]) -> tuple[set[str], ...]:
    """Which of the theorems `names` hold, and which of `printed` as printed; without numbers it costs half as much."""
    step = StepMatrices(problem, member)
    step.target = 1.0
    groups = sorted(names, key=_ORDER.index), printed
    return tuple({name for name in some if _check(name, step, some is printed).holds} for some in groups)


def _of(name: str, answer: Answer, as_printed: bool = False) -> Check:
    theorem = _THEOREMS[name]
    sentence = theorem.printed_sentence if as_printed else theorem.sentence
    return Check(**vars(answer), theorem=name, sentence=sentence, as_printed=as_printed, false_as_printed=theorem.false)


def _check(name: str, step: StepMatrices, as_printed: bool) -> Check:
    if not isinstance(name, str) or name not in _THEOREMS:
        raise InputError(f"theorem is {described(name)}; one of {', '.join(_THEOREMS)} was expected")
    theorem = _THEOREMS[name]
    decide = theorem.printed if as_printed else theorem.decide
    if decide is None:
        raise InputError(f"theorem is {name!r} as printed, but the paper does not print it")
    with np.errstate(all="ignore"):  # what overflows proves nothing
        if theorem.newest not in (None, step.sees_newest):
            answer = Answer(False, _OTHER_VALUES[step.sees_newest])
        elif not (step.omega > 0).all():
            answer = Answer(False, f"Omega has the entry {step.omega.min():g}, not positive")
        else:
            answer = decide(step)
    return _of(name, answer, as_printed)


def _starts(step: StepMatrices) -> Iterator[Vector]:
    """Yield v: those of other theorems, 1, that of `h_plus`, and for small n balancing: Osborne, J. ACM 7 (1960)."""
    yield from reversed(step.vectors)
    yield np.ones(step.n)
    proof = h_plus_proof(step.problem)
    if not isinstance(proof, str):
        yield proof.v
    if 1 < step.n <= 500:
        work.charge(dense_cost(step.n))
        from scipy.linalg import matrix_balance

        quotients = step.size.toarray() / step.size.diagonal()[:, None]
        if np.isfinite(quotients).all():
            yield matrix_balance(quotients, permute=False, separate=True)[1][0]


def _by_radius(name: str, make: Callable[[StepMatrices], HomogeneousMap | str]) -> Callable[[StepMatrices], Answer]:
    """Make a function that decides by ρ(T) < 1, T = make(step); `name` names its number, ρ(T) times T.limit."""

    def decide(step: StepMatrices) -> Answer:
        if step.G is None:
            return Answer(None, no_lipschitz(step.problem.psi))
        T = make(step)
        if isinstance(T, str):
            return Answer(False, T)
        bound = radius(T, _starts(step), step.target)
        if bound.v is None:
            return _without_inverse(step)
        if bound.holds:
            step.vectors.append(bound.v)
        number = bound.upper * T.limit * (1.0 if T.limit == 1.0 else 1 + 4 * UNIT_ROUNDOFF)
        limit = f"{T.limit:.6g}"
        if float(limit) <= number < T.limit:  # more digits, so that a proved inequality does not look false
            limit = repr(T.limit)
        size = rounded_up(number, 6, below=float(limit))
        reasons = {
            None: f"{name} < {limit} is needed, but no more than {name} <= {size} is known",
            True: f"{name} is at most {size}, below {limit}",
            False: f"{name} is at least {rounded_down(T.limit, 6)}, and at most {size}",
        }
        return Answer(bound.holds, reasons[bound.holds], bound.v if bound.holds else None, number)

    return decide


def _without_inverse(step: StepMatrices) -> Answer:
    if step.sees_newest:
        return Answer(None, "the bounds of a sweep overflow")
    try:
        step.splitting.operator(step.A, step.phi + step.omega)
    except SingularOperator as error:
        return Answer(False, str(error))
    return Answer(None, "nothing is known of |X^-1|: X is not an H-matrix and too large or ill conditioned")


#: whether the modulus uses the newest values → why a theorem about the other kind of member does not apply
_OTHER_VALUES = {
    False: "it covers methods whose modulus uses the newest values: projected SOR",
    True: "it covers methods whose modulus uses the previous iterate; here it uses the newest values",
}
_CONVERGES = (
    "then ICP has one solution (with an upper obstacle: if ψ ≤ ψ̄ at the limit, else none) and the method converges to "
    "it from every start"
)

_THEOREMS = {
    "4.1": _Theorem(
        "If ρ(L) < 1, L = |X⁻¹|(|N₁ + φ| + |A − Ω| + 2ΩG), " + _CONVERGES + ", |zᵏ − z*| ≤ Lᵏ(I − L)⁻¹|z¹ − z⁰|",
        _by_radius("rho(L)", theorem_41),
        "If A is a P-matrix and ρ(L) < 1, L = |X⁻¹|(|N₁ + φ| + |A − Ω| + 2ΩG), then ICP has one solution. The "
        "method converges to it from every nonnegative start, each |zᵏ⁺¹ − z*| < |zᵏ − z*|",
        # that A is a P-matrix follows: for psi = 0 and every q the step has one fixed point
        _by_radius("rho(L)", theorem_41),
        "the componentwise decrease: A = [2, −1; −.5, 2], q = −A(1, 1), Gauss–Seidel, Ω = D, z⁰ = (1, 3) has "
        "|e⁰| = (0, 2), |e¹| = (1, .125); convergence holds, and no start need be nonnegative",
    ),
    "4.2": _Theorem(
        "If 2(diag(min(m₁ + φ, d)) − (D − Ω)⁺) − off(|M₁| + |N₁| + |A|) − 2ΩG is a nonsingular M-matrix, " + _CONVERGES,
        _by_radius("rho of its Jacobi matrix", theorem_42),
        "If A is an H₊-matrix with an H-splitting, φ₂ ≥ φ₁D, g_ii ≤ (|n_ii + φ_ii| − n_ii − |φ_ii|)/2ω_ii and "
        "g_ij ≤ (|m_ij| + |n_ij| − |a_ij|)/2ω_ii, " + _CONVERGES,
        _by_radius("rho(m^-1(off|M| + |N|))", printed_42),
    ),
    "4.3": _Theorem(
        "AOR: if D > 0, φ ≥ 0, θ₁ > 0, θ₂ ≥ 0 and max(θ₁, θ₂)·ρ(D⁻¹(|B| + ΩG + (D − Ω)⁺)) < min(1, θ₁), " + _CONVERGES,
        _by_radius("rho(D^-1(|B| + Omega G + (D - Omega)+))", theorem_43),
        "AOR: if A is an H₊-matrix, φ₂ ≥ φ₁D and max(θ₁, θ₂)·ρ(D⁻¹|B| + φ₂G) < min(1, θ₁), " + _CONVERGES,
        _by_radius("rho(D^-1|B| + phi2 G)", lambda step: theorem_43(step, as_printed=True)),
        "the parenthesis: A = .1, q = 1, ψ = 6 − 5z, φ₁ = 1, φ₂ = .1 ends in the cycle −10, 56. φ < 0: A = 1, q = −1, "
        "φ = −1.5 has the error factor −3. θ₂ < 0: A = [1, −.5; −.5, 1], θ = (1, −4) has an error matrix of radius "
        "1.151",
    ),
    "4.4": _Theorem(
        "If D > 0 and some v > 0 has (⟨M₁ + φ⟩ − |N₁ + φ| − (D − Ω)⁺ − ΩG)v > 0, " + _CONVERGES,
        _by_radius("rho(m^-1(off|M| + |N| + (D - Omega)+ + Omega G))", theorem_44),
        "If the splitting of the H₊-matrix A is an H-splitting proved by v > 0 and, where φ₂ ≥ φ₁D, "
        "(⟨φ₁M₁ + φ⟩ − |φ₁N₁ + φ| − φ₂G)v > 0 or, where φ₂ < φ₁D, (φ₂ − φ₁D + the same)v > 0, " + _CONVERGES,
        _by_radius("the radius of the printed condition", printed_44),
        "case (1), φ not multiplied by φ₁: A = 1, M₁ = .1, φ = .5, φ₁ = φ₂ = .1, ψ = 1.9 − .9z, q = 5 has the error "
        "factor −1.375; case (2): A = 1, M₁ = .1, φ = .5, φ₁ = .1, φ₂ = .01, ψ = 0, q = −1 has −1.857",
    ),
    "sharper": _Theorem(
        "If some v > 0 has |X⁻¹| max(|X − 2A|v, (|X − 2Ω| + 2ΩG)v) ≤ σv with σ < 1, " + _CONVERGES + ", and "
        "every step leaves at most σ times max_i |z_i − z*_i|/v_i",
        _by_radius("the contraction factor", sharper),
    ),
    "rowwise": _Theorem(
        "If the modulus sees the newest values (projected SOR) and some v > 0 has w ≤ σv with σ < 1, row by row "
        "w_i = max((Gv)_i, |1 − ω|v_i + (ω/a_ii)(Σ_{j<i}|a_ij|w_j + Σ_{j>i}|a_ij|v_j)), " + _CONVERGES + ", and every "
        "step leaves at most σ times max_i |z_i − z*_i|/v_i",
        _by_radius("the contraction factor", rowwise),
        newest=True,
    ),
    "monotone": _Theorem(MONOTONE, monotone, newest=None),
    "definite": _Theorem(DEFINITE, definite),
}
#: the cheap one whose v proves most others, then the strongest
_ORDER = ("4.3", "sharper", "4.4", "4.2", "4.1", "rowwise", "monotone", "definite")
#: theorem → those that imply it, with the same v: see `conditions`
_STRONGER_THEOREMS = {"4.2": ("4.3",), "4.1": ("4.2", "4.3", "4.4"), "sharper": ("4.1", "4.2", "4.3", "4.4")}
