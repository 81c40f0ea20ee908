"""The modulus-based matrix splitting method of Hong and Li (2016), a baseline with inner and outer iterations."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..arrays import Vector, as_vector
from ..errors import InputError
from ..problem import ICP
from . import Method, positive_diagonal
from .modulus import as_splitting, check_diagonal


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MMS(Method):
    """z − ψ(z) = (|x| + x)/γ and Az + q = Ω(|x| − x)/γ, iterated in x with ψ held at the outer iterate.

    The inner step (Ω + M₁)x⁺ = N₁x + (Ω − A)|x| − γ(Aψ + q) is, with z = ψ + (|x| + x)/γ,

        x⁺ = x − γ X⁻¹ (Az + q − Ω(|x| − x)/γ),        X = M₁ + Ω:

    the operator of the family once more, on another residual. After `inner` steps ψ is evaluated anew; where ψ is
    constant, inner and outer steps are the same.
    Parameters: `splitting` as in `Modulus`; `gamma` > 0; `omega` the diagonal of Ω, a positive number or vector of
    shape (n,), or None for D/2; `inner` ≥ 1.
    Reference: Hong and Li, Numer. Linear Algebra Appl. 23 (2016); Bai (2010) for ψ = 0.

    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(MMS()).z.round(6)
    array([1., 1.])
    """

    name: ClassVar[str] = "mms"
    splitting: Any = "gauss-seidel"
    gamma: float = 2.0
    omega: Any = None
    inner: int = 10

    def __post_init__(self) -> None:
        object.__setattr__(self, "splitting", as_splitting(self.splitting))
        check_diagonal(self, "gamma")
        if self.omega is not None:
            check_diagonal(self, "omega")
        if not isinstance(self.inner, int) or self.inner < 1:
            raise InputError(f"inner is {self.inner!r}; a whole number >= 1 was expected")

    def why_not(self, problem: ICP) -> str | None:
        """See `Method.why_not`: Ω must be positive, and x has no value where ψ_i = −∞."""
        if np.isneginf(problem.psi.value(np.zeros(problem.n))).any():
            return "MMS writes z - psi(z) = (|x| + x)/gamma, but a row has no obstacle (psi = -inf)"
        return positive_diagonal(problem, "Omega = D/2 must be positive") if self.omega is None else None

    def iterates(self, problem: ICP, z: Vector) -> Iterator[tuple[Vector, float | None]]:
        """See `Method.iterates`."""
        A, q, gamma = problem.A, problem.q, self.gamma
        omega = A.diagonal() / 2 if self.omega is None else as_vector(self.omega, problem.n, "omega")
        operator = self.splitting.operator(A, omega)
        psi = problem.psi.value(z)
        # of the x that belong to z, the one without a guess at p
        x = 0.5 * gamma * (z - psi)
        yield z, None
        while True:
            for _ in range(self.inner):
                p = A @ (psi + (np.abs(x) + x) / gamma) + q
                x = x - gamma * operator.solve(p - omega * (np.abs(x) - x) / gamma)
                z = psi + (np.abs(x) + x) / gamma
                yield z, None
            psi = problem.psi.value(z)
