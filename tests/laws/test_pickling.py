"""What is public can be sent to another process and back, errors with what they carry included."""

import copy
import pickle

import numpy as np
import pytest
import scipy.sparse as sp
from known_answers import PAIR, attempt

import icpmodel as icp

PROBLEM = icp.ICP(PAIR, [-1.0, 3.0])


def again(value):
    return pickle.loads(pickle.dumps(value))


@pytest.mark.parametrize(
    "psi", [0.0, [1.0, -np.inf], icp.Affine(np.eye(2) / 4, 1.0), icp.Elementwise(np.tanh, lipschitz=1)]
)
def test_a_problem_and_its_solution_are_the_same_there(psi):
    problem = PROBLEM.with_psi(psi)
    solution = attempt(problem)
    there = again(solution)
    assert np.array_equal(there.z, solution.z)
    assert repr(there.problem) == repr(problem)
    assert np.array_equal(attempt(there.problem).z, solution.z)
    assert repr(there.method) == repr(solution.method)
    assert there.certificate.error_bound == solution.certificate.error_bound


@pytest.mark.parametrize("f", [None, np.zeros_like])
def test_labels_of_rows_are_the_same_there(f):
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    names = ["steel", "wood"]
    A = pandas.DataFrame(np.diag([0.0, 1.0]), names, names)
    problem = icp.ICP(A, pandas.Series([-2.0, 1.0], names), f=f)
    for there in (problem, again(problem), copy.copy(problem), copy.deepcopy(problem)):
        assert "steel: p >= 0" in str(icp.contradiction(there.linearised(np.zeros(2))))


def test_errors_carry_there_what_they_hold():
    with pytest.raises(icp.NotSolved) as caught:
        PROBLEM.solve("mnmgs", max_iter=1)
    there = again(caught.value)
    assert str(there) == str(caught.value)
    assert np.array_equal(there.solution.z, caught.value.solution.z)
    with pytest.raises(icp.SingularOperator) as singular:
        icp.ICP([[1.0]], [1.0]).solve("mnmgs", phi=-2.0)
    assert again(singular.value).row == 0
    assert again(icp.Interrupted({"rows": 1})).report == {"rows": 1}


def arrays(value):
    if isinstance(value, np.ndarray):
        return [value]
    return [value.data, value.indices, value.indptr] if sp.issparse(value) else []


def test_what_is_read_only_stays_so_there():
    problem = icp.ICP(PAIR, [-1.0, 3.0], icp.Affine(np.eye(2) / 4, [0.5, -np.inf]))
    solution = problem.solve("mnmgs", history=True)
    results = [solution, solution.history, solution.certificate.bound, solution.active_set, problem.psi]
    results += [solution.problem.psi, icp.MNMGS(phi=[1.0, 2.0]), icp.solve_many(problem.A, [[1.0, 2.0]])]
    results += [attempt(icp.ICP([[1.0, -1.0], [-1.0, 1.0]], [-1.0, 0.0])).infeasible]
    for one in [*results, problem.explain().classes, icp.scenes.membrane(n=25)]:
        for there in (again(one), copy.deepcopy(one)):
            found = [array for value in vars(there).values() for array in arrays(value)]
            assert found
            assert not any(array.flags.writeable for array in found), type(one)


@pytest.mark.parametrize("name", icp.scenes.names())
def test_a_scene_is_the_same_there(name):
    scene = icp.scenes.scene(name)
    there, z = again(scene), np.zeros(scene.problem.n)
    assert np.array_equal(there.problem.natural_map(z), scene.problem.natural_map(z), equal_nan=True)
    assert str(there.errors(z)) == str(scene.errors(z))


def test_every_public_name_is_found_there():
    for name in set(dir(icp)) - {"study", "methods", "scenes", "solvers", "theory"}:
        if not name.startswith("_") and callable(getattr(icp, name)):
            assert again(getattr(icp, name)) is getattr(icp, name)
    assert all(repr(again(icp.methods.named(name))) == repr(icp.methods.named(name)) for name in icp.methods.names())
