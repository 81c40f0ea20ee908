"""Two obstacles: what theory says of them holds against all 3ⁿ pieces in fractions, and along real runs."""

import itertools
from fractions import Fraction

import numpy as np
import scipy.sparse as sp
from exact import exceeds, nearest_floats, pieces
from hypothesis import given, settings
from hypothesis import strategies as st
from known_answers import GENERATORS, PAIR

import icpmodel as icp
from icpmodel.theory import active_set, check, error_bound
from icpmodel.theory.certificates.bounds import possible_crossing, proofs_with_rounding
from icpmodel.theory.certificates.contradiction import multipliers
from icpmodel.theory.certificates.infeasible import infeasible


def obstacles(rng, kind, n, size=1.0):
    """(ψ, ψ̄) of one kind: constant, moving alike, or each in its own way, so that they cross somewhere; some rows
    without one or the other, in some the two are equal."""
    c = rng.normal(size=n)
    d = c + np.abs(rng.normal(size=n)) * (rng.random(n) < 0.8)
    c, d = np.where(rng.random(n) < 0.15, -np.inf, c), np.where(rng.random(n) < 0.15, np.inf, d)
    if kind == "constant":
        return icp.Constant(c), icp.Constant(d)
    G = rng.normal(size=(n, n)) * size / n
    return icp.Affine(G, c), icp.Affine(G if kind == "alike" else rng.normal(size=(n, n)) * size / n, d)


def drawn(rng, kind):
    """A problem with two obstacles of that `kind`, mostly with a proof: A dominant or definite."""
    n = int(rng.integers(1, 5))
    B = rng.normal(size=(n, n))
    rows = np.abs(B).sum(axis=1) * rng.uniform(0.7, 2)
    A = B - np.diag(B.diagonal() - rows) if rng.random() < 0.6 else B @ B.T + 0.3 * np.eye(n)
    psi, upper = obstacles(rng, kind, n, rng.choice([0.1, 0.4, 1.0]))
    return icp.ICP(A, rng.normal(size=n) * 3, psi, upper=upper)


@settings(max_examples=20)
@given(GENERATORS, st.sampled_from(["constant", "alike", "own"]))
def test_no_bound_is_below_the_true_error_and_what_is_unique_is(rng, kind):
    """Every proof and the bound that is told, from points near and far: |z − z*| ≤ δ, z* the one solution."""
    problem = drawn(rng, kind)
    exact = pieces(problem)
    start = nearest_floats((exact.solutions + exact.others + [np.zeros(problem.n)])[0])
    for distance in (0.0, 1e-12, 0.1, 30.0):
        z = start + distance * rng.normal(size=problem.n)
        told = error_bound(problem, z)
        assert not told.unique or len(exact.solutions) == 1
        assert told.value is None or not exceeds(z, exact.solutions[0], told.componentwise)
        for proof in proofs_with_rounding(problem):
            if not isinstance(proof, str):
                assert len(exact.solutions) + len(exact.others) == 1
                delta, _ = proof.bound(problem, z, *problem.rounding(z))
                if possible_crossing(problem, z, delta) is None:
                    assert not exceeds(z, exact.solutions[0], delta)


def test_rows_of_fixed_unknowns_take_no_bound_away():
    """Nor do their columns where they are fixed at 0. What is left is an H+-matrix, or definite."""
    rng = np.random.default_rng(0)
    B = rng.normal(size=(40, 40))
    for A, at in ((B + 80.0 * np.eye(40), [1.0, 2.0, -0.5]), (B @ B.T / 40 + 0.1 * np.eye(40) + B - B.T, [0.0] * 3)):
        A[:3] = rng.normal(size=(3, 40))
        A[0] = 0.0
        low, high = np.zeros(40), np.full(40, np.inf)
        low[:3] = high[:3] = at
        problem = icp.ICP(A, rng.normal(size=40), low, upper=high)
        free = icp.ICP(A[3:, 3:], problem.q[3:] + A[3:, :3] @ at)
        z = np.append(at, free.solve().z)
        assert error_bound(problem, z).value < 1e-6
        assert error_bound(problem, z + 1e-3).value >= 1e-3


def test_obstacles_that_may_cross_leave_no_bound():
    problem = icp.ICP([[2.0]], [-9.0], icp.Affine([[0.5]], [0.0]), upper=icp.Affine([[-0.5]], [-3.0]))
    bound = error_bound(problem, [-2.0])
    assert not bound.unique
    assert "psi <= upper is not proved" in bound.reason
    assert problem.solve(raise_on_failure=False).status is icp.Status.CROSSED
    jumps = icp.Intervention(sp.csr_array([[0.0, -1.0], [-1.0, 0.0]]))
    control = icp.ICP(PAIR, [1.0, 1.0], jumps)
    assert error_bound(control, np.zeros(2)).unique
    assert not error_bound(control.with_upper(5.0), np.zeros(2)).unique


@settings(max_examples=20)
@given(GENERATORS, st.sampled_from(["constant", "alike", "own"]))
def test_the_three_kinds_of_rows_are_right(rng, kind):
    """p* > 0 at the lower obstacle, p* < 0 at the upper one, p* = 0 off both: decided exactly."""
    problem = drawn(rng, kind)
    exact = pieces(problem).solutions
    z = (nearest_floats(exact[0]) if exact else np.zeros(problem.n)) + 10.0 ** rng.uniform(-16, 0) * rng.normal(
        size=problem.n
    )
    bound = error_bound(problem, z)
    rows = active_set(problem, z, bound)
    kinds = np.array([rows.active, rows.above, rows.inactive, rows.undecided])
    assert (kinds.sum(axis=0) == 1).all()
    if bound.value is None:
        assert rows.undecided.all()
        return
    for i in range(problem.n):
        row = problem.A.toarray()[i].tolist()
        p = sum((Fraction(a) * x for a, x in zip(row, exact[0], strict=True)), Fraction(problem.q[i]))
        assert rows.undecided[i] or [p > 0, p < 0, p == 0] == [rows.active[i], rows.above[i], rows.inactive[i]]


@settings(max_examples=15)
@given(GENERATORS, st.booleans())
def test_isotone_steps_go_down_from_a_supersolution_between_two_obstacles(rng, newest):
    """Theorem monotone: A a Z-matrix, both obstacles isotone, each F_i(s) ≥ 0 through p and r, or through s ≥ ψ̄."""
    n = int(rng.integers(1, 5))
    A = -np.abs(rng.normal(size=(n, n)))
    np.fill_diagonal(A, rng.uniform(0.5, 4, n))
    G, H, s, room = *(np.abs(rng.normal(size=(n, n))) * 0.5 for _ in range(2)), rng.normal(size=n), rng.random((3, n))
    beyond = rng.random(n) < 0.3
    psi = icp.Affine(G, s - room[0] - G @ s)
    upper = icp.Affine(H, s + np.where(beyond, -room[1], room[1]) - H @ s)
    problem = icp.ICP(A, np.where(beyond, rng.normal(size=n), room[2]) - A @ s, psi, upper=upper)
    member = icp.PSOR(omega=0.8) if newest else icp.MNMJ(phi=np.full(n, 0.25) * A.diagonal(), phi2=0.8 * A.diagonal())
    assert check("monotone", problem, member).holds is True
    path = [z for z, _ in itertools.islice(member.iterates(problem, s), 8)]
    assert all(
        (after <= before + 1e-9 * (1 + np.abs(before).max())).all() for before, after in itertools.pairwise(path)
    )
    lower = s - rng.random(n)
    below, above = (next(itertools.islice(member.iterates(problem, z), 1, None))[0] for z in (lower, s))
    assert (below <= above + 1e-9).all()
    shrinking = problem.with_sides(psi, icp.Affine(-H, upper.linear[1]))
    assert check("monotone", shrinking, member).holds is False


@settings(max_examples=15)
@given(GENERATORS)
def test_infeasibility_between_fixed_obstacles_is_proved_and_true(rng):
    """Farkas: y_i ≥ 0 where nothing is above, y_i ≤ 0 where nothing is below, and (Az + q)ᵀy < 0 in the whole box."""
    n = int(rng.integers(1, 5))
    A, c = rng.integers(-3, 4, (n, n)).astype(float), rng.integers(-3, 4, n).astype(float)
    d = c + rng.integers(0, 4, n)
    c, d = np.where(rng.random(n) < 0.4, -np.inf, c), np.where(rng.random(n) < 0.5, np.inf, d)
    problem = icp.ICP(A, rng.integers(-5, 6, n), c, upper=d)
    y = multipliers(problem)
    found = infeasible(problem, rng.normal(size=n) if y is None else y)
    if found.holds:
        assert not pieces(problem).solutions
        y = [Fraction(x) for x in found.witness]
        assert all((x >= 0 or c[i] == -np.inf) and (x <= 0 or d[i] == np.inf) for i, x in enumerate(y))
        total = sum((Fraction(x) * b for x, b in zip(problem.q.tolist(), y, strict=True)), Fraction(0))
        for column, low, high in zip(A.T.tolist(), c.tolist(), d.tolist(), strict=True):
            entry = sum((Fraction(a) * b for a, b in zip(column, y, strict=True)), Fraction(0))
            total += entry * Fraction(high if entry > 0 else low) if entry else 0
        assert total < 0
    assert problem.solve(raise_on_failure=False).infeasible is None or not pieces(problem).solutions


def test_a_sign_of_p_is_wrong_where_no_obstacle_pushes_that_way():
    """p < 0 asks for an upper obstacle, p > 0 for one below; and z may be beyond either."""
    problem = icp.ICP(np.eye(4), np.zeros(4), [0.0, -np.inf, -np.inf, 0.0], upper=[np.inf, 5.0, np.inf, 5.0])
    for z, of_p, of_r in (
        ([-3.0, 0.0, 0.0, 0.0], 3.0, 3.0),
        ([0.0, 2.0, 0.0, 0.0], 2.0, 0.0),
        ([0.0, -2.0, 0.0, 0.0], 0.0, 0.0),
        ([0.0, 0.0, -4.0, 0.0], 4.0, 0.0),
        ([0.0, 0.0, 4.0, 0.0], 4.0, 0.0),
        ([0.0, 0.0, 0.0, 7.0], 0.0, 2.0),
    ):
        found = icp.certify(problem, z, bound=False)
        assert (found.violation_p, found.violation_r) == (of_p, of_r)
