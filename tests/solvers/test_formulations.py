"""What foreign solvers are given: units without rounding, bounds that hold, and QPs."""

import numpy as np
import pytest

import icpmodel as icp
from icpmodel.solvers.formulations import Target, in_typical_units


def test_the_bounds_of_the_big_m_form_come_from_the_certificate_at_zero():
    """p ≤ |q| + |A|δ and r ≤ δ + |G|δ + |c| with |z*| ≤ δ, and they hold for the solution."""
    pyomo = pytest.importorskip("pyomo.environ")
    scene = icp.scenes.manufactured_affine(n=25)
    problem, psi, target = scene.problem, scene.problem.psi, Target(scene.problem)
    delta = target.at_zero.componentwise
    z_max, p_max, r_max = target.bounds
    assert z_max == pytest.approx(delta, rel=1e-6)
    assert p_max == pytest.approx(np.abs(problem.q) + abs(problem.A) @ delta, rel=1e-6)
    assert (r_max <= (delta + abs(psi.G) @ delta + np.abs(psi.c)) * (1 + 1e-6)).all()
    assert (problem.p(scene.z_exact) <= p_max).all()
    assert (problem.r(scene.z_exact) <= r_max).all()
    model, _ = icp.solvers.foreign_solvers()["pyomo-highs"].set_up(target, 1e-8, 1.0)
    assert [pyomo.value(one.ub) for one in model.z.values()] == z_max.tolist()


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
