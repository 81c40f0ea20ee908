"""Problems that are made for an answer known beforehand."""

import numpy as np
import scipy.sparse as sp
from hypothesis import strategies as st

import icpmodel as icp

#: seeds of random problems, and generators
SEEDS = st.integers(0, 2**32 - 1)
GENERATORS = st.builds(np.random.default_rng, SEEDS)
#: the smallest symmetric M-matrix whose rows depend on each other
PAIR = np.array([[2.0, -1.0], [-1.0, 2.0]])


def chain(n, diagonal=2.0):
    """The tridiagonal matrix with −1 beside this diagonal."""
    return sp.diags_array([-1.0, diagonal, -1.0], offsets=[-1, 0, 1], shape=(n, n), format="csr")


def dominant(rng, n, share=0.5):
    """A strictly diagonally dominant matrix with about this share of its entries."""
    A = rng.normal(size=(n, n)) * (rng.random((n, n)) < share)
    np.fill_diagonal(A, 0.0)
    return A + np.diag(1.1 * np.abs(A).sum(axis=1) + 0.2)


def definite(rng, n, shift=1.0):
    """A symmetric positive definite matrix, whose eigenvalues are at least `shift`."""
    B = rng.normal(size=(n, n))
    return B @ B.T / n + shift * np.eye(n)


def affine(G):
    """c ↦ ψ(z) = Gz + c, a constant where G is 0."""
    return (lambda c: icp.Affine(G, c)) if np.any(G) else icp.Constant


def attempt(problem, *arguments, **options):
    """The solution of a run, whatever its status."""
    return problem.solve(*arguments, raise_on_failure=False, **options)


def sine(slope, c=0.0):
    """ψ(z) = slope·sin z + c."""
    return icp.Elementwise(lambda z: slope * np.sin(z), lambda z: slope * np.cos(z), slope, c)


def around(rng, A, exact, psi=icp.Constant, of_p=1.0, of_r=1.0, free=0.0, above=0.0):
    """The ICP of A with the solution `exact`, psi(c) the map that is as much above psi(0) as c.

    Rows touch by chance; a share `free` of the others has no obstacle. The share `above` of all rows has one above as
    well, psi(d), and touches that in place of the lower one.
    """
    n = len(exact)
    active, held = rng.random(n) < 0.5, rng.random(n) < above
    p = np.where(active, rng.random(n), 0.0) * of_p
    bare, gap = exact - psi(np.zeros(n)).bind(n).value(exact), rng.random(n) * of_r
    c = bare - np.where(active & ~held, 0.0, gap)
    c[~active & (rng.random(n) < free)] = -np.inf
    upper = psi(np.where(held, bare + np.where(active, 0.0, gap), np.inf)) if held.any() else None
    return icp.ICP(A, np.where(held, -p, p) - A @ exact, psi(c), upper=upper)
