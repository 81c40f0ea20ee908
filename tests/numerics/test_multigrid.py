"""Krylov steps with multigrid: to the tolerance, within the limits, and without warnings."""

import warnings
from contextlib import suppress

import numpy as np
import pytest
import scipy.sparse as sp

import icpmodel as icp
from icpmodel.errors import OutOfTime
from icpmodel.numerics import work
from icpmodel.numerics.multigrid import hierarchy_cost, linear_solve


@pytest.mark.parametrize("skew", [0.0, 0.5])
def test_it_reaches_the_tolerance(skew):
    A = icp.scenes.membrane(n=2500, skew=skew).problem.A
    for seed, tolerance in enumerate((1e-2, 1e-6, 1e-10)):
        f = np.random.default_rng(seed).normal(size=2500)
        assert np.linalg.norm(A @ linear_solve(A, f, tolerance) - f) <= 2 * tolerance * np.linalg.norm(f)


def test_its_steps_end_with_the_limit():
    A = icp.scenes.membrane(n=2500).problem.A
    steps = 3 * (work.COSTS.krylov + work.COSTS.krylov_entry * A.nnz)
    with work.work_limit(nanoseconds=hierarchy_cost(2500, A.nnz) + steps), pytest.raises(OutOfTime):
        linear_solve(A, np.ones(2500), 0.0)


def without_weight(n):
    """A Z-matrix with rows whose diagonal and weak links sum to 0, which classical interpolation divides by."""
    rng = np.random.default_rng(0)
    weak, strong = rng.permutation(n), rng.permutation(n)
    return np.eye(n) - np.eye(n)[weak] - 5.0 * np.eye(n)[strong]


@pytest.mark.parametrize(
    "A", [[[1.0, -1.0], [-1.0, 1.0]], [[1.0, 2.0], [2.0, 1.0]], [[-1.0]], without_weight(1000)], ids=range(4)
)
def test_unsuitable_matrices_warn_of_nothing_and_print_nothing(A, capfd):
    A, f = sp.csr_array(A), np.arange(1.0, 1.0 + len(A))
    with warnings.catch_warnings(), suppress(np.linalg.LinAlgError):
        warnings.simplefilter("error")
        linear_solve(A, f)
    assert capfd.readouterr() == ("", "")
