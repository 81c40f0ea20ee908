"""The answer of a problem as a function that JAX can trace, batch and differentiate.

Traced code calls back `solve`, or `solve_many` under `vmap`, and `icpmodel.Derivative` for derivatives. JAX computes
products with changes of A and G itself, so that Python returns nothing of the size of a matrix.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any, TypeAlias

import numpy as np

from ...errors import InputError, NotApplicable, check_arguments
from ...numerics.arrays import as_truth, described
from ...present.display import Displayable
from ...problem.data import ProblemData, ProblemLike, as_problem
from ...problem.map import Map
from ...solve.goal import RTOL, Limits
from .argument_forms import argument, check_float64, obstacles, the_package
from .callbacks import Arrays, Callbacks, LastDerivative, in_worker_thread, worker_threads

Make: TypeAlias = Callable[[Any], Any]


@check_arguments
def solution_of(
    problem: ProblemLike,
    *,
    psi: Make | None = None,
    upper: Make | None = None,
    rtol: float = RTOL,
    atol: float = 0.0,
    time_limit: float | None = None,
    memory_limit: float | None = None,
    raise_on_failure: bool = True,
) -> SolutionFunction:
    """The answer z of a problem as a function of its arrays, for `jax.jit`, `grad`, `jacrev`, `jacfwd`, `jvp`, `vmap`.

    Parameters
    ----------
    problem : ICP, or an object that holds, names or makes one
        The problem.
    psi, upper : callable, optional
        Only for a map with parameters of yours: a function of their values, a NumPy array of shape (m,),
        that returns the map. This must be a `Function` or an `Elementwise` with its
        `parameter_derivative`. `upper` is the upper obstacle.
    rtol, atol : float, default 1e-8, 0
        Tolerances, as for `solve`.
    time_limit, memory_limit : float, optional
        Limits, as for `solve` and `solve_many`.
    raise_on_failure : bool, default True
        Whether NotSolved is raised if there is no answer; else z and its derivatives are NaN. In compiled
        code JAX raises a `jax.errors.JaxRuntimeError` instead, which ends with the same message.

    Returns
    -------
    SolutionFunction
        The function.

    Raises
    ------
    InputError
        For wrong arguments.
    NotApplicable
        Where JAX is not installed.

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
    ...         layer = solution_of(ICP([[2, -1], [-1, 2]], [-1, 3]))
    ...         print(jax.jacrev(lambda q: layer(q=q))(np.array([-1.0, 3.0])) + 0.0)
    ... else:
    ...     print("[[-0.5  0. ]\\n [ 0.   0. ]]")
    [[-0.5  0. ]
     [ 0.   0. ]]
    """
    the_package()
    worker_threads()
    limits = Limits(rtol=rtol, atol=atol, max_iter=0, time_limit=time_limit, memory_limit=memory_limit)
    for name, make in (("psi", psi), ("upper", upper)):
        if make is not None and (not callable(make) or isinstance(make, Map)):
            raise InputError(f"{name} is {described(make)}; a function of parameters that returns a map was expected")
    options = {name: getattr(limits, name) for name in ("rtol", "atol", "time_limit", "memory_limit")}
    raise_on_failure = as_truth(raise_on_failure, "raise_on_failure")
    return SolutionFunction(as_problem(problem), {"psi": psi, "upper": upper}, options, raise_on_failure)


@check_arguments
class SolutionFunction(Displayable):
    """The answer of a problem as a function of its arrays; `solution_of` makes it.

    Parameters
    ----------
    problem : ProblemData
        The problem.
    makers : dict
        Obstacle → the function that makes it from its parameters, or None.
    options : dict
        Options of `solve`.
    raise_on_failure : bool
        Whether a failed solve raises NotSolved.

    Notes
    -----
    The factors of the last derivative are kept until the next one. A derivative is taken at the z that
    was returned, without solving again.

    Examples
    --------
    >>> from importlib.util import find_spec
    >>> problem = ICP([[2.0]], [1.0])
    >>> print(solution_of(problem) if find_spec("jax") else f"SolutionFunction({problem})")
    SolutionFunction(ICP(n=1, nnz=1, psi=Constant(0)))
    """

    def __init__(
        self, problem: ProblemData, makers: dict[str, Make | None], options: dict[str, Any], raise_on_failure: bool
    ) -> None:
        self.problem, self.makers, self.options, self.raise_on_failure = problem, makers, options, raise_on_failure
        self._last = LastDerivative()
        weakref.finalize(self, self._last.forget)  # compiled code may live longer
        self._traced: dict[Any, TracedFunction] = {}

    @check_arguments
    def __call__(self, *, A: Any = None, q: Any = None, psi: Any = None, upper: Any = None, z0: Any = None) -> Any:
        """The answer z, float64 of shape (n,), with these arrays in place of the problem's own.

        Parameters
        ----------
        A : array_like of shape (nnz,) or (n, n), optional
            The data of `problem.A`, or a dense matrix.
        q : array_like of shape (n,), optional
            The vector q.
        psi, upper : array_like or tuple, optional
            The c of a `Constant`, `Affine` or `Elementwise`, a number or of shape (n,). For an `Affine` also a tuple
            (G, c), with G in a form of A on the pattern of its own G. The gains of an `Intervention`, shape (nnz,). The
            parameters of a function that was given to `solution_of`, shape (m,).
        z0 : array_like of shape (n,), optional
            The start, on which the derivative does not depend.

        Raises
        ------
        InputError
            For wrong arrays, or if JAX rounds to float32.

        Examples
        --------
        >>> from importlib.util import find_spec
        >>> if find_spec("jax"):
        ...     import jax
        ...
        ...     with jax.enable_x64(True):
        ...         layer = solution_of(ICP([[2.0]], [0.0]))
        ...         print(jax.vmap(lambda q: layer(q=q))(np.array([[-2.0], [4.0]])))
        ... else:
        ...     print("[[1.]\\n [0.]]")
        [[1.]
         [0.]]
        """
        check_float64()
        arguments = {"A": A, "q": q, "psi": psi, "upper": upper, "z0": z0}
        arguments = {name: value for name, value in arguments.items() if value is not None}
        forms = {name: argument(name, value, self.problem, self.makers.get(name)) for name, value in arguments.items()}
        arrays = {name: form.read(arguments[name]) for name, form in forms.items()}
        shapes = {name: tuple(one.shape for one in several) for name, several in arrays.items()}
        key = tuple(shapes.items())
        if key not in self._traced:
            calls = Callbacks(self.problem, forms, shapes, self.options, self.raise_on_failure, self._last)
            self._traced[key] = TracedFunction(calls)
        return self._traced[key].function(arrays)

    def __reduce__(self) -> tuple[Any, ...]:
        # traced functions and the lock belong to one process
        return SolutionFunction, (self.problem, self.makers, self.options, self.raise_on_failure)

    def __repr__(self) -> str:
        return f"SolutionFunction({self.problem!r})"


class TracedFunction:
    """A `SolutionFunction` for arguments of fixed forms, as JAX traces it."""

    def __init__(self, calls: Callbacks) -> None:
        jax = the_package()
        self.calls, self.n = calls, calls.problem.n
        self.of_vector = jax.ShapeDtypeStruct((self.n,), np.float64)
        # made once, as JAX compiles again for another object
        three = calls.solved, calls.forward, calls.adjoint
        self.solved, self.forward, self.adjoint = (partial(in_worker_thread, call) for call in three)
        self.function = jax.custom_jvp(self.value)
        self.function.defjvp(self.tangent)

    def value(self, arrays: Arrays) -> Any:
        """z for these arrays."""
        jax = the_package()
        if any(isinstance(one, jax.core.Tracer) for several in arrays.values() for one in several):
            return jax.pure_callback(self.solved, self.of_vector, arrays, vmap_method="expand_dims")
        with jax.ensure_compile_time_eval():  # within a trace too
            return jax.numpy.asarray(self.calls.solved(arrays))  # JAX does not wrap errors here

    def tangent(self, primals: Any, tangents: Any) -> Any:
        """The rule of forward mode; JAX derives reverse mode from it."""
        jax = the_package()
        (arrays,) = primals
        (moved,) = tangents
        for name, psi in obstacles(self.calls.problem).items():
            form = self.calls.forms.get(name)
            if psi is None or (form and form.in_data):
                continue
            if missing := psi.no_derivative():  # else compiled code would raise it
                raise NotApplicable(missing if name == "psi" else missing.replace("psi", name, 1))
        z = self.function(arrays)
        changes: dict[str, Any] = {}
        for name, several in moved.items():
            if name != "z0":
                key = "q" if name == "A" else name
                change = self.calls.forms[name].change(z, *several)
                changes[key] = changes[key] + change if key in changes else change
        return z, self.linear(arrays | {"z": (z,)}, changes, z) if changes else jax.numpy.zeros_like(z)

    def linear(self, residuals: Arrays, changes: dict[str, Any], z: Any) -> Any:
        """dz for these changes, by a map that JAX can transpose and batch.

        `jax.custom_derivatives.linear_call` is made for this, but cannot be batched. `custom_linear_solve` can be. It
        applies a map L by solving (x − Ld, d) = b for (x, d): with b = (0, d) the solution is (Ld, d).
        """
        jax = the_package()
        n = self.n
        once = _guard()(z)
        jnp = jax.numpy
        options = {"vmap_method": "expand_dims"}
        all_of_them = jax.ShapeDtypeStruct((sum(self.calls.sizes.values()),), np.float64)

        def ahead(_: Any, b: Any) -> Any:
            moved = jax.pure_callback(self.forward, self.of_vector, residuals, b[n:], **options)
            return jnp.concatenate([b[:n] + moved, b[n:]])

        def back(_: Any, c: Any) -> Any:
            change = jax.pure_callback(self.adjoint, all_of_them, residuals, c[:n], **options)
            return jnp.concatenate([c[:n], c[n:] + change])

        b = jnp.concatenate([jnp.zeros_like(z), *(changes[name] for name in self.calls.sizes)])
        return jax.lax.custom_linear_solve(lambda x: once * x, b, ahead, back)[:n]


@lru_cache(maxsize=1)
def _guard() -> Any:
    """z ↦ 1, whose derivative raises NotApplicable."""
    jax = the_package()

    @jax.custom_jvp
    def one(z: Any) -> Any:
        return jax.numpy.ones(())

    @one.defjvp
    def of_second_order(primals: Any, tangents: Any) -> Any:
        raise NotApplicable("the derivative of an answer cannot be differentiated again")

    return one
