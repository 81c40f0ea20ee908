"""What all front ends have in common: a `Reading` is an ICP, and leads from z back to the model."""

import cvxpy as cp
import numpy as np
import pyomo.environ as pyo
import pytest
from pyomo.mpec import Complementarity, complements

import icpmodel as icp
from icpmodel.modelling import read_pyomo
from icpmodel.modelling.cvxpy.expressions import CvxpyReading
from icpmodel.modelling.reading import Reading, solved

A, Q = np.array([[3.0, -1.0], [-1.0, 2.0]]), np.array([-2.0, 3.0])


def from_cvxpy(start):
    x = cp.Variable(2, name="x")
    x.value = start
    return CvxpyReading([icp.complements(A @ x + Q, 2 * x - 0.5)])


def from_pyomo(start):
    model = pyo.ConcreteModel()
    model.x = pyo.Var(range(2), initialize=None if start is None else dict(enumerate(start.tolist())))
    x = model.x
    model.c = Complementarity(
        range(2), rule=lambda _, i: complements(sum(A[i, j] * x[j] for j in range(2)) >= -Q[i], 2 * x[i] >= 0.5)
    )
    return read_pyomo(model)


def flat(pairs):
    return np.concatenate([np.ravel(value, order="F") for _, value in pairs])


@pytest.mark.parametrize("read", [from_cvxpy, from_pyomo])
class TestReading:
    def test_it_is_a_reading_of_the_same_icp(self, read):
        reading = read(None)
        assert isinstance(reading, Reading)
        assert reading.problem.A.toarray().tolist() == A.tolist()
        assert reading.problem.q.tolist() == Q.tolist()
        assert reading.problem.psi.value(np.zeros(2)).tolist() == [0.25, 0.25]

    def test_the_start_is_what_the_variables_have(self, read):
        assert read(np.array([3.0, 4.0])).start().tolist() == [3.0, 4.0]
        start = read(None).start()
        assert start is None or not start.any()

    def test_values_and_multipliers_are_those_of_z(self, read):
        reading, z = read(None), np.array([0.75, 1.25])
        assert flat(reading.values(z)) == pytest.approx(z)
        assert flat(reading.multipliers(z)) == pytest.approx(A @ z + Q)

    def test_solving_starts_there_and_never_raises_for_a_failure(self, read):
        reading, starts = read(np.array([3.0, 4.0])), []
        options = {"callback": lambda state: starts.append(state.z), "max_iter": 0}
        assert not solved(reading, "mnmgs", **options).solved
        assert starts[0].tolist() == [3.0, 4.0]
        z = solved(reading, "mnmgs", z0=[0.0, 0.0], rtol=1e-12).z
        assert z == pytest.approx([0.75, 0.25])
        assert flat(reading.multipliers(z)) == pytest.approx([0.0, 2.75], abs=1e-10)
