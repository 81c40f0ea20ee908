"""The choice of methods: `select_method` states the rule, and `Ladder` applies it to estimates of cost."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace

from ..algebra.affine_lcp import PIVOT_UP_TO
from ..algebra.relaxation import AUTO, STEPS_PER_RATE, cautious_omega
from ..algebra.schur import SchurComplement, elimination, elimination_cost
from ..errors import OutOfTime, check_arguments
from ..methods.accelerated import Accelerated
from ..methods.aor import MNMAOR, MNMGS
from ..methods.contract import Method
from ..methods.enumeration import Enumerate
from ..methods.factorised import MNMMOD
from ..methods.interior import Interior
from ..methods.milp import MAX_UNKNOWNS
from ..methods.multilevel import Multilevel
from ..methods.newton import Newton
from ..methods.proximal import Proximal
from ..methods.psor import PSOR
from ..methods.restarts import Restarts
from ..methods.shortcuts import Josephy, Lemke, Tridiagonal
from ..numerics import work
from ..numerics.arrays import as_number, as_truth
from ..numerics.multigrid import hierarchy_cost
from ..numerics.rounding import UNIT_ROUNDOFF
from ..problem.data import ProblemData, ProblemLike, as_problem
from .estimates import TRIES, Estimate, estimate_of, least_cost, least_direct_cost
from .goal import RTOL, check_family
from .jobs import Choice, Job

_LOG = logging.getLogger("icpmodel")
#: a trial of accelerated sweeps costs this share of the estimate of the next method, or half of it where ρ < 1 predicts
#: that the sweeps cost more; then the observed rate decides. Not tested for matrices whose rows have more than some
#: hundred entries
_TRIAL_SHARE = 0.25
#: the least number of accelerated sweeps that shows a rate, more than twice their history. Plain sweeps go on after
#: their trial if at most as many more of them are predicted to suffice
_ACCELERATED_SWEEPS = 20


@check_arguments
def select_method(
    problem: ProblemLike, *, rtol: float = RTOL, family: str | None = None, warm_start: bool = False
) -> Choice | None:
    """Choose the method that `solve()` runs first.

    What one method solves at once goes to it:

    1. At most 64 unknowns: `Lemke` where ψ is affine, or every ψ_i depends on z_i alone and changes by less. Where it
       ends in a ray, ten `Restarts` of it follow, and `Enumerate` up to 2¹⁴ choices of active rows. What they leave is
       for a global search. Else `Josephy`, where ψ has a derivative.
    2. A tridiagonal, and every ψ_i fixed, or dependent on z_i alone and changing by less: `Tridiagonal`.

    With a z0 the problem counts as one of a sequence with the same A, which keeps the hierarchy of `Multilevel`. Where
    `Multilevel` without the hierarchy is expected to cost less than any other method could, it begins.
    Without a z0 `Lemke` begins where it is expected to cost no more than sweeps, and than their trial in rung 3.
    The ladder below follows where `Josephy`, `Tridiagonal` or one of these ends, or has spent twice its estimate.

    Everything else goes up a ladder, each rung from the best iterate so far:

    3. Where A has a positive diagonal, sweeps. PSOR makes 12, and goes on while 20 more will do. `Accelerated` follows,
       for a quarter of what the cheapest method of rung 4 is expected to cost, and for 20 sweeps at least, which show
       a rate. It is an eighth where the Jacobi radius ρ < 1 of A foretells that it needs more than that method. If
       that is `Multilevel`, no other can cost less, and an eighth does not pay for 20 sweeps, it begins at once.
    4. Of four methods the one with the least left to do: the cheapest of `Newton` and, beyond 64 unknowns, `Lemke` and
       ten `Restarts` of it; `Multilevel`, unless it ran before; `Proximal`; `Interior`. Their estimates follow from ρ
       and the fill of the factors of A. That fill is not asked for before `Multilevel` has more left than the others
       would cost without any, nor where `Lemke` costs no more than that.
       Where an a_ii < 0 shows that A is not monotone, `Proximal` and `Lemke` begin, which descend or pivot then, too.
    5. Where one of these has ended, another that rung 4 names; after all of them MNMGS and MNMMOD. With at most 150
       unknowns they end after twice their estimates, as a global search follows.

    Before rung 4 the problem is reduced, see `solve.reduction`; each of its parts goes up a ladder of its own. Rows
    without any obstacle are equations. They are eliminated where at most √nnz rows have an obstacle, ψ is fixed, and
    that is expected to cost less than sweeps, `Multilevel` or `Lemke`: two factorisations of A and the calls of a
    Newton step. Where ρ > 1 nothing foretells the number of sweeps. They are tried for a quarter of that cost, and the
    rate that they show decides. In a sequence of problems with the same A the equations leave before anything else
    where A keeps their factors, or where these cost no more than four times what the problem before took.

    **Handing over.** From `Accelerated` on, the method with the least remaining cost runs. At first that cost is its
    estimate. A method pauses when it has spent twice its estimate, accelerated sweeps after their trial. Later it
    pauses when its cost has doubled, or when its residual should have become small enough. Its remaining cost is then
    at least what it has spent. It is up to four times that where the rate of the residual over the last half of its
    steps predicts more. For methods that end after finitely many steps the rate predicts nothing. The set-up predicts
    nothing either: what the first step costs beyond its estimate is not counted. A paused method may go on later.

    **Bound.** The best method needs T, and its remaining cost is never more than R ≥ T. Another one runs only where its
    remaining cost is at most R. At first it spends at most 2R. When it goes on later it has spent at most R, as
    its remaining cost is at least that. It pauses when this has doubled, at 2R in all. Sweeps and four methods need
    T + 8R: 9T where the best method's estimates are right, and those of set-ups. Each that ends adds 2R for the next.

    Parameters
    ----------
    problem : ICP or what `solve` takes
        The problem.
    rtol : float, default 1e-8
        The share of Res_D(0) that is asked for.
    family : {None, "modulus", "paper"}
        "modulus" leaves out what does not grow out of the modulus equation: `Lemke`, `Restarts`,
        `Enumerate`, `Josephy`, `Tridiagonal`. "paper" takes MNMAOR with θ₁ = "auto" for the sweeps of rung 3, MNMMOD
        with θ₁ = "auto" for rung 4, then MNMGS.
    warm_start : bool, default False
        Whether `solve` is given a z0.

    Returns
    -------
    Choice or None
        The method, why, and its estimate; None where no method can start.

    Examples
    --------
    >>> icp.select_method(ICP([[2, -1], [-1, 2]], [-1, 3])).method
    Lemke()
    """
    check_family(family)
    as_truth(warm_start, "warm_start")
    target_reduction = max(as_number(rtol, "rtol", minimum=0.0, below=1.0), UNIT_ROUNDOFF)
    data = as_problem(problem)
    ladder = Ladder(data, target_reduction, family, warm_start=warm_start)
    complement = ladder.complement()
    if complement:
        ladder = Ladder(complement.reduced(data), target_reduction, family)
    job = ladder.next()
    choice = job.choice if job else None
    return replace(choice, why=f"{complement!r}; {choice.why}") if choice and complement else choice


class Ladder:
    """The methods of a run, in the order that `select_method` states.

    Parameters
    ----------
    problem : ProblemData
        What the methods are given.
    target_reduction : float
        The share of Res_D(0) that is asked for.
    family : str or None
    warm_start : bool
        As in `select_method`.
    first : Method, optional
        The method that solved a similar problem after others. It runs first, and the others where it takes longer than
        expected.
    reduces : bool
        Whether it pauses before rung 4, for the problem to be reduced.
    """

    def __init__(
        self,
        problem: ProblemData,
        target_reduction: float,
        family: str | None = None,
        first: Method | None = None,
        warm_start: bool = False,
        reduces: bool = False,
    ) -> None:
        self.problem = problem
        self.target_reduction = target_reduction
        self.family = family
        #: the jobs that may run; those that are sweeps; those that begin before the others of rung 4 are estimated
        self.jobs: list[Job] = []
        self.sweeps: list[Job] = []
        self.early: list[Job] = []
        #: the jobs for each of the four places of rung 4: the first one runs, and the next one follows where it ends
        self.others: list[list[Job]] = []
        sweeps = [
            self._add_multilevel if warm_start else self._add_lemke,
            self._add_psor,
            self._add_multilevel,
            self._add_accelerated,
            self._add_elimination,
            self._pause,
            self._add_multilevel,
            self._add_lemke,
        ]
        if family == "paper":
            sweeps = [self._add_accelerated]
        self.rungs = [self._add_direct, *sweeps, self._add_proximal, self._add_newton, self._add_remaining]
        #: whether the ladder is still to pause for the reduction; the remaining cost up to which a job runs before the
        #: next rung is added; and whether the ladder is paused now
        self.reduces = reduces
        self.floor = 0.0
        self.is_paused = False
        if first:
            self.rungs.pop(0)
            for job in self._estimate_jobs([first]):
                self._begin_early(job, job.remaining)

    def complement(self) -> SchurComplement | None:
        """Add the direct methods if that is still to be done, and return the elimination of the equations if it pays.

        In a paused ladder a new elimination must cost less than methods without sparse factors. Before any method has
        begun, the last problem with the same A must have taken a quarter of what it costs.
        """
        if self._add_direct in self.rungs:
            self.rungs.pop(0)()
        if self.family != "paper" and (self.is_paused or not self.jobs):
            with suppress(OutOfTime, MemoryError):
                return elimination(self.problem, self._cost_without_factors if self.is_paused else None)
        return None

    def _cost_without_factors(self) -> float:
        """The least expected cost of methods without sparse factors, in nanoseconds; that of the jobs where ρ > 1."""
        jobs = self.jobs
        if self.problem.matrix.coupled_radius <= 1.0:
            jobs = self._estimate_jobs([self._accelerated(), Multilevel(), Lemke()])
        return min((job.remaining for job in jobs), default=math.inf)

    def _add_elimination(self) -> None:
        """Try sweeps for a share of the cost of the elimination, where ρ > 1 and nothing predicts their number."""
        if self.reduces and self.problem.matrix.coupled_radius > 1.0:
            with suppress(OutOfTime, MemoryError):
                cost = elimination_cost(self.problem, self._estimate(self._accelerated()).total)
                if cost < math.inf:
                    self._try_sweeps(cost)

    def _accelerated(self) -> Accelerated:
        return Accelerated(of=PSOR(omega=cautious_omega(self.problem)))

    def next(self) -> Job | None:
        """Add rungs until a job is to run, and return it; None if no job is left or the ladder is paused."""
        self.is_paused = False
        while not self.is_paused:
            if not self.rungs and not self.family and self.problem.n <= MAX_UNKNOWNS:
                self.jobs = [job for job in self.jobs if job.work_done < job.max_cost]
            least = min(self.jobs, key=lambda job: job.remaining, default=None)
            if not self.rungs or (least and least.remaining <= self.floor):
                return least
            self.rungs.pop(0)()
        return None

    def end(self, job: Job) -> None:
        """Remove `job`, which has ended; the next one in its place of rung 4 follows."""
        self.jobs.remove(job)
        for rung in self.others:
            if job in rung:
                rung.remove(job)
                self.jobs += rung[:1]

    def _estimate_jobs(self, methods: Iterable[Method]) -> list[Job]:
        """Jobs for the `methods` that can start, fit into memory and have not begun early, the cheapest first."""
        jobs = []
        for method in methods:
            if any(type(method) is type(job.method) for job in self.early):
                continue
            why_not = method.why_not(self.problem)
            estimate = None if why_not else self._estimate(method)
            if not (estimate and work.memory_suffices(estimate.memory)):
                _LOG.debug("n = %d: %r is left out: %s", self.problem.n, method, why_not or "memory_limit")
                continue
            products = estimate.total / self.problem.matrix.product_cost
            why = f"{max(estimate.steps, 1.0):.0f} steps are expected, as much work as {products:.3g} products with A"
            _LOG.debug("n = %d: %r: %s", self.problem.n, method, why)
            jobs.append(Job(Choice(method, why, estimate)))
        return sorted(jobs, key=lambda job: job.remaining)

    def _estimate(self, method: Method) -> Estimate:
        return estimate_of(method, self.problem.facts, self.target_reduction)

    def _add_direct(self) -> None:
        problem = self.problem
        self.floor = math.inf
        rules: list[list[Method]] = [[Tridiagonal()]]
        if problem.n <= PIVOT_UP_TO:
            rules = [[Lemke(), Restarts(tries=TRIES), Enumerate()], [Josephy()], *rules]
        for methods in () if self.family else rules:
            why_not = methods[0].why_not(problem)
            if not why_not:
                why = "A is tridiagonal" if methods == rules[-1] else f"n = {problem.n} is small"
                self.early = [Job(Choice(method, why)) for method in methods if not method.why_not(problem)]
                self.jobs += self.early
                if isinstance(methods[0], Lemke) and problem.psi.linear is not None:
                    self.rungs = [self._pause]
                break
            _LOG.debug("%r is left out: %s", methods[0], why_not)

    def _begin_early(self, job: Job, floor: float) -> None:
        """Let `job` run before the others of rung 4 are estimated, while its remaining cost is at most `floor`."""
        self._try_sweeps(job.remaining)
        self.early.append(job)
        self.jobs.append(job)
        self.floor = floor

    def _add_lemke(self) -> None:
        """Begin `Lemke` if it costs no more than sweeps and their trial, or than other methods without any fill."""
        if self._add_psor in self.rungs:
            # accelerated ones cost about twice as much
            trial = (STEPS_PER_RATE + 2 * _ACCELERATED_SWEEPS) * self._estimate(PSOR()).step
            limit = min(trial, self._estimate(self._accelerated()).total)
        else:
            limit = least_direct_cost(self.problem.facts, "modulus")
        if not self.family and self._estimate(Lemke()).total <= limit:
            for job in self._estimate_jobs([Lemke()]):
                self._begin_early(job, job.remaining)

    def _add_psor(self) -> None:
        sweeps = PSOR()
        if not sweeps.why_not(self.problem) and work.memory_suffices(32.0 * self.problem.n):
            step = self._estimate(sweeps).step
            self.floor = _ACCELERATED_SWEEPS * step
            job = Job(Choice(sweeps, f"a trial of {STEPS_PER_RATE} sweeps"))
            job.limit = STEPS_PER_RATE * step
            self.sweeps = [job]
            self.jobs += self.sweeps

    def _add_accelerated(self) -> None:
        self.floor = least_cost(self.problem.facts, self.family)
        if jobs := self._estimate_jobs([MNMAOR(theta1=AUTO) if self.family == "paper" else self._accelerated()]):
            self.jobs = [*jobs, *(job for job in self.jobs if job not in self.sweeps)]
            self.sweeps = jobs
            self._try_sweeps(self.floor)

    def _try_sweeps(self, following: float) -> None:
        """Let the sweeps run first for their share of `following`, the expected cost of the next method."""
        for job in self.sweeps:
            if estimate := job.choice.estimate:
                hopeless = self.problem.matrix.coupled_radius < 1.0 and estimate.total > following
                share = 0.5 * _TRIAL_SHARE if hopeless else _TRIAL_SHARE
                trial = max(share * following, _ACCELERATED_SWEEPS * estimate.step)
                if job.work_done < trial:
                    job.limit = trial
                    job.remaining = 0.0

    def _pause(self) -> None:
        self.is_paused = self.reduces
        self.reduces = False

    def _add_multilevel(self) -> None:
        """Begin `Multilevel` if the others would cost more even without fill: no symbolic analysis is needed then.

        With a warm start this is decided before any sweeps: if A keeps the hierarchy, they can save no set-up.
        """
        problem = self.problem
        is_first = self._add_psor in self.rungs
        least = least_direct_cost(problem.facts, self.family)
        if self._add_accelerated in self.rungs:
            sweeps = self._estimate(self._accelerated())
            shortest = math.inf if is_first else 2.0 * _ACCELERATED_SWEEPS * sweeps.step / _TRIAL_SHARE
            least = min(least, sweeps.total, shortest) if problem.matrix.coupled_radius < 1.0 else 0.0
        for job in self._estimate_jobs([Multilevel()]):
            if is_first:
                saved_cost = hierarchy_cost(problem.n, problem.nnz)
                job.remaining -= saved_cost
                job.limit -= saved_cost
                job.choice = replace(job.choice, why=f"{job.choice.why}, and A keeps the hierarchy")
            if job.remaining <= least:
                if self._add_accelerated in self.rungs:
                    self.jobs = [one for one in self.jobs if one not in self.sweeps]
                self._begin_early(job, least)
                if not is_first:
                    self._pause()

    def _add_proximal(self) -> None:
        """Begin `Proximal`, and `Lemke` without a family, before the others if an a_ii < 0: A is not monotone."""
        if self.family != "paper" and self.problem.matrix.has_negative_diagonal:
            for job in self._estimate_jobs([Proximal()] if self.family else [Proximal(), Lemke()]):
                self._begin_early(job, job.remaining)

    def _add_newton(self) -> None:
        self.floor = math.inf
        rungs: list[list[Method]] = [[Newton()], [Multilevel()], [Proximal()], [Interior()]]
        if self.family == "paper":
            rungs = [[MNMMOD(theta1=AUTO)]]
        elif not self.family:
            rungs[0] += [Lemke(), Restarts(tries=TRIES)]
        self.others = list(map(self._estimate_jobs, rungs))
        for job in self.early:
            if isinstance(job.method, Lemke) and job in self.jobs:
                self.jobs.remove(job)
                for other in self.others[0]:
                    if isinstance(other.method, Restarts):  # they begin where `Lemke` ends
                        other.remaining = max(other.remaining, job.remaining)
                self.others[0] = sorted([job, *self.others[0]], key=lambda job: job.remaining)
        began = [rung[0] for rung in self.others if rung]
        self.jobs += began
        self._try_sweeps(min((job.remaining for job in began), default=math.inf))

    def _add_remaining(self) -> None:
        self.jobs += self._estimate_jobs([MNMGS()] if self.family == "paper" else [MNMGS(), MNMMOD(theta1=AUTO)])
