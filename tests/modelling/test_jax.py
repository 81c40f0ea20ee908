"""The answer of a problem as a function that JAX differentiates, compiles and maps."""

import logging

import numpy as np
import pytest
import scipy.sparse as sp

import icpmodel as icp
from icpmodel import modelling

jax = pytest.importorskip("jax", reason="jax is not installed: pip install icpmodel[jax]")
jnp = pytest.importorskip("jax.numpy")
check_grads = pytest.importorskip("jax.test_util").check_grads
solution_of = pytest.importorskip("icpmodel.modelling.jax").solution_of

N = 6
A = sp.csr_array(sp.diags_array([-1.2, 4.0, -0.8], offsets=[-1, 0, 1], shape=(N, N)))
Q = np.array([-3.0, 2.0, -1.0, 5.0, -4.0, 3.0])
C = np.array([0.1, -0.2, 0.4, -0.3, -np.inf, 0.2])
D = np.array([0.5, 0.6, np.inf, 0.4, 0.7, 0.9])
G = sp.csr_array(sp.diags_array([0.2, 0.1], offsets=[-1, 2], shape=(N, N)))
JUMPS = sp.csr_array((np.array([-0.4, -0.3, -0.5, -0.2, -0.6]), ([1, 1, 3, 3, 5], [0, 2, 2, 4, 4])), shape=(N, N))
THETA = np.array([0.3, 0.2])


@pytest.fixture(autouse=True)
def doubles():
    with jax.enable_x64(True):
        yield


def sine(theta):
    """ψ(z) = θ₀ sin z + θ₁, entry by entry."""
    return icp.Elementwise(
        lambda z: theta[0] * np.sin(z) + theta[1],
        lambda z: theta[0] * np.cos(z),
        parameter_derivative=lambda z: np.stack([np.sin(z), np.ones(N)], axis=1),
    )


def mirrored(theta):
    """ψ(z) = θ₀ z reversed + θ₁."""
    return icp.Function(
        lambda z: theta[0] * z[::-1] + theta[1],
        jacobian=lambda z: theta[0] * np.eye(N)[::-1],
        parameter_derivative=lambda z: np.stack([z[::-1], np.ones(N)], axis=1),
    )


SLOPE = icp.Elementwise(lambda z: 0.3 * np.sin(z), lambda z: 0.3 * np.cos(z), lipschitz=0.3, c=C)
#: kind → problem, what solution_of gets, and the arguments in which the answer is differentiated
KINDS = {
    "constant": (icp.ICP(A, Q, C), {}, {"A": A.data, "q": Q, "psi": C}),
    "dense A and a number": (icp.ICP(A, Q, 0.1), {}, {"A": A.toarray(), "psi": 0.1}),
    "affine by c": (icp.ICP(A, Q, icp.Affine(G, C)), {}, {"q": Q, "psi": C}),
    "affine by G and c": (icp.ICP(A, Q, icp.Affine(G, C)), {}, {"A": A.data, "psi": (G.data, C)}),
    "affine by a dense G": (icp.ICP(A, Q, icp.Affine(G, C)), {}, {"psi": (G.toarray(), C)}),
    "elementwise": (icp.ICP(A, Q, SLOPE), {}, {"q": Q, "psi": C}),
    "elementwise by parameters": (icp.ICP(A, Q, 0.0), {"psi": sine}, {"q": Q, "psi": THETA}),
    "function by parameters": (icp.ICP(A, Q, 0.0), {"psi": mirrored}, {"A": A.data, "psi": THETA}),
    "intervention": (icp.ICP(A, Q, icp.Intervention(JUMPS)), {}, {"q": Q, "psi": JUMPS.data}),
    "two sides": (icp.ICP(A, Q, C, upper=D), {}, {"A": A.data, "psi": C, "upper": D}),
    "two affine sides": (
        icp.ICP(A, Q, icp.Affine(G, C), upper=icp.Affine(G, D)),
        {},
        {"q": Q, "psi": (G.data, C), "upper": (G.data, D)},
    ),
    "two sides by parameters": (
        icp.ICP(A, Q, -3.0, upper=3.0),
        {"upper": sine},
        {"q": Q, "upper": np.array([0.3, 0.2])},
    ),
}
each_kind = pytest.mark.parametrize("kind", KINDS)


def layer_of(kind):
    """The layer, and the point at which it is differentiated, without what is infinite and stays so."""
    problem, options, given = KINDS[kind]
    layer = solution_of(problem, rtol=1e-12, **options)
    infinite = jax.tree.map(np.isinf, given)

    def finite(**some):
        return layer(**jax.tree.map(lambda x, is_none, own: jnp.where(is_none, own, x), some, infinite, given))

    return finite, jax.tree.map(lambda one: np.where(np.isinf(one), 0.0, one), given)


def loss(z):
    return jnp.sum(jnp.cos(z + jnp.arange(N)) * z)


@each_kind
def test_the_gradient_of_a_loss_is_that_of_differences_forward_and_in_reverse(kind):
    layer, given = layer_of(kind)
    check_grads(lambda one: loss(layer(**one)), (given,), order=1, modes=("fwd", "rev"), rtol=1e-5, eps=1e-5)


@each_kind
def test_jacobians_are_the_same_in_both_modes_and_those_of_the_core(kind):
    layer, given = layer_of(kind)
    reverse, forward = (jac(lambda one: layer(**one))(given) for jac in (jax.jacrev, jax.jacfwd))
    for one, other in zip(jax.tree.leaves(reverse), jax.tree.leaves(forward), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-13)
