"""What a derivative costs: in linear solves, and against cvxpylayers, which differentiates quadratic programs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from typing import Any

import numpy as np

from ..derivatives.derivative import Derivative
from ..icp import ICP
from ..numerics.multigrid import linear_solve
from ..present.table import Table
from ..scenes import scene
from ..study.timing import as_repeats, clocked, machine, middle, timed

_LAYERS = "cvxpylayers"


def derivative_cost(
    sizes: Sequence[int] = (10_000, 100_000, 1_000_000), layers: Sequence[int] = (400, 1600), repeats: int = 5
) -> Table:
    """The derivative of the membrane's answer against one linear solve and against cvxpylayers, timed in turn.

    "first adjoint" is `Derivative(solution).adjoint(zbar)` of an answer of which nothing but z is known, the multigrid
    levels being there where the solve has left them; "next adjoint" and "next forward" are on the same object. The
    linear solve is PyAMG's Ruge–Stüben hierarchy with conjugate gradients to 1e-8, set-up included. "solve and adjoint"
    stands against the forward and the backward pass of the same problem as a quadratic program with the parameter q in
    cvxpylayers, in JAX, both warm, the median of those in a row that fill a fifth of a second; without it these rows
    are left out.
    Parameters: `sizes` unknowns (the nearest squares) against linear solves; `layers` unknowns against cvxpylayers;
    `repeats` rounds of timings, ≥ 3. Returns a `Table` (seconds; the ratio is the median of those pair by pair).
    Reference: Agrawal et al., Differentiable convex optimization layers (2019).

    >>> icp.benchmarks.derivative_cost(sizes=[100], layers=[], repeats=3).rows[0][:3]
    (100, 'first adjoint', 'linear solve')
    """
    repeats, rows = as_repeats(repeats), []
    for n in sizes:
        problem = scene("membrane", n).problem
        rows += [(problem.n, *found) for found in _in_linear_solves(problem, repeats)]
    for n in layers if find_spec(_LAYERS) else ():
        problem = scene("membrane", n).problem
        calls = {"": middle(partial(_once, problem, np.ones(problem.n))), _LAYERS: middle(_layer(problem))}
        taken = timed(calls, repeats)
        times = taken.median(""), taken.median(_LAYERS), *taken.ratio("", _LAYERS)
        rows.append((problem.n, "solve and adjoint", _LAYERS, *times))
    heads = ("n", "derivative", "against", "s", "the other, s", "ratio", "lowest", "highest")
    return Table(f"Derivatives of the membrane's answer ({machine()})", heads, tuple(rows))


def _in_linear_solves(problem: ICP, repeats: int) -> Iterator[tuple[Any, ...]]:
    solution, ones = problem.solve(), np.ones(problem.n)
    derivative = Derivative(solution)
    calls: dict[str, Callable[[], float]] = {
        "first adjoint": clocked(lambda new: Derivative(new).adjoint(ones), partial(replace, solution)),
        "next adjoint": clocked(partial(derivative.adjoint, ones)),
        "next forward": clocked(partial(derivative.forward, dq=ones)),
        "": clocked(partial(linear_solve, problem.A, ones)),
    }
    taken = timed(calls, repeats)
    for name in list(calls)[:-1]:
        yield name, "linear solve", taken.median(name), taken.median(""), *taken.ratio(name, "")


def _once(problem: ICP, zbar: np.ndarray) -> np.ndarray:
    """The gradient of z̄ᵀz* in q, of a problem of which only A is known."""
    return Derivative(problem.with_q(problem.q).solve()).adjoint(zbar).q


def _layer(problem: ICP) -> Callable[[], Any]:
    """The same by cvxpylayers; JAX begins without waiting for the answer, which is why it is asked for."""
    import cvxpy as cp
    import jax
    from cvxpylayers.jax import CvxpyLayer

    z, q = cp.Variable(problem.n), cp.Parameter(problem.n)
    energy = 0.5 * cp.quad_form(z, cp.psd_wrap(problem.A)) + q @ z
    layer = CvxpyLayer(cp.Problem(cp.Minimize(energy), [z >= problem.psi.value(problem.q)]), [q], [z])
    gradient = jax.grad(lambda value: layer(value)[0].sum())
    return lambda: np.asarray(gradient(jax.numpy.asarray(problem.q)))
