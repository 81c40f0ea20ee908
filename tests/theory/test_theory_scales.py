"""Every proof at every scale: what it says is held against rational arithmetic, with data of 1e±150, 1e±200, 1e±320."""

from fractions import Fraction

import numpy as np
import pytest
from exact import exceeds, nearest_floats, solutions

import icpmodel as icp
from icpmodel.theory.certificates import definite, enumerated, h_plus

#: powers of ten; the last but one is below the normal floats
SCALES = (0, 0, 0, -150, 150, -200, 200, -320, 300)
PROOFS = {
    "h_plus": lambda problem: h_plus.prove(problem.matrix, problem.psi),
    "definite": lambda problem: definite.prove(problem.matrix, problem.psi),
    "enumerated": enumerated.prove,
}


def units(rng, n):
    """One unit for all, or for each its own."""
    powers = rng.choice(SCALES, n) if rng.random() < 0.3 else np.full(n, rng.choice(SCALES))
    return np.array([10.0**k if k > -308 else 10.0 ** (k + 100) * 1e-100 for k in powers.tolist()])


def drawn(rng):
    """An ICP with up to four unknowns, of which A, q, ψ and z have sizes of their own; None where one is not finite."""
    n = int(rng.integers(1, 5))
    N = rng.normal(size=(n, n))
    little = 10.0 ** rng.uniform(-6, 0) * np.eye(n)
    A = [
        N + np.diag(np.abs(N).sum(axis=1) * rng.uniform(0.9, 3)),
        N @ N.T + little,
        N @ N.T + little + N - N.T,
        np.ones((n, n)) + little,
    ][rng.integers(4)]
    with np.errstate(all="ignore"):
        d = units(rng, n)
        A = A * d[:, None] * (d if rng.random() < 0.5 else units(rng, n))
        q, c = (rng.normal(size=n) * units(rng, n) * (rng.random(n) < 0.7) for _ in range(2))
        if rng.random() < 0.3:
            c[rng.integers(n)] = -np.inf
        slopes = [rng.normal(size=(n, n)) * 0.3 / n, np.diag(1 - 10.0 ** rng.uniform(-14, -1, n)), np.zeros((n, n))]
        steep = -np.diag(np.abs(rng.normal(size=n)) * units(rng, n))
        G = [*slopes, steep][rng.integers(4)]
    if not all(np.isfinite(X).all() for X in (A, q, G)):
        return None
    return icp.ICP(A, q, icp.Affine(G, c))


def points(rng, problem, exact):
    """z near z*, and at every distance from it."""
    n = problem.n
    near = nearest_floats(exact) if all(abs(x) < Fraction(10) ** 308 for x in exact) else np.zeros(n)
    with np.errstate(all="ignore"):
        found = [near, np.zeros(n), *(near * (1 + 10.0**-k * rng.normal(size=n)) for k in (16, 12, 8, 4))]
        found += [near + rng.choice([-1, 0, 1], n) * units(rng, n) for _ in range(3)]
    return [z for z in found if np.isfinite(z).all()]


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_no_bound_is_below_the_error_at_any_scale(seed):
    rng, trials, bad = np.random.default_rng(seed), dict.fromkeys(PROOFS, 0), []
    for problem in filter(None, (drawn(rng) for _ in range(40 if seed == 0 else 300))):
        found = solutions(problem)
        for name, prove in PROOFS.items():
            proof = prove(problem)
            if isinstance(proof, str):
                continue
            assert len(found) == 1, (name, problem.A.toarray(), problem.psi)
            for z in points(rng, problem, found[0]):
                bound = icp.error_bound(problem, z, rigorous=True, sharp=[None, False, True][rng.integers(3)])
                for delta in (proof.bound(problem, z, *problem.rounding(z))[0], bound.componentwise):
                    if delta is not None and np.isfinite(delta).all():
                        trials[name] += 1
                        if exceeds(z, found[0], delta):
                            bad.append((name, problem.A.toarray(), problem.q, problem.psi, z))
    assert min(trials.values()) > 30
    assert bad == []


@pytest.mark.parametrize("size", [1.0, 1e-150, 1e-300])
def test_a_small_error_beside_a_far_obstacle_does_not_underflow_when_it_is_squared(size):
    n = 13
    problem = icp.ICP(np.ones((n, n)) + 1e-3 * np.eye(n), np.zeros(n), -np.ones(n))
    z = np.zeros(n)
    z[:2] = size, -size
    for sharp in (None, False):
        bound = icp.error_bound(problem, z, sharp=sharp)
        assert "positive definite" in bound.proof
        assert size <= bound.value <= 40 * size
