"""Law 6, to the last bit: with one core and with all, for dense and sparse input, on a fresh and on a used object."""

import os
from contextlib import contextmanager

import numpy as np
import pytest
import scipy.sparse as sp
from known_answers import dominant
from threadpoolctl import threadpool_limits

import icpmodel as icp

METHODS = [None, "mnmgs", "mnmmod", "psor", "newton", "accelerated", "multilevel"]


@contextmanager
def one_core():
    """This process on one core, and BLAS with one thread."""
    if not hasattr(os, "sched_setaffinity"):
        pytest.skip("this system does not let a process choose its cores")
    own = os.sched_getaffinity(0)
    if len(own) < 2:
        pytest.skip("there is one core only")
    try:
        os.sched_setaffinity(0, {min(own)})
        with threadpool_limits(1):
            yield
    finally:
        os.sched_setaffinity(0, own)


def numbers(problem, method):
    found = problem.solve(method, max_iter=12, raise_on_failure=False)
    return found.z.tobytes(), found.residual, found.iterations, found.status, found.method.name


@pytest.fixture(scope="module")
def large():
    """As many entries as are worth threads, and rows that hang together so loosely that all is over at once."""
    n = 210_000
    A = sp.diags_array([-0.5, -1.0, 4.0, -1.0, -0.2], offsets=[-400, -1, 0, 1, 400], shape=(n, n)).tocsr()
    return icp.ICP(A, np.sin(np.arange(n)), np.where(np.arange(n) % 7, 0.0, -np.inf))


@pytest.mark.parametrize("method", [None, "psor", "multilevel"])
def test_one_core_gives_the_bits_of_all(large, method):
    with one_core():
        alone = numbers(icp.ICP(large.A, large.q, large.psi), method)
    assert alone == numbers(icp.ICP(large.A, large.q, large.psi), method)


def test_products_and_norms_are_the_same_on_one_core(large):
    z = 1e200 * np.cos(np.arange(large.n))
    with one_core():
        alone = large.product(z), large.matrix.magnitude(z), large.residual(z), large.residual(1e-200 * z)
    assert np.array_equal(alone[0], large.product(z))
    assert np.array_equal(alone[1], large.matrix.magnitude(z))
    assert np.allclose(alone[1], abs(large.A) @ np.abs(z), rtol=1e-15)
    assert alone[2:] == (large.residual(z), large.residual(1e-200 * z))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("n", [1, 16, 65])
def test_dense_and_sparse_input_give_the_same_bits(method, n):
    """Also where zeros are stored, and on an object that was used before."""
    rng = np.random.default_rng(n)
    A, q = dominant(rng, n), rng.normal(size=n)
    c = np.where(rng.random(n) < 0.2, -np.inf, rng.normal(size=n))
    stored = sp.csr_array((A.ravel(), np.tile(np.arange(n), n), np.arange(0, n * n + 1, n)), shape=(n, n))
    problem, full = icp.ICP(A, q, c), icp.ICP(stored, q, c)
    expected = numbers(problem, method)
    assert numbers(icp.ICP(sp.csc_array(A), q, c), method) == expected
    assert numbers(full, method) == expected
    problem.solve(raise_on_failure=False).error_bound  # noqa: B018
    assert numbers(problem, method) == expected
    assert problem.A.nnz == full.A.nnz == icp.ICP(sp.csr_array(A), q, c).A.nnz
    assert problem.residual(q) == full.residual(q)
    many = [icp.solve_many(one, [q, -q], c, raise_on_failure=False) for one in (A, stored)]
    assert np.array_equal(many[0].Z, many[1].Z)
    assert np.array_equal(many[0].residuals, many[1].residuals)
