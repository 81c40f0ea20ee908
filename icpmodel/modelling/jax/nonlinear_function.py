"""The answer of p = F(z, θ) ≥ 0 ⟂ z ≥ ψ, F written in JAX, as a differentiable function of θ."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ...errors import InputError
from ...icp import ICP
from ...numerics.arrays import Vector, as_number, as_vector, described
from ...solve.goal import RTOL
from .argument_forms import check_float64, the_package
from .callbacks import in_worker_thread, worker_threads


def nonlinear_solution_of(
    F: Callable[[Any, Any], Any],
    n: int,
    *,
    psi: Any = 0.0,
    upper: Any = None,
    z0: Any = None,
    rtol: float = RTOL,
    atol: float = 0.0,
    time_limit: float | None = None,
) -> Callable[[Any], Any]:
    """The answer z of F(z, θ) ≥ 0 ⟂ z ≥ ψ as a function of θ, for `jax.jit`, `grad`, `jacrev`, `jacfwd` and `vmap`.

    Parameters
    ----------
    F : callable
        A function of JAX, (z, θ) ↦ p, z and p of shape (n,). θ is an array, or a tree of arrays.
    n : int
        Number of unknowns.
    psi, upper : float or array_like of shape (n,), optional
        Fixed bounds of z, by default 0 and none.
    z0 : array_like of shape (n,), optional
        The start, as for `solve`.
    rtol, atol : float, default 1e-8, 0
        Tolerances, as for `solve`.
    time_limit : float, optional
        Seconds, as for `solve`.

    Returns
    -------
    callable
        θ ↦ z, shape (n,), float64.

    Raises
    ------
    InputError
        Where F is no function, a bound is no vector of n numbers, or JAX has not float64.

    Notes
    -----
    The Jacobian is `jax.jacfwd(F)`. With M the rows of F′ where p is the smaller one, and of I elsewhere, z is
    z* − M⁻¹m(z*, θ), m being p or z − bound. At the answer m = 0, so that the derivative in θ is that of the implicit
    function. Where p = r = 0 it is that of one side.

    References
    ----------
    Blondel and others, Efficient and Modular Implicit Differentiation, NeurIPS 35 (2022).

    Examples
    --------
    >>> from importlib.util import find_spec
    >>> if find_spec("jax"):
    ...     import jax
    ...
    ...     with jax.enable_x64(True):
    ...         root = nonlinear_solution_of(lambda z, theta: z**2 - theta, 1, z0=[1.0])
    ...         print(jax.jacrev(root)(4.0).round(6))
    ... else:
    ...     print("[0.25]")
    [0.25]
    """
    jax = the_package()
    worker_threads()
    if not callable(F):
        raise InputError(f"F is {described(F)}; a function of z and theta was expected")
    size = int(as_number(n, "n", least=1, whole=True))
    slope = jax.jacfwd(F)
    low = as_vector(psi, size, "psi", infinite=np.inf)
    high = as_vector(np.inf if upper is None else upper, size, "upper", infinite=np.inf)

    def solved(theta: Any) -> Vector:
        problem = ICP.nonlinear(
            lambda z: np.asarray(F(z, theta)),
            lambda z: np.asarray(slope(z, theta)),
            low,
            None if upper is None else high,
        )
        return problem.solve(z0=z0, rtol=rtol, atol=atol, time_limit=time_limit).z

    def of_theta(theta: Any) -> Any:
        check_float64()
        constant = jax.lax.stop_gradient(theta)
        shape = jax.ShapeDtypeStruct((size,), np.float64)
        z = jax.pure_callback(lambda t: in_worker_thread(solved, t), shape, constant, vmap_method="sequential")
        z = jax.lax.stop_gradient(z)
        return z - _newton_step(jax, z, F(z, theta), slope(z, constant), low, high)

    return of_theta


def _newton_step(jax: Any, z: Any, p: Any, jacobian: Any, low: Vector, high: Vector) -> Any:
    """M⁻¹m: row i of m and of its Jacobian M is that of p, or of z − bound where z_i is at a bound."""
    jnp = jax.numpy
    at = jax.lax.stop_gradient(p)
    below = at > z - low
    above = at < z - high
    bound = jnp.where(below, low, high)
    M = jnp.where((below | above)[:, None], jnp.eye(low.size), jacobian)
    return jnp.linalg.solve(M, jnp.where(below | above, z - bound, p))
