"""Derivatives of the membrane's answer."""

from dataclasses import replace
from functools import partial
from importlib.util import find_spec

import numpy as np

import icpmodel as icp

from .harness import compared, linear_solve, pair, time_calls, timer, warm


def table(sizes=(10_000, 100_000, 1_000_000), layers=(400, 1600), repeats=5):
    """The derivative of the membrane's answer against one linear solve and against cvxpylayers, timed in turn.

    "first adjoint" is of an answer of which nothing but z is known; the levels are there where the solve has left
    them. "next adjoint" and "next forward" are on the same object. "solve and adjoint" stands against the forward and
    the backward pass of the same quadratic program in cvxpylayers with JAX, both warm; without it these rows are left
    out.

    Parameters
    ----------
    sizes : unknowns (the nearest squares) against linear solves
    layers : unknowns against cvxpylayers
    repeats : rounds of timings

    References
    ----------
    Agrawal et al., Differentiable convex optimization layers (2019).
    """
    yield "n", "derivative", "against", "s", "the other, s", "ratio", "lowest", "highest"
    for n in sizes:
        problem = icp.scenes.membrane(n=n).problem
        ones = np.ones(problem.n)
        solution = problem.solve()
        derivative = solution.derivative()
        calls = {
            "first adjoint": timer(lambda new, ones=ones: new.derivative().adjoint(ones), partial(replace, solution)),
            "next adjoint": timer(partial(derivative.adjoint, ones)),
            "next forward": timer(partial(derivative.forward, dq=ones)),
            "linear solve": timer(partial(linear_solve, problem.A, ones)),
        }
        taken = time_calls(calls, repeats)
        *names, other = calls
        for name in names:
            yield problem.n, name, other, *compared(taken, name, other)
    for n in layers if find_spec("cvxpylayers") else ():
        problem = icp.scenes.membrane(n=n).problem
        times = pair(warm(partial(once, problem)), warm(layer(problem)), repeats)
        yield problem.n, "solve and adjoint", "cvxpylayers", *times


def once(problem):
    """The gradient of 1ᵀz* in q, of a problem of which only A is known."""
    return problem.with_q(problem.q).solve().derivative().adjoint(np.ones(problem.n)).q


def layer(problem):
    """The same by cvxpylayers; JAX begins without waiting for the answer, which is why it is asked for."""
    import cvxpy as cp
    import jax
    from cvxpylayers.jax import CvxpyLayer

    z, q = cp.Variable(problem.n), cp.Parameter(problem.n)
    energy = 0.5 * cp.quad_form(z, cp.psd_wrap(problem.A)) + q @ z
    made = CvxpyLayer(cp.Problem(cp.Minimize(energy), [z >= problem.psi.value(problem.q)]), [q], [z])
    gradient = jax.grad(lambda value: made(value)[0].sum())
    return lambda: np.asarray(gradient(jax.numpy.asarray(problem.q)))
