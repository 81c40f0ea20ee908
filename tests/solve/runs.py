"""Runs without `solve` around them, for the tests of the loop and of the reduction."""

import numpy as np

from icpmodel.solve.driver import run_methods
from icpmodel.solve.goal import Goal, Limits
from icpmodel.solve.outcome import solution_of
from icpmodel.solve.run import Run

LIMITS = Limits(rtol=1e-8, atol=0.0, max_iter=10**5, time_limit=None)


def run_on(problem, rtol=0.0, **shown):
    """A run from 0 to `rtol`, or as far as it gets."""
    at_0 = problem.residual_at_0()
    start, reduction = np.zeros(problem.n), rtol or 1e-14
    return Run(problem, start, at_0, Goal(rtol * at_0), limits=LIMITS, target_reduction=reduction, scale=at_0, **shown)


def ended(run, steps):
    """The solution of a run after these steps."""
    run_methods(run, steps)
    return solution_of(run, LIMITS)
