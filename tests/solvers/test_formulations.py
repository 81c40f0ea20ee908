"""What foreign solvers are given: units without rounding, and uniqueness where it is proved."""

import numpy as np
import pytest

import icpmodel as icp
from icpmodel.solvers.formulations import Target
from icpmodel.solvers.typical_units import in_typical_units


@pytest.mark.parametrize("psi", [0.25, icp.Affine([[0.0, 0.5], [0.0, 0.0]], [1.0, -np.inf]), lambda z: 0.5 * z[::-1]])
def test_typical_units_are_another_way_to_write_the_same_problem(psi):
    problem = icp.ICP([[4e6, 1e6], [0.0, 3e6]], [-3e9, 1e9], psi)
    scaled, unit = in_typical_units(problem)
    z = np.array([700.0, -300.0])
    scale = problem.A[0, 0] / scaled.A[0, 0]
    assert np.log2(unit).is_integer()
    assert np.log2(scale).is_integer()
    assert (scaled.p(z / unit) * scale * unit == problem.p(z)).all()
    assert (scaled.r(z / unit) * unit == problem.r(z)).all()


@pytest.mark.parametrize("size", [1e-300, 1.7e308])
def test_data_at_the_edge_of_the_floats_has_units(size):
    scaled, unit = in_typical_units(icp.ICP([[1.0]], [-size]))
    assert np.isfinite(scaled.q).all()
    assert 0 < unit < np.inf


def test_uniqueness_is_proved_or_not_claimed():
    assert not Target(icp.ICP([[1.0, 2.0], [2.0, 1.0]], [-1.0, -1.0])).unique
    assert Target(icp.ICP([[1.0, 0.9, 0.9], [0.9, 1.0, 0.9], [0.9, 0.9, 1.0]], [-1.0, -1.0, -1.0])).unique
