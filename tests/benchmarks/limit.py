"""solve() against one linear solve."""

from functools import partial

import numpy as np

import icpmodel as icp

from .harness import affine, compared, elementwise, linear_solve, on_new, time_calls, timer, warm

#: the height of the lid of the membrane: a quarter of its rows touch it
LID = 0.2


def table(sizes=(10_000, 100_000, 1_000_000), repeats=5):
    """`solve()` against one linear solve with A by PyAMG to 1e-8, set-up included, timed in turn.

    On the membrane, the ball, and the membrane with ψ elementwise, ψ affine, a lid, A nonsymmetric, A strongly
    dominant. The last column is the time of `solve()` in products with A.

    Parameters
    ----------
    sizes : numbers of unknowns (the nearest squares)
    repeats : pairs of timings
    """
    yield "problem", "n", "method", "solve, s", "linear solve, s", "ratio", "lowest", "highest", "solve / (A @ z)"
    for n in sizes:
        for name, problem in variants(n):
            b = np.ones(problem.n)
            calls = {
                "ours": on_new(problem, icp.ICP.solve),
                "other": timer(partial(linear_solve, problem.A, b)),
                "product": warm(partial(problem.A.dot, b)),
            }
            taken = time_calls(calls, repeats)
            products = compared(taken, "ours", "product")[2]
            yield name, problem.n, problem.solve().method.name, *compared(taken, "ours", "other"), products


def variants(n):
    """(name, problem) of every row."""
    scene = partial(icp.scenes.scene, n=n)
    problem = scene("membrane").problem
    yield "membrane", problem
    yield "ball", scene("ball").problem
    yield "elementwise psi", elementwise(problem, 0.5)
    yield "affine psi", affine(problem)
    yield "two obstacles", problem.with_upper(np.maximum(problem.psi.value(problem.q), LID))
    yield "skew = 0.5", scene("membrane", skew=0.5).problem
    yield "mu = 4", scene("membrane", mu=4.0).problem
