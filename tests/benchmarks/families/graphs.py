"""Graphs without geometry and with some, and dense matrices; obstacles and loads are noise.

Graphs: A = L + diag(shift), L a weighted Laplacian and 0 < shift small, is strictly dominant by rows, if only just, and
a Z-matrix: an M-matrix. Dense: Gram matrices and kernels with a nugget are positive definite, and stay so with a
skew-symmetric part. So there is one solution for every q and fixed obstacle.
"""

import numpy as np
import scipy.sparse as sp

from .draw import loaded, scattered, some


def expander(n, rng):
    """A random regular graph: some random permutations, each row coupled with its image."""
    rows = np.arange(n)
    images = [rng.permutation(n) for _ in range(some(rng, 2, 6))]
    return _graph(n, np.tile(rows, len(images)), np.concatenate(images), rng)


def geometric(n, rng):
    """Random points in the square or the cube, coupled where they are near."""
    from scipy.spatial import cKDTree

    k, degree = int(rng.integers(2, 4)), rng.uniform(5.0, 14.0)
    ball = {2: np.pi, 3: 4.0 * np.pi / 3.0}[k]
    pairs = cKDTree(rng.random((n, k))).query_pairs((degree / (n * ball)) ** (1.0 / k), output_type="ndarray")
    return _graph(n, pairs[:, 0], pairs[:, 1], rng)


def scale_free(n, rng):
    """Preferential attachment: each new vertex takes a few neighbours, any as probable as its degree is large.

    The ends of all edges stand in one list, those of edge e at 2e and 2e + 1: the second one is any that is before it.
    Reference: Barabási and Albert, Science 286 (1999).
    """
    each = some(rng, 2, 5)
    end = (rng.random(n * each) * 2 * np.arange(n * each)).astype(np.int64)
    while (second := end % 2 == 1).any():
        end[second] = end[end[second] // 2]
    return _graph(n, np.arange(n * each) // each, end // 2 // each, rng)


def directed(n, rng):
    """Each row leans on a few others that need not lean on it: A is not symmetric."""
    each = some(rng, 2, 10)
    W = sp.csr_array((_weights(n * each, rng), (np.repeat(np.arange(n), each), rng.integers(0, n, n * each))), (n, n))
    return _shifted(W, rng)


def covariance(n, rng):
    """exp(−|x − y|/ℓ) between random places in one to three dimensions, and a nugget: a portfolio's or a map's."""
    from scipy.spatial.distance import cdist

    places = rng.random((n, int(rng.integers(1, 4))))
    A = np.exp(-cdist(places, places) / scattered(rng, 0.03, 1.0)) + scattered(rng, 1e-3, 0.3) * np.eye(n)
    c, load = rng.standard_normal((2, n))
    return loaded(A, c, load, rng)


def definite(n, rng, skew=False):
    """XXᵀ, X normal with 1.05 to 2.5 times as many columns; with `skew` a skew-symmetric part of up to that size."""
    X = rng.standard_normal((n, round(n * rng.uniform(1.05, 2.5)) + 1))
    A = X @ X.T / n
    A = (A + A.T) / 2.0
    if skew:
        K = rng.standard_normal((n, n)) * rng.uniform(0.1, 1.0) / np.sqrt(n)
        A += K - K.T
    c, load = rng.standard_normal((2, n))
    return loaded(A, c, load, rng)


def _weights(m, rng):
    """All 1, or up to two decades apart."""
    return 10.0 ** (rng.uniform(0.0, 2.0) * rng.random(m)) if rng.random() < 0.7 else np.ones(m)


def _graph(n, one, other, rng):
    """The problem on the graph with these edges; an edge to itself is none, those between the same two are one."""
    apart = one != other
    W = sp.csr_array((_weights(one.size, rng)[apart], (one[apart], other[apart])), (n, n))
    return _shifted(W + W.T, rng)


def _shifted(W, rng):
    """diag(W1 + shift) − W."""
    n = W.shape[0]
    W = sp.csr_array(W - sp.diags_array(W.diagonal()))
    degree = W.sum(axis=1)
    shift = scattered(rng, 1e-4, 0.1) * max(float(degree.mean()), 1e-3) * rng.random(n)
    c, load = rng.standard_normal((2, n))
    return loaded(sp.csr_array(sp.diags_array(degree + shift) - W), c, load, rng)
