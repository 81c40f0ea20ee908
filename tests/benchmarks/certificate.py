"""A certificate against one linear solve."""

from functools import partial

import numpy as np

import icpmodel as icp
from icpmodel.study.cases import uncached_copy

from .harness import compared, linear_solve, time_calls, timer


def table(n=1_000_000, repeats=5):
    """The certificate of an answer of `solve()` on the membrane against one linear solve with A, timed in turn.

    "of z itself" is the bound that looks for no better point, "from scratch" the default, both of a problem of which
    nothing is known yet; "after solve" is the default of a problem that multigrid has just solved. A solve to
    rounding stands for z*.

    Parameters
    ----------
    n : unknowns (the nearest square)
    repeats : rounds of timings
    """
    yield "n", "bound", "s", "linear solve, s", "ratio", "lowest", "highest", "bound / error", "rows decided"
    problem = icp.scenes.membrane(n=n).problem
    z = problem.solve("multilevel").z
    error = np.abs(z - problem.solve("multilevel", z0=z, rtol=1e-14, raise_on_failure=False).z).max()
    plain, full = partial(icp.error_bound, z=z, sharp=False), partial(icp.error_bound, z=z)

    def solved():
        new = uncached_copy(problem)
        new.solve("multilevel")
        return new

    calls = {
        "of z itself": (plain, timer(plain, partial(uncached_copy, problem))),
        "after solve": (full, timer(full, solved)),
        "from scratch": (full, timer(full, partial(uncached_copy, problem))),
    }
    linear = timer(partial(linear_solve, problem.A, np.ones(problem.n)))
    taken = time_calls({name: call for name, (_, call) in calls.items()} | {"linear": linear}, repeats)
    for name, (bound, _) in calls.items():
        certified = bound(problem)
        decided = 1.0 - icp.theory.active_set(problem, z, certified).undecided.mean()
        yield problem.n, name, *compared(taken, name, "linear"), certified.value / error, f"{100 * decided:.4g} %"
