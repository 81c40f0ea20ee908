"""Projected SOR, whose modulus sees the newest values: the factor of one sweep over v holds and is attained."""

import numpy as np
from hypothesis import given, settings
from known_answers import PAIR, SEEDS

import icpmodel as icp
from icpmodel.theory import check, check_all
from icpmodel.theory.certificates.bounds import h_plus_proof
from icpmodel.theory.certificates.h_plus import HPlusProof
from icpmodel.theory.convergence.conditions import StepMatrices
from icpmodel.theory.convergence.rowwise import SweepMap


def maps(rng, G, c):
    """ψ with |ψ(x) − ψ(y)| ≤ |G||x − y| and what a sweep can make of it: the four ways in which ψ enters one."""
    slopes = np.diag(G).copy()
    curved = icp.Function(lambda z: np.sin(G @ z) + c, lipschitz=np.abs(G))
    own = icp.Elementwise(lambda z: np.sin(slopes * z), lipschitz=np.abs(slopes), c=c)
    return [icp.Constant(c), icp.Affine(G, c), own, curved][rng.integers(4)]


def drawn(seed, omega=None):
    """(problem, ω, v > 0): A and ψ of any signs and units, D > 0, often in reach of the theorem."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 7))
    A = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.6)
    np.fill_diagonal(A, np.abs(A).sum(axis=1) * rng.uniform(0.3, 2.5) + rng.uniform(0.05, 1, n))
    G = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.5) * rng.choice([0.0, 0.1, 0.4, 1.5]) / n
    units = 10.0 ** rng.uniform(-2, 2, n) if rng.random() < 0.5 else np.ones(n)
    A, G = A * units / units[:, None], G * units / units[:, None]
    omega = float(rng.uniform(0.05, 1.95) if omega is None else omega(rng))
    problem = icp.ICP(A, rng.normal(size=n) / units, maps(rng, G, rng.normal(size=n) / units))
    return problem, omega, rng.uniform(0.1, 1, n) * rng.choice([1.0, 1 / units.max()]) / units


def bound_of(problem, omega):
    return SweepMap(StepMatrices(problem, icp.PSOR(omega=omega)))


def swept(problem, omega, z):
    return icp.PSOR(omega=omega).step_of(problem)(z)[0]


@settings(max_examples=30)
@given(SEEDS)
def test_two_sweeps_never_part_by_more_than_the_bound(seed):
    """|z − y| ≤ v gives |z⁺ − y⁺| ≤ T(v), whatever the kind of ψ and the ω."""
    problem, omega, v = drawn(seed)
    rng, w = np.random.default_rng(seed + 1), bound_of(problem, omega).upper(v)
    for share in (1.0, rng.random(v.size)):
        z = rng.normal(size=v.size) * 3 * v
        y = z + share * v * rng.choice([-1, 1], v.size)
        moved = np.abs(swept(problem, omega, z) - swept(problem, omega, y))
        size = np.abs(z) + v + np.abs(problem.q) / problem.A.diagonal() + np.abs(problem.psi.value(z))
        assert (moved <= w + 1e-12 * size.max()).all()


@settings(max_examples=15)
@given(SEEDS)
def test_for_omega_up_to_one_the_factor_is_below_one_exactly_where_the_certificate_exists(seed):
    """With a factor no larger than the one that its v gives in closed form."""
    problem, omega, _ = drawn(seed, lambda rng: rng.uniform(0.05, 1))
    found, proof = check_all(problem, icp.PSOR(omega=omega)), h_plus_proof(problem)
    proved = isinstance(proof, HPlusProof)
    assert (found["rowwise"].holds is True) == proved
    if proved:
        D, v = problem.A.diagonal(), proof.v
        shares = problem.psi.lipschitz @ v / v, 1 - omega * proof.alpha / (D * v)
        assert found["rowwise"].number <= np.max(shares) * (1 + 2e-12)


def test_a_theorem_is_about_one_of_the_two_degrees_of_implicitness():
    problem = icp.ICP(PAIR, [-1.0, -1.0])
    newest, before = check_all(problem, icp.PSOR()), check_all(problem, icp.MNMSOR())
    assert [name for name, found in newest.items() if found.holds] == ["rowwise", "monotone"]
    assert not before["rowwise"].holds
    assert not check("monotone", problem, icp.PSOR(omega=1.1)).holds
