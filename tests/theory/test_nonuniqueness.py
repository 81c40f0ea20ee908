"""What is said of the solutions where there is no proof that there is one: true of all of them."""

from fractions import Fraction

import numpy as np
import pytest

import icpmodel as icp
from icpmodel.theory.nonuniqueness import face_at, solution_facts

SEGMENT = icp.ICP([[1.0, 1.0], [1.0, 1.0]], [-2.0, -2.0])
SKEW = icp.ICP([[0.0, 1.0], [-1.0, 0.0]], [0.0, 0.0])
TWO = icp.ICP([[-1.0]], [1.0])


@pytest.mark.parametrize(
    ("problem", "words"),
    [
        (SEGMENT, ["p = Az + q is the same", "z may move along (-1, 1)"]),
        (SKEW, ["(A + A')z is the same"]),
        (TWO, ["there are two solutions or more: (1) and (0)"]),
    ],
)
def test_the_page_and_the_summary_say_what_is_known(problem, words):
    summary = problem.solve().summary()["solutions"]
    assert all(one in summary for one in words)
    page = problem.explain().sections()["solution"]
    assert all(one in page for one in words if "may move" not in one)


@pytest.mark.parametrize("A", [[[2.0, 1.0], [1.0, 2.0]], [[1.0, 2.0], [2.0, 1.0]]])
def test_a_unique_solution_needs_no_such_words(A):
    solution = icp.ICP(A, [1.0, 1.0]).solve()
    assert solution.certificate.unique
    assert "solutions" not in solution.summary()


@pytest.mark.parametrize("seed", range(12))
def test_it_holds_for_all_solutions(seed):
    """Law: (A + Aᵀ)z, for symmetric A p, is the same in all solutions, and z + td is a solution for small t."""
    random = np.random.default_rng(seed)
    B = random.integers(-1, 2, (2, 4)).astype(float)
    K = random.integers(-1, 2, (4, 4)) * (seed % 2)
    A = B.T @ B + K - K.T
    point = random.integers(0, 3, 4) * (random.random(4) < 0.7)
    problem = icp.ICP(A, np.where(point > 0, 0, random.integers(0, 2, 4)) - A @ point)
    found = icp.all_solutions(problem)
    classes = icp.theory.classify(A)
    ends = [*found.points, *(one.point for one in found.faces), point]
    (first, *_) = solution_facts(problem, classes)
    same = A if first.startswith("p =") else A + A.T
    assert np.ptp([same @ end for end in ends], axis=0).max() < 1e-12
    face = face_at(problem, point.astype(float))
    for direction in [] if face is None else face.directions:
        for step in (-(2.0**-20), 2.0**-20):
            z = [Fraction(a) + Fraction(step) * Fraction(d) for a, d in zip(face.point, direction, strict=True)]
            p = [
                sum(Fraction(a) * x for a, x in zip(row, z, strict=True)) + Fraction(q)
                for row, q in zip(A, problem.q, strict=True)
            ]
            assert max(abs(min(a, b)) for a, b in zip(p, z, strict=True)) < 1e-12
