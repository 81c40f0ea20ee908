"""Factors after a diagonal block has left by a product of dense blocks."""

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from known_answers import GENERATORS

import icpmodel as icp
from icpmodel.algebra.factor_costs import factor_costs
from icpmodel.numerics.condensed import CondensedFactors


@given(GENERATORS)
def test_they_solve_what_the_whole_matrix_does(rng):
    n = int(rng.integers(2, 9))
    kept = np.append(True, rng.random(n - 1) < 0.5)
    signs = np.where(kept, 1.0, -1.0)
    root = rng.normal(size=(n, n))
    symmetric = np.where(np.outer(kept, kept), root @ root.T, signs[:, None] * (root + root.T))
    M = np.where(kept[:, None] | kept, symmetric, 0.0) + np.eye(n)
    pattern = sp.csr_array(M)
    condensed = CondensedFactors(pattern, kept)
    for scale in (1.0, 3.0):
        f = rng.normal(size=n)
        assert scale * M @ condensed.factors(scale * pattern.data).solve(f) == pytest.approx(f, abs=1e-8)


@pytest.mark.parametrize("sizes", [(30, 300), (60, 900), (100, 2500)])
def test_many_dense_inequalities_cost_little_more_than_their_product(sizes):
    """min ½xᵀPx + qᵀx with Gx ≤ h, all entries stored."""
    n, m = sizes
    rng = np.random.default_rng(0)
    root = rng.normal(size=(n, n))
    G = rng.normal(size=(m, n))
    A = np.block([[root @ root.T / n, G.T], [-G, np.zeros((m, m))]])
    problem = icp.ICP(A, np.append(rng.normal(size=n), rng.random(m)), np.repeat([-np.inf, 0.0], [n, m]))
    costs = factor_costs(problem.matrix)
    assert costs.condensed < 0.5 * min(costs.repeated, costs.dense)
    solution = problem.solve("interior")
    assert solution.solved
    assert solution.iterations < 30
