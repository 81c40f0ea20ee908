"""Grids, plates, convection and options: differential operators on a box, zero or known values on its faces.

Grids, convection and options without a cross derivative: A is a Z-matrix, weakly dominant by rows and strictly beside
a face, hence an M-matrix (Berman and Plemmons, Nonnegative Matrices, 1994, chapter 6): one solution for every q and
fixed obstacle. Plates: A = L diag(d) L with d > 0 and L symmetric and regular is positive definite. Cross derivatives:
see `option`.
"""

from functools import partial, reduce

import numpy as np
import scipy.sparse as sp

from .draw import in_regions, loaded, scattered, some, waves

#: wavelengths in grid spacings: obstacles that a grid resolves, of which large grids have many
_WAVES, _PLATE_WAVES = (8.0, 300.0), (8.0, 60.0)


def grid(dimensions, coefficients, n, rng):
    """−∇·(a∇z) + bed·z ≥ −load above an obstacle, a constant, jumping by up to four decades between random regions, or
    of one size per axis, up to three decades apart; half of the draws lie on an elastic bed."""
    sides = _sides(n, dimensions, rng)
    factors, coefficient = np.ones(dimensions), _constant
    if coefficients == "jumping":
        regions, seed = 10.0 ** rng.uniform(0.0, 4.0, some(rng, 3, 30)), int(rng.integers(2**32))
        coefficient = lambda points: in_regions(points, regions, np.random.default_rng(seed))  # noqa: E731
    elif coefficients == "anisotropic":
        factors = 10.0 ** rng.uniform(0.0, 3.0, dimensions)
    A = _diffusion(sides, factors, coefficient)
    if rng.random() < 0.5:
        A = A + scattered(rng, 1e-6, 1e-2) * float(A.diagonal().mean()) * sp.eye_array(A.shape[0])
    return _on(sides, A, _WAVES, rng)


def plate(n, rng):
    """Δ(dΔz) ≥ −load above an obstacle: a simply supported plate whose stiffness d varies."""
    sides = _sides(n, 2, rng)
    L = _diffusion(sides, np.ones(2), _constant)
    stiffness = np.exp(rng.uniform(0.0, 1.0) * waves(_points(sides), scattered(rng, *_PLATE_WAVES), rng))
    return _on(sides, sp.csr_array(L @ sp.diags_array(stiffness) @ L), _PLATE_WAVES, rng)


def convection(n, rng):
    """−Δz + v·∇z ≥ −load above an obstacle, upwind differences, v of any direction, Péclet number .1 to 1000 a cell."""
    sides, angle = _sides(n, 2, rng), rng.uniform(0.0, 2.0 * np.pi)
    flow = scattered(rng, 0.1, 1e3) * np.array([np.cos(angle), np.sin(angle)])
    A = _diffusion(sides, np.ones(2), _constant)
    for k, m in enumerate(sides):
        upwind = sp.eye_array(m) - sp.eye_array(m, k=-1)
        A = A + abs(flow[k]) * _along(sides, k, upwind if flow[k] > 0 else upwind.T)
    return _on(sides, sp.csr_array(A), _WAVES, rng)


def option(factors, cross, n, rng):
    """One time step, of any length, of an American put on the mean of one or two prices, in their logarithms.

    z is the value, ψ the payoff, which is also the value of the step before and that on the faces. With `cross` the
    two prices correlate, coefficients are constant and all differences central: A is then no Z-matrix, but its
    symmetric part is positive definite, as that of the symbol is: 4(a₁s₁² + a₂s₂²) + 8a₁₂s₁s₂c₁c₂ ≥ 0 for a₁₂² ≤ a₁a₂,
    s = sin θ/2, c = cos θ/2, and first central differences are skew. Else local volatilities vary and first differences
    are upwind.
    """
    sides, rate, step = _sides(n, factors, rng), rng.uniform(0.01, 0.1), scattered(rng, 1e-3, 10.0)
    width, yields, sigma = rng.uniform(1.0, 2.5), rng.uniform(0.0, 0.08, factors), rng.uniform(0.1, 0.5, factors)
    lines = [np.linspace(-width, width, m + 2) for m in sides]
    points = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1)
    inner = np.zeros(points.shape[:-1], dtype=bool)
    inner[(slice(1, -1),) * factors] = True
    payoff, inner = np.maximum(1.0 - np.exp(points).mean(axis=-1), 0.0).ravel(), inner.reshape(-1)
    z = [sp.eye_array(m, m + 2, k=1) for m in sides]
    B = (rate + 1.0 / step) * reduce(sp.kron, z)
    n_inner = B.shape[0]
    for k, m in enumerate(sides):
        h = lines[k][1] - lines[k][0]
        left, right = sp.eye_array(m, m + 2), sp.eye_array(m, m + 2, k=2)
        local = np.ones(n_inner) if cross else 1.0 + 0.5 * rng.random() * np.sin(points.reshape(-1, factors)[inner, k])
        a = 0.5 * (sigma[k] * local) ** 2
        drift = rate - yields[k] - a
        forward, backward, central = (right - z[k]) / h, (z[k] - left) / h, (right - left) / (2.0 * h)
        second, put = (left - 2.0 * z[k] + right) / h**2, partial(_in_place, z, k)
        B = B - sp.diags_array(a) @ put(second)
        if cross:
            B = B - drift[0] * put(central)
        else:
            B = B - sp.diags_array(np.maximum(drift, 0.0)) @ put(forward)
            B = B - sp.diags_array(np.minimum(drift, 0.0)) @ put(backward)
    if cross:
        slopes = [(sp.eye_array(m, m + 2, k=2) - sp.eye_array(m, m + 2)) * (m + 1) / (4.0 * width) for m in sides]
        B = B - rng.uniform(-0.95, 0.95) * sigma.prod() * sp.kron(*slopes)
    B, V = sp.csc_array(B), payoff[inner]
    return sp.csr_array(B[:, inner]), V, B[:, ~inner] @ payoff[~inner] - V / step


def _in_place(others, k, one):
    return reduce(sp.kron, [one if i == k else other for i, other in enumerate(others)])


def _sides(n, dimensions, rng):
    """The sides of a box of about n points, up to e times as long one way as the other."""
    stretched = np.exp(rng.uniform(-0.5, 0.5, dimensions - 1)) * n ** (1.0 / dimensions)
    sides = [max(1, round(m)) for m in stretched]
    return (*sides, max(1, round(n / int(np.prod(sides)))))


def _points(sides):
    """Coordinates in grid spacings, shape (n, k)."""
    return np.indices(sides, dtype=np.float64).reshape(len(sides), -1).T


def _along(sides, k, operator):
    """The `operator` on the k-th axis of the box."""
    before, after = int(np.prod(sides[:k])), int(np.prod(sides[k + 1 :]))
    return sp.kron(sp.kron(sp.eye_array(before), operator), sp.eye_array(after), format="csr")


def _constant(points):
    return np.ones(len(points))


def _diffusion(sides, factors, coefficient):
    """ΣDᵀ diag(a) D over the axes, a the coefficient in the middle of each pair of neighbours."""
    A = sp.csr_array((int(np.prod(sides)),) * 2)
    for k, m in enumerate(sides):
        D = _along(sides, k, sp.eye_array(m + 1, m) - sp.eye_array(m + 1, m, k=-1))
        middles = _points((*sides[:k], m + 1, *sides[k + 1 :]))
        middles[:, k] -= 0.5
        A = A + factors[k] * (D.T @ sp.diags_array(coefficient(middles)) @ D)
    return sp.csr_array(A)


def _on(sides, A, lengths, rng):
    points, length = _points(sides), min(scattered(rng, *lengths), 1.5 * max(*sides, 3))
    return loaded(A, waves(points, length, rng), waves(points, length, rng), rng)
