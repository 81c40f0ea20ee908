"""The answer of p = F(z, θ) ≥ 0 ⟂ z ≥ ψ, F written in JAX, as a differentiable function of θ."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp

from ...errors import InputError, check_arguments
from ...icp import ICP
from ...numerics.arrays import Vector, as_csr, as_number, as_vector, described, row_of, with_entries
from ...numerics.factorisation import factorise
from ...problem.differences import colours
from ...solve.goal import RTOL, Limits
from .argument_forms import check_float64, the_package
from .callbacks import in_worker_thread, worker_threads

Solver: TypeAlias = Callable[[Any], Vector]


@check_arguments
def nonlinear_solution_of(
    F: Callable[[Any, Any], Any],
    n: int,
    *,
    psi: Any = 0.0,
    upper: Any = None,
    sparsity: Any = None,
    z0: Any = None,
    rtol: float = RTOL,
    atol: float = 0.0,
    time_limit: float | None = None,
) -> Callable[[Any], Any]:
    """The answer z of F(z, θ) ≥ 0 ⟂ z ≥ ψ as a function of θ, for `jax.jit`, `grad`, `jacrev`, `jacfwd` and `vmap`.

    Parameters
    ----------
    F : callable
        (z, θ) ↦ p, written in JAX, with z and p of shape (n,). θ is an array, or a tree of arrays.
    n : int
        Number of unknowns.
    psi, upper : float or array_like of shape (n,), optional
        Fixed bounds of z, by default 0 and none.
    sparsity : array_like or sparse of shape (n, n), optional
        An entry wherever F_i may depend on z_j; columns that share no row are then differentiated together.
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
        Where F is not a function, a bound or `z0` has not n numbers, `sparsity` has not the shape (n, n), a limit is
        wrong, or JAX rounds to float32.
    NotApplicable
        Where JAX is not installed.

    Notes
    -----
    The Jacobian is made by one `jax.jvp` for each group of columns that share no row. The derivative is that of the
    implicit function theorem. Let M have the rows of F′ where p is the smaller of p and r, and those of I elsewhere.
    Then Mdz = −(∂F/∂θ)dθ in the rows of F′ and 0 in the others. Where p = r = 0 it is the derivative of one side. It
    can be differentiated again.

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
    ...         print(jax.jacrev(root)(4.0).round(6), jax.hessian(root)(4.0).round(6))
    ... else:
    ...     print("[0.25] [-0.03125]")
    [0.25] [-0.03125]
    """
    jax = the_package()
    worker_threads()
    if not callable(F):
        raise InputError(f"F is {described(F)}; a function of z and theta was expected")
    size = int(as_number(n, "n", minimum=1, whole=True))
    jacobian = _Jacobian(jax, F, as_csr(np.ones((size, size)) if sparsity is None else sparsity, "sparsity", size))
    low = as_vector(psi, size, "psi", infinite=np.inf)
    high = as_vector(np.inf if upper is None else upper, size, "upper", infinite=np.inf)
    solved = _solver(jacobian, low, high, z0, Limits(rtol=rtol, atol=atol, max_iter=0, time_limit=time_limit))

    @jax.custom_jvp
    def answer(theta: Any) -> Any:
        check_float64()
        if not any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(theta)):
            with jax.ensure_compile_time_eval():  # within a trace too
                return jax.numpy.asarray(solved(theta))  # JAX does not wrap errors here
        shape = jax.ShapeDtypeStruct((size,), np.float64)
        return jax.pure_callback(lambda t: in_worker_thread(solved, t), shape, theta, vmap_method="sequential")

    @answer.defjvp
    def of_implicit_function(primals: tuple[Any], tangents: tuple[Any]) -> Any:
        z = answer(*primals)
        p, dp = jax.jvp(lambda theta: F(z, theta), primals, tangents)
        at_bound = jacobian.at_bound(z, *primals, p, low, high)
        return z, jacobian.newton_step(z, *primals, at_bound, dp)

    return answer


def _solver(jacobian: _Jacobian, low: Vector, high: Vector, z0: Any, limits: Limits) -> Solver:
    """θ ↦ z, by `solve` from `z0`. Raises InputError if `z0` is not a vector of n numbers."""
    start = None if z0 is None else as_vector(getattr(z0, "z", z0), low.size, "z0")

    def solved(theta: Any) -> Vector:
        problem = ICP.nonlinear(
            lambda z: np.asarray(jacobian.F(z, theta)),
            lambda z: jacobian.matrix(jacobian.entries(z, theta)),
            low,
            None if np.isposinf(high).all() else high,
        )
        return problem.solve(z0=start, rtol=limits.rtol, atol=limits.atol, time_limit=limits.time_limit).z

    return solved


class _Jacobian:
    """∂F/∂z on the entries of a `pattern`, to which the diagonal is added, in the order of CSR."""

    def __init__(self, jax: Any, F: Callable[[Any, Any], Any], pattern: sp.csr_array) -> None:
        self._jax = jax
        self.F = F
        # entries of 1, since a sum drops entries that are 0
        there = with_entries(pattern, np.ones(pattern.nnz))
        self._pattern = sp.csr_array(there + sp.eye_array(pattern.shape[0]))
        self._rows = row_of(self._pattern)
        self._columns = self._pattern.indices
        colour = colours(self._pattern)
        self._of_entry = colour[self._columns]
        seeds = (np.arange(colour.max() + 1)[:, None] == colour).astype(np.float64)

        def entries(z: Any, theta: Any) -> Any:
            along = jax.vmap(lambda seed: jax.jvp(lambda y: F(y, theta), (z,), (seed,))[1])(seeds)
            return along[self._of_entry, self._rows]

        #: (z, θ) ↦ the entries, by one directional derivative for each colour
        self.entries = jax.jit(entries)

    def matrix(self, entries: Any) -> sp.csr_array:
        pattern = self._pattern
        return with_entries(pattern, np.array(entries))

    def at_bound(self, z: Any, theta: Any, p: Any, low: Any, high: Any) -> Any:
        """The rows that are nearer to a bound than to p = 0, in the units of z."""
        size = self._jax.ops.segment_max(abs(self.entries(z, theta)), self._rows, z.size)
        return (p > size * (z - low)) | (p < size * (z - high)) | (low == high)

    def newton_step(self, z: Any, theta: Any, at_bound: Any, p: Any) -> Any:
        """dz with F′dz = −p and, in the rows `at_bound`, a mask of shape (n,), dz = 0."""
        where = self._jax.numpy.where
        entries = where(at_bound[self._rows], 1.0 * (self._rows == self._columns), self.entries(z, theta))
        return self._solve(entries, where(at_bound, 0.0, -p))

    def _solve(self, entries: Any, m: Any) -> Any:
        """M⁻¹m for the M of these `entries`, NaN where it is singular."""
        jax = self._jax

        def solved(transposed: bool) -> Callable[[Any, Any], Any]:
            def of(entries: Any, b: Any) -> Vector:
                factors = factorise(self.matrix(entries))
                if factors is None:
                    return np.full(b.shape, np.nan)
                return np.asarray(factors.solve(np.array(b), "T" if transposed else "N"))

            call = partial(in_worker_thread, of)
            shape = jax.ShapeDtypeStruct(m.shape, np.float64)
            return lambda _, b: jax.pure_callback(call, shape, entries, b, vmap_method="sequential")

        def product(x: Any) -> Any:
            return jax.numpy.zeros(m.shape).at[self._rows].add(entries * x[self._columns])

        return jax.lax.custom_linear_solve(product, m, solved(False), solved(True))
