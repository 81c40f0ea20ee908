"""Two obstacles for foreign solvers: what they are given has the right solution, and they find it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from known_answers import SEEDS
from test_foreign_solvers import solved

import icpmodel as icp
from icpmodel.solvers import Target
from icpmodel.solvers.formulations import targets
from icpmodel.solvers.typical_units import in_typical_units

SOLVERS = ["clarabel", "osqp", "piqp", "scs", "highs", "cvxpy-clarabel", "cvxpy-highs", "ipopt", "path", "pyomo-highs"]


def box(seed, n=8, kind="symmetric"):
    """A problem drawn afresh, and its solution: rows at either obstacle, between, pinned, with one side or none.

    `kind`: A "symmetric" or "skew", both definite; the obstacles "alike", which move the same way, or "apart".
    """
    random = np.random.default_rng(seed)
    B = random.normal(size=(n, n))
    A = B @ B.T / n + np.eye(n)
    if kind != "symmetric":
        A += np.triu(random.normal(size=(n, n)), 1) / n
    z, side = random.normal(size=n), random.integers(-1, 2, n)
    force, room, width = random.uniform(0.5, 2, (3, n))
    low, high = np.where(side == -1, z, z - room), np.where(side == 1, z, z + width)
    low[(side != -1) & (random.random(n) < 0.3)] = -np.inf
    high[(side != 1) & (random.random(n) < 0.3)] = np.inf
    p, pinned = -side * force, random.random(n) < 0.1
    low[pinned], high[pinned], p[pinned] = z[pinned], z[pinned], random.normal(size=pinned.sum())
    if kind in ("symmetric", "skew"):
        return icp.ICP(A, p - A @ z, low, upper=high), z
    G = 0.3 * random.normal(size=(n, n)) / n
    H = G if kind == "alike" else G + 0.2 * random.normal(size=(n, n)) / n
    return icp.ICP(A, p - A @ z, icp.Affine(G, low - G @ z), upper=icp.Affine(H, high - H @ z)), z


@pytest.mark.parametrize("name", SOLVERS)
@pytest.mark.parametrize("kind", ["symmetric", "skew", "alike"])
def test_a_solver_finds_the_solution_between_two_obstacles(name, kind):
    problem, z = box(0, kind=kind)
    assert solved(name, problem, 1e-8 if name == "pyomo-highs" else 1e-10) == pytest.approx(z, abs=1e-6)


@given(seed=SEEDS, kind=st.sampled_from(["symmetric", "skew", "alike"]))
def test_the_gap_is_zero_at_the_solution_and_nowhere_below_zero_on_its_constraints(seed, kind):
    """With v = (−p)⁺ at z*; at any (z, v) of the constraints it is uᵀr + vᵀs ≥ 0."""
    problem, z = box(seed, kind=kind)
    target = Target(problem)
    qp, both = target.qp("gap"), target.two_sided
    below, above = np.isfinite(target.c), np.isfinite(target.d)
    constant = problem.q @ np.where(below, target.c, np.where(above, target.d, 0.0))
    y = np.append(z, np.maximum(-problem.p(z), 0.0)[both])
    assert (qp.K @ y >= qp.lower - 1e-12).all()
    assert (qp.K @ y <= qp.upper + 1e-12).all()
    assert 0.5 * y @ qp.P @ y + qp.q @ y - constant == pytest.approx(0.0, abs=1e-11)
    random = np.random.default_rng(seed)
    x, v = random.normal(size=8), random.uniform(0, 2, both.sum())
    p, r, s = problem.p(x), problem.r(x), -problem.r_upper(x)
    u = p.copy()
    u[both] += v
    gap = u[below] @ r[below] + v @ s[both] - p[~below & above] @ s[~below & above]
    gap += p[~below & ~above] @ x[~below & ~above]  # in free rows p has to be 0
    w = np.append(x, v)
    assert 0.5 * w @ qp.P @ w + qp.q @ w - constant == pytest.approx(gap, abs=1e-10)


def test_obstacles_that_cross_at_the_answer_are_not_frozen():
    def rising(z):
        return np.asarray(z - 1.0)

    problem = icp.ICP([[1.0]], [-1.0], rising, upper=1.0)
    assert [one.frozen for one in targets(problem, np.array([1.5]))] == [True]
    assert targets(problem, np.array([2.5])) == []
    row = icp.crosscheck(problem, [2.5], ["osqp"]).rows[0]
    assert row.verdict.value == "skipped"
    assert "cannot be frozen" in row.note


def test_typical_units_pass_both_obstacles_on_and_a_box_bounds_the_unit():
    """Forces of a million on a box of one: z is not of the size q/a."""
    problem = icp.ICP(4.0 * np.eye(3), [-3e6, 2e6, 1e6], -1.0, upper=[1.0, 1.0, 2.0])
    scaled, unit = in_typical_units(problem)
    z = np.array([0.75, -0.25, 2.0])
    assert 0.5 <= unit <= 4.0
    assert (scaled.r(z / unit) * unit == problem.r(z)).all()
    assert (scaled.r_upper(z / unit) * unit == problem.r_upper(z)).all()
    below = icp.ICP(np.eye(2), [0.0, 0.0], -np.inf, upper=-4096.0)
    assert in_typical_units(below)[1] >= 4096.0


def test_a_box_bounds_what_no_certificate_does_and_branch_and_bound_finds_one_of_three_solutions():
    problem = icp.scenes.hard_three().problem
    target = Target(problem)
    assert target.bound_at_zero.componentwise is None
    z_max, p_max, r_max = target.bounds
    assert (z_max[0], p_max[0], r_max[0]) == pytest.approx((1.0, 1.25, 2.0))
    report = icp.crosscheck(problem, [1.0], ["osqp", "pyomo-highs"])
    assert report.rows[0].verdict.value == "skipped"
    assert report.rows[1].verdict.value in ("agrees", "other solution")


def test_the_bounds_hold_for_p_and_both_distances():
    for seed in range(20):
        problem, z = box(seed, kind="alike")
        target = Target(problem)
        if target.bounds is None:
            continue
        z_max, p_max, r_max = target.bounds
        assert (np.abs(z) <= z_max).all()
        assert (np.abs(problem.p(z)) <= p_max).all()
        assert (target.conditions.R @ z + target.conditions.b <= r_max).all()


@pytest.mark.parametrize(("kind", "formulation"), [("symmetric", "qp"), ("skew", "qp"), ("alike", "mip")])
def test_the_cvxpy_model_between_two_obstacles_has_the_solution(kind, formulation):
    pytest.importorskip("cvxpy")
    pytest.importorskip("highspy")
    for seed in (1, 4):
        problem, z = box(seed, 6, kind)
        model = problem.to_cvxpy(formulation)
        model.solve(solver="HIGHS" if formulation == "mip" else "CLARABEL")
        assert model.var_dict["z"].value == pytest.approx(z, abs=1e-5)
