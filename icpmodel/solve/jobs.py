"""The methods of a run: why each was chosen, the work that it has done, and its remaining cost."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..methods.contract import Method
from ..numerics.rounding import SMALLEST
from ..present.display import Displayable, counted
from .estimates import Estimate
from .stopping import StopReason

#: a method pauses when it has spent this multiple of its estimate; its remaining cost is then at least the work done,
#: and at most the second number times the work done
_MAX_OVERRUN = 2.0
_MAX_REMAINING_FACTOR = 4.0


@dataclass(frozen=True, repr=False)
class Choice(Displayable):
    """The method that was chosen, and why.

    Attributes
    ----------
    method : Method
        The method.
    why : str
        Why it was chosen.
    estimate : Estimate or None
        Its expected cost; None where the structure of the problem decides.

    Examples
    --------
    >>> icp.select_method(ICP([[2.0, 1.0], [1.0, 2.0]], [-1.0, 3.0], [0.0, 1.0])).why
    'n = 2 is small'
    """

    method: Method
    why: str = ""
    estimate: Estimate | None = None


class Job:
    """A method in a run: why it was chosen, the work done, the residuals, and the remaining cost.

    Parameters
    ----------
    choice : Choice
    """

    def __init__(self, choice: Choice) -> None:
        self.choice = choice
        self.method = choice.method
        #: why it ended; None while it may go on
        self.stop_reason: StopReason | None = None
        #: whether it began at the start of the run, with the problem as given
        self.is_fresh = False
        self.steps = 0
        self.work_done = 0.0
        #: those of its iterates; the first one is that of its start
        self.residuals: list[float] = []
        self.remaining = choice.estimate.total if choice.estimate else 0.0
        #: twice its estimate (`max_cost`), and at first also the work at which it is compared with others (`limit`)
        self.limit = self.max_cost = _MAX_OVERRUN * self.remaining or math.inf

    @property
    def outcome(self) -> str:
        """The status with which it ended, or empty."""
        return self.stop_reason.status.value if self.stop_reason else ""

    def step(self, cost: float, residual: float, target: float) -> bool:
        """Count a step to `residual`; return whether to compare with other methods. The run aims at `target`."""
        if not self.steps and (estimate := self.choice.estimate):  # a set-up beyond its estimate predicts nothing
            cost = min(cost, estimate.setup + estimate.step)
        self.steps += 1
        self.work_done += cost
        self.residuals.append(residual)
        self.remaining = max(self.remaining - cost, 0.0)
        if self.work_done < self.limit:
            return False
        self.remaining = self._remaining_cost(target)
        self.limit = self.work_done + min(self.work_done, self.remaining)
        return True

    def _remaining_cost(self, target: float) -> float:
        """The remaining cost by the rate over the last half of the steps; for a finite method the cost so far."""
        if self.method.finite:
            return self.work_done
        half = self.steps // 2
        # a residual may be rounded to 0 where z is no solution
        least = max(min(self.residuals), SMALLEST)
        gained = math.log(max(min(self.residuals[: half + 1]), SMALLEST)) - math.log(least)
        if not gained > 0.0:
            return _MAX_REMAINING_FACTOR * self.work_done
        steps = (math.log(least) - math.log(target)) * (self.steps - half) / gained
        return min(max(steps * self.work_done / self.steps, self.work_done), _MAX_REMAINING_FACTOR * self.work_done)

    def __str__(self) -> str:
        """The method and its progress: 40 steps (300 expected)."""
        estimate = self.choice.estimate
        expected = f" ({max(estimate.steps, 1.0):.0f} expected)" if estimate else ""
        return f"{self.method!r}, {counted(self.steps, 'step')}{expected}"


class MethodSequence:
    """Methods that run one after the other, with the interface of `Ladder`.

    Parameters
    ----------
    methods : Method
        In the order in which they run.
    why : str
        Why they are tried.
    """

    def __init__(self, *methods: Method, why: str = "") -> None:
        self.jobs = [Job(Choice(method, why)) for method in methods]

    def next(self) -> Job | None:
        """The job to run, None where none is left."""
        return self.jobs[0] if self.jobs else None

    def end(self, job: Job) -> None:
        """Remove `job`, which has ended."""
        self.jobs.remove(job)
