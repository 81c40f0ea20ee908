"""What a proof of infeasibility says: a minimal set of conditions, by how much they fail, and the nearest q."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from known_answers import attempt
from scipy.optimize import linprog

import icpmodel as icp
from icpmodel import ICP
from icpmodel.numerics import work
from icpmodel.theory.certificates.infeasible import infeasible

ENTRIES = st.integers(-2, 2)


@st.composite
def problems(draw):
    n = draw(st.integers(1, 4))
    A, G = np.array(draw(st.lists(ENTRIES, min_size=2 * n * n, max_size=2 * n * n))).reshape(2, n, n)
    q, c = np.array(draw(st.lists(st.integers(-3, 1), min_size=2 * n, max_size=2 * n))).reshape(2, n)
    upper = draw(st.sampled_from([None, np.full(n, 2.0)]))
    psi = icp.Affine(G / 2, c) if draw(st.booleans()) else np.where(q < -1, -np.inf, c)
    return ICP(A, q, psi, upper=upper)


def inequalities(problem):
    """{condition in words: (row, side)} with row · z ≥ side, from the definition."""
    found, unit = {}, np.eye(problem.n)
    (G, c), (H, d) = ((one.linear[0].toarray(), one.linear[1]) for one in (problem.psi, problem.upper or problem.psi))
    d = d if problem.upper else np.full(problem.n, np.inf)
    for i, (row, q) in enumerate(zip(problem.dense(), problem.q, strict=True)):
        if np.isinf(d[i]):
            found[f"p[{i}] >= 0"] = row, -q
        if np.isinf(c[i]):
            found[f"p[{i}] <= 0"] = -row, q
        if c[i] > -np.inf:
            found[f"z[{i}] >= psi[{i}]"] = unit[i] - G[i], c[i]
        if d[i] < np.inf:
            found[f"z[{i}] <= upper[{i}]"] = H[i] - unit[i], -d[i]
    return found


def can_be_met(conditions):
    if not conditions:
        return True
    M, m = (np.array(part) for part in zip(*conditions, strict=True))
    return linprog(np.zeros(M.shape[1]), A_ub=-M, b_ub=-m, bounds=(None, None)).status == 0


@given(problems())
def test_the_set_contradicts_itself_and_no_part_of_it_does(problem):
    stated, found = inequalities(problem), icp.contradiction(problem)
    assert (found is None) == can_be_met(stated.values())
    if found is None:
        return
    kept = [stated[one] for one in found.conditions]
    assert sum(w * row for w, (row, _) in zip(found.weights, kept, strict=True)) == pytest.approx(np.zeros(problem.n))
    assert sum(w * side for w, (_, side) in zip(found.weights, kept, strict=True)) > 0
    for k in range(len(kept)):
        assert can_be_met(kept[:k] + kept[k + 1 :])
    if found.change is not None:
        largest = np.abs(problem.dense()).max(axis=1)
        units = np.abs(found.change) / np.where(largest > 0, largest, 1.0)
        assert units.max() == pytest.approx(found.violation)
        nearer = inequalities(problem.with_q(problem.q + found.change))
        assert can_be_met([(row, side - 1e-9) for row, side in nearer.values()])


def test_rounding_adds_no_condition_on_an_unknown_between_two_ends():
    """z₂ ≤ −3 and z₂ ≥ ½ contradict each other, whatever the ends of z₂: −0.3/0.7 is rounded."""
    A = [[0, 0, -0.3], [0, 0, 0.7], [0, 0, 1]]
    found = icp.contradiction(ICP(A, [-0.9, -0.35, 0.0], [0, 0, -5], upper=[np.inf, np.inf, 5.0]))
    assert set(found.conditions) == {"p[0] >= 0", "p[1] >= 0"}


@pytest.mark.parametrize("gap", [1.0, 1e-2, 5e-6])
def test_a_near_contradiction_is_distinguished_from_a_solved_problem(gap):
    """1 ≥ z₀ ≥ 1 + gap as rows 20 and 21, in a problem of 22 rows whose units go from 1 to 1e4."""
    random = np.random.default_rng(3)
    A = random.uniform(-1, 1, (22, 22))
    A = A @ A.T + 22 * np.eye(22)
    q = random.uniform(-1, 1, 22)
    for i in (0, 20, 21):
        A[i], A[:, i] = 0, 0
    A[20, 0], A[0, 20], A[21, 0], A[0, 21] = -1, 1, 1, -1
    q[[0, 20, 21]] = 0, 1, -1 - gap
    unit = 10.0 ** random.uniform(0, 4, 22)
    problem = ICP(unit[:, None] * A, unit * q)
    solution = attempt(problem)
    assert solution.status is icp.Status.INFEASIBLE
    assert str(solution.contradiction) == f"infeasible by {gap / 2:.3g}: p[20] >= 0, p[21] >= 0"
    assert str(solution.contradiction) in solution.message
    assert str(solution.contradiction) in str(solution.infeasible)
    nearer = problem.with_q(problem.q + 1.001 * solution.contradiction.change).solve()
    assert nearer.solved
    assert nearer.contradiction is None


def test_a_run_that_stagnates_on_a_contradiction_ends_with_its_proof():
    """1 − z ≥ 0 and z ≥ 1 + 5e-6, of which Newton's steps find no proof."""
    problem = ICP([[-1.0]], [1.0], psi=1 + 5e-6)
    solution = attempt(problem, "newton", max_iter=50)
    assert solution.status is icp.Status.INFEASIBLE
    assert solution.infeasible.holds
    assert replace(solution).contradiction.violation == pytest.approx(5e-6)


def test_an_entry_that_underflows_in_the_units_of_a_proof_still_counts():
    """z = (1e450, 1) is a solution, though no float is."""
    problem = icp.ICP([[1e-150, -1e300], [0.0, 1e300]], [0.0, 0.0], [0.0, 1.0])
    assert not problem.solve(max_iter=100, raise_on_failure=False).infeasible


def test_conditions_have_the_labels_of_pandas_objects_and_no_other_ones():
    pandas = pytest.importorskip("pandas")
    A, q, names = np.zeros((2, 2)), np.array([1.0, -2.0]), ["demand", "supply"]
    labelled = ICP(pandas.DataFrame(A, names, names), q), ICP(A, pandas.Series(q, names))
    for problem in (*labelled, labelled[0].with_q(q - 1)):
        assert icp.contradiction(problem).conditions == ("supply: p >= 0",)
        assert "supply: p >= 0" in attempt(problem).message
    assert icp.contradiction(ICP(pandas.DataFrame(A), q)).conditions == ("p[1] >= 0",)


@pytest.mark.parametrize("unit", [1.0, 2.0**1000])
def test_an_exact_combination_is_found_in_any_units_unless_its_time_ends(unit):
    """Its weights are no simple fractions: an elimination gives them. Where that is cut short there is no error."""
    rng = np.random.default_rng(0)
    rows = rng.integers(-9, 10, size=(9, 10))
    weights = rng.integers(1, 1009, size=9)
    A, q = np.vstack([1009 * rows, weights @ rows]), np.r_[np.zeros(9), 1.0]
    problem, y = ICP(unit * A, unit * q, -np.inf), np.r_[weights / 1009, -1.0]
    begun = work.counter()
    assert infeasible(problem, y).holds
    cost = work.counter() - begun
    with work.work_limit(nanoseconds=cost):  # it begins, and nothing is left
        assert infeasible(problem, y).holds is None


def test_many_conditions_are_counted_not_listed():
    conflict = icp.contradiction(ICP(np.eye(70) * 2 - 0.1, -np.ones(70)))
    assert len(conflict.conditions) == 71
    assert str(conflict).endswith("p[16] >= 0 and 63 more")
