"""The modulus-based matrix splitting method of Hong and Li (2016), a baseline with inner and outer iterations."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Any, ClassVar

import numpy as np

from ..algebra.relaxation import check_diagonal
from ..algebra.splittings import as_splitting
from ..errors import MapError
from ..numerics.arrays import Vector, as_number, as_vector
from ..problem.data import ProblemData
from .contract import Iterate, Method, why_not_diagonal, with_options


@with_options
class MMS(Method):
    """The modulus-based matrix splitting method of Hong and Li, with inner and outer steps.

    It iterates in x, where z − ψ(z) = (|x| + x)/γ and Az + q = Ω(|x| − x)/γ. The obstacle ψ is held
    at the outer iterate. The inner step is

        (Ω + M₁)x⁺ = N₁x + (Ω − A)|x| − γ(Aψ + q).

    With z = ψ + (|x| + x)/γ this is the same as

        x⁺ = x − γ X⁻¹ (Az + q − Ω(|x| − x)/γ),        X = M₁ + Ω.

    This is the operator of the modulus family on another residual. γ only rescales x and does not
    change z: here γ = 2. After `inner` steps ψ is evaluated anew. Where ψ is constant, inner and outer
    steps are the same.

    Parameters
    ----------
    splitting : str, AOR or matrix, default "gauss-seidel"
        M₁, as in `Modulus`.
    omega : float or array of shape (n,), optional
        The diagonal of Ω, positive; D/2 by default.
    inner : int, default 10
        Number of inner steps, at least 1.

    References
    ----------
    Hong and Li, Numer. Linear Algebra Appl. 23 (2016). Bai (2010) for ψ = 0.

    Examples
    --------
    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(MMS()).z.round(6)
    array([1., 1.])
    """

    name: ClassVar[str] = "mms"
    to_try: ClassVar[str] = "another omega, another splitting"
    splitting: Any = "gauss-seidel"
    omega: Any = None
    inner: int = 10

    def __post_init__(self) -> None:
        object.__setattr__(self, "splitting", as_splitting(self.splitting))
        if self.omega is not None:
            check_diagonal(self, "omega")
        as_number(self.inner, "inner", minimum=1, whole=True)

    def why_not(self, problem: ProblemData) -> str | None:
        # x has no value where ψ_i = −∞; a ψ without a value at 0 is evaluated at the start of the run
        if problem.upper is not None:
            return "MMS has one |x| for each row, and a row may have two obstacles: the members of Method 3.1 take them"
        has_free_rows = problem.psi.has_policies
        with suppress(MapError):
            has_free_rows = has_free_rows or bool(np.isneginf(problem.psi.value(np.zeros(problem.n))).any())
        if has_free_rows:
            return "MMS writes z - psi(z) = (|x| + x)/gamma, but a row may have no obstacle (psi = -inf)"
        return why_not_diagonal(problem, "Omega = D/2 must be positive") if self.omega is None else None

    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[Iterate]:
        A = problem.A
        q = problem.q
        omega = A.diagonal() / 2 if self.omega is None else as_vector(self.omega, problem.n, "omega")
        operator = self.splitting.operator(A, omega)
        psi = problem.psi.value(z)
        x = z - psi  # of all x that give this z where z >= psi, the one without a guess at p
        yield z, None
        while True:
            for _ in range(self.inner):
                p = A @ (psi + np.maximum(x, 0.0)) + q
                x = x - 2.0 * operator.solve(p - omega * np.maximum(-x, 0.0))
                z = psi + np.maximum(x, 0.0)
                yield z, None
            psi = problem.psi.value(z)
