"""Projected SOR as the member of the modulus family whose modulus sees the newest values."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from known_answers import GENERATORS

import icpmodel as icp


@settings(max_examples=50)
@given(GENERATORS, st.floats(0.1, 1.9))
def test_a_sweep_solves_the_modulus_equation_of_every_row_with_the_newest_values(rng, omega):
    """Row i of (M₁ + Ω)z⁺ = N₁z + |(M₁ − Ω)z⁺ − N₁z + q + Ωψ(z)| − q + Ωψ(z), M₁ = D/ω − L, for any Ω."""
    n = int(rng.integers(1, 6))
    A = rng.normal(size=(n, n)) + np.diag(rng.uniform(0.5, 5, n) + 2)
    np.fill_diagonal(A, np.abs(A.diagonal()) + 0.1)
    G, c, q, z = rng.normal(size=(n, n)), rng.normal(size=n), rng.normal(size=n), rng.normal(size=n)
    problem, Omega, method = icp.ICP(A, q, icp.Affine(G, c)), rng.uniform(0.1, 5, n), icp.PSOR(omega=omega)
    new = method.step_of(problem)(z)[0]
    M1 = method.splitting_of().matrix(problem.A).toarray()
    N1, psi = M1 - A, G @ z + c  # ψ sees the z that the sweep began with
    inside = M1 @ new - Omega * new - N1 @ z + q + Omega * psi
    right = N1 @ z + np.abs(inside) - q + Omega * psi
    assert M1 @ new + Omega * new == pytest.approx(right, rel=1e-9, abs=1e-9 * (1 + np.abs(new).max()) * 10 / omega)
