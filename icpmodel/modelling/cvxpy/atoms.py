"""ψ with CVXPY's nonlinear atoms: their values and gradients, with the parameters frozen."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cvxpy as cp
import numpy as np
import scipy.sparse as sp
from cvxpy.atoms.affine.broadcast_to import broadcast_to
from cvxpy.atoms.elementwise.elementwise import Elementwise

from ...numerics.arrays import Vector
from .complementarity import named, unstacked

#: how far a difference quotient may lie from the gradient
_SAME = 1e-4


class AtomObstacle:
    """ψ(z) = Gz + c + Vw(z), w being the `atoms` stacked, at the present values of their parameters.

    Parameters: `atoms` CVXPY expressions in `variables`, which z stacks column by column; `G` CSR (n, n), `c` (n,),
    `V` CSR (n, sizes of the atoms together). It works on copies, so that neither new values of the variables nor of
    the parameters change it.
    """

    __name__ = "psi of CVXPY"

    def __init__(
        self,
        atoms: Sequence[cp.Expression],
        variables: Sequence[cp.Variable],
        G: sp.csr_array,
        c: Vector,
        V: sp.csr_array,
    ) -> None:
        self.G, self.c, self.V = G, c, V
        self._variables = [cp.Variable(x.shape, name=x.name()) for x in variables]
        copies: dict[int, Any] = {id(x): copy for x, copy in zip(variables, self._variables, strict=True)}
        for parameter in {parameter for atom in atoms for parameter in atom.parameters()}:
            copies[id(parameter)] = cp.Constant(parameter.value)
        self._atoms = [_copied(atom, copies) for atom in atoms]

    def __call__(self, z: Vector) -> Vector:
        """ψ(z), shape (n,). Raises ArithmeticError where an expression has no finite value at `z`."""
        return self.G @ z + self.c + self.V @ self._w(z)

    def _write(self, z: Vector) -> None:
        for x, value in zip(self._variables, unstacked(z, self._variables), strict=True):
            x.save_value(value)

    def _w(self, z: Vector) -> Vector:
        self._write(z)
        values = []
        for atom in self._atoms:
            with np.errstate(all="ignore"):
                value = np.asarray(atom.value, dtype=np.float64)
            if not np.isfinite(value).all():
                wrong = value.ravel()[np.argmin(np.isfinite(value.ravel()))]
                raise ArithmeticError(
                    f"{named(atom)} is {wrong} here; start where it is finite, from the variables' values"
                )
            values.append(value.ravel(order="F"))
        return np.concatenate(values)

    def jacobian(self, z: Vector) -> sp.csr_array:
        """ψ′(z) = G + Vw′(z), CSR, shape (n, n). Raises ArithmeticError where an expression has no gradient at `z`."""
        return sp.csr_array(self.G + self.V @ self._derivative(z))

    def _derivative(self, z: Vector) -> sp.csr_array:
        self._write(z)
        with np.errstate(all="ignore"):
            return sp.csr_array(sp.block_array([self._blocks(atom) for atom in self._atoms]))

    def _blocks(self, atom: cp.Expression) -> list[sp.csr_array]:
        """∂atom/∂x for each variable x."""
        gradients = atom.grad
        blocks = []
        for x in self._variables:
            gradient = gradients.get(x, 0.0)
            if gradient is None:
                raise ArithmeticError(f"{named(atom)} has no gradient here")
            if sp.issparse(gradient) or np.size(gradient) > 1:
                blocks.append(sp.csr_array(gradient).reshape(x.size, atom.size).T.tocsr())
            elif gradient == 0.0:
                blocks.append(sp.csr_array((atom.size, x.size)))
            else:
                blocks.append(sp.csr_array(np.full((atom.size, x.size), float(np.asarray(gradient).item()))))
        return blocks

    def gradient_holds(self, z: Vector) -> bool:
        """Whether CVXPY gives a gradient that no difference quotient near `z` contradicts.

        CVXPY 1.9 has none of norm_inf, and a wrong one of a quotient of variables. A point at which nothing can be
        evaluated contradicts nothing.
        """
        random = np.random.default_rng(0)
        size = float(np.abs(z).max(initial=0.0)) or 1.0
        step = 1e-6 * size * random.choice([-1.0, 1.0], z.size) * random.uniform(0.5, 1.0, z.size)
        for near in (random.uniform(-0.01, 0.01, z.size), random.uniform(0.0, 0.01, z.size)):
            at = z + size * near
            try:
                quotient = self._w(at + step) - self._w(at - step)
                expected = 2.0 * (self._derivative(at) @ step)
            except ArithmeticError:
                continue
            except Exception:  # whatever an expression without a gradient raises
                return False
            noise = 1e-12 * np.abs(self._w(at)).max()
            allowed = _SAME * max(np.abs(quotient).max(), np.abs(expected).max()) + noise
            return bool((np.abs(quotient - expected) <= allowed).all())
        return True


def _copied(expression: Any, copies: dict[int, Any]) -> Any:
    """`expression` with some of its leaves replaced, also a parameter that is no argument (power, huber).

    What is stretched to the shape of the others is stretched beforehand: CVXPY 1.9 forgets it in gradients.
    """
    if id(expression) in copies or not expression.args:
        return copies.get(id(expression), expression)
    arguments = [_copied(argument, copies) for argument in expression.args]
    if isinstance(expression, Elementwise):
        arguments = [x if x.shape == expression.shape else broadcast_to(x, expression.shape) for x in arguments]
    data = expression.get_data() or []
    if not any(isinstance(x, cp.Expression) for x in data):
        return expression.copy(arguments)
    return type(expression)(*arguments, *(cp.Constant(x.value) if isinstance(x, cp.Expression) else x for x in data))
