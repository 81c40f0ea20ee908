"""Law 5: no positive scaling of rows of (A, q), and no common scaling of z, changes a verdict."""

import cvxpy as cp
import numpy as np
import pyomo.environ as pyo
import pytest
import scipy.sparse as sp
from known_answers import PAIR, attempt
from pyomo.contrib.solver.common.factory import SolverFactory
from pyomo.contrib.solver.common.results import SolutionStatus
from pyomo.mpec import Complementarity, complements

import icpmodel as icp
import icpmodel.modelling.pyomo

#: scenes of which a part is larger than a float once its units are changed, or whose unknowns have units of their own
APART = ("hard-overflow", "hard-scaled")
SCENES = {name: icp.scenes.scene(name) for name in icp.scenes.names() if name not in APART}
SCENES = {name: scene for name, scene in SCENES.items() if scene.problem.f is None}
#: factors of a row of (A, q): of each its own, or all of z
ROWS, UNITS = 10.0 ** np.array([-12, -7, 0, 4, 12]), (2.0**-40, 2.0**30, 1e-12, 1e9)
METHODS = ("mnmgs", "psor", "newton", "proximal", "accelerated", "multilevel")
#: those whose weights are not changed by symmetric changes of units, S A S, and so by those of rows alone
OF_SYMMETRIC = ("proximal", "accelerated", "multilevel")


def scaled(problem, rows, unit=1.0):
    """The problem with row i of (A, q) times `rows`[i], in other units of z."""
    A, q = sp.csr_array(sp.diags_array(rows) @ problem.A), rows * problem.q * unit
    return icp.ICP(
        A,
        q,
        problem.psi if unit == 1.0 else problem.psi.composed(sp.eye_array(q.size, format="csr") / unit, factor=unit),
    )


def alike(one, other, unit, exact):
    """Whether two answers are the same: to rounding, or within what both leave open."""
    assert other.status is one.status
    if not one.solved:
        return
    size = float(np.abs(one.z).max())
    if exact:
        assert other.z / unit == pytest.approx(one.z, rel=1e-12, abs=1e-12 * size)
    else:
        assert other.problem.residual(one.z * unit) <= 1.01 * one.tolerance * unit
        assert one.problem.residual(other.z / unit) <= 1.01 * one.tolerance


@pytest.mark.parametrize("name", SCENES)
def test_units_of_rows_and_of_z_change_no_verdict_of_solve(name):
    problem = SCENES[name].problem
    rng, n = np.random.default_rng(0), problem.n
    before = attempt(problem, max_iter=600)
    units = UNITS if problem.psi.is_constant or problem.psi.linear else ()  # jumps in other units are a map of Python's
    changes = [(np.full(n, 2.0**-30), 1.0), (rng.choice(ROWS, n), 1.0), *((np.ones(n), unit) for unit in units)]
    for rows, unit in changes:
        after = attempt(scaled(problem, rows, unit), max_iter=600)
        alike(before, after, unit, exact=False)


@pytest.mark.parametrize("method", METHODS)
def test_units_change_no_step_of_a_method_that_divides_by_the_diagonal(method):
    for name in ("membrane", "bai-nonsymmetric", "manufactured-affine", "box-manufactured", "hand-lcp"):
        problem = icp.scenes.scene(name).problem
        before = problem.solve(method)
        for rows in (2.0**-30, 2.0 ** np.random.default_rng(1).integers(-40, 40, problem.n)):
            for unit in (1.0, 2.0**30):
                if method in OF_SYMMETRIC and np.ndim(rows):
                    continue
                after = scaled(problem, np.broadcast_to(rows, problem.n), unit).solve(method)
                assert after.iterations == before.iterations
                alike(before, after, unit, exact=True)
                assert after.residual == pytest.approx(unit * before.residual, rel=1e-6, abs=1e-13 * unit)


def test_units_of_rows_hide_no_proof_that_there_is_no_solution():
    """A combination of the rows of A is at most 0, and so is that of q."""
    rng, A = np.random.default_rng(0), np.array([[2.0, -3.0, 1.0], [-1.0, 3.0, -3.0], [-2.0, 0.0, 1.0]])
    for _ in range(20):
        rows = 2.0 ** rng.choice([-40, -17, 0, 13, 40], 3)
        found = attempt(icp.ICP(A * rows[:, None], rows * [-1.0, -1.0, 0.0]), max_iter=200)
        assert found.status is icp.Status.INFEASIBLE
    for unit in 2.0 ** np.array([-80, 0, 80]):  # of a row of zeros, beside which the others are all, or nothing
        by_zeros = icp.ICP([[0, 0], [-4, -4]], [-4 * unit, 0], [-4, 0])
        assert by_zeros.solve("josephy", raise_on_failure=False).status is icp.Status.INFEASIBLE
        assert icp.contradiction(icp.ICP([[0, 0], [0, -1]], [unit, -1])).violation == 1.0


def test_where_all_methods_creep_the_search_begins_in_all_units():
    """A small problem on which MNMMOD, the last rung, goes on until `max_iter`, in one form or in the other."""
    first = [[0, 1, 1, 2], [-1, -1, 0, -2], [0, 0, 0, 0], [-1, 0, 1, 0]]
    second = [
        [13 - 3.9e-12, -6 - 1.2e-12, 0, -8],
        [-6 - 1.2e-12, 4, -4 + 1.2e-12, 0],
        [16 - 6.4e-12, -8 - 1.6e-12, 2, -8],
    ]
    second.append([2 + 4e-13, 4 + 1.6e-12, -16 - 3.2e-12, -16])
    fixed, upper = np.array([-np.inf, 0, 0, -np.inf]), np.array([0, 0, np.inf, 0])
    for A, q, c, d in ((first, [-1, 0, 0, 0], np.zeros(4), None), (second, [1, 0, 0, 0], fixed, upper)):
        for exponents in ([0, 0, 0, 0], [-40, -40, -40, 0], [-40, -40, -40, -40]):
            rows, unit = 2.0 ** np.array(exponents), 2.0 ** exponents[0]
            bounds = {} if d is None else {"upper": d * unit}
            assert (
                icp.ICP(np.multiply(A, rows[:, None]), np.multiply(q, rows * unit), c * unit, **bounds).solve().solved
            )


def test_rows_in_other_units_are_pivoted_alike():
    """Nearly singular ones, where other pivots lose all digits, and zeros on the diagonal below an upper obstacle."""
    units = 2.0 ** np.array([[0, 0, 0], [-40, -40, -17], [30, -3, -30], [0, -17, -40]])
    problems = (
        ([[1 + 1e-13, 0, -1 + 1e-13], [0, 0, 0], [1 + 1e-13, 0, -1]], [-1, 0, 0], [0, 0, 1], None),
        ([[1 + 1e-7, 0, 1], [0, 1e-7, 0], [1, 0, 1 + 1e-7]], [0, 0, 0], [0, -1, -1], None),
        ([[1, -3, -1], [-3, 0, 0], [-3, 3, 2]], [-3, 0, -4], [-1, 0, -1], [2, 3, 0]),
    )
    for A, q, c, upper in problems:
        scaled = [icp.ICP(np.multiply(rows[:, None], A), rows * q, c, upper=upper) for rows in units]
        answers = [one.solve(None if upper is None else "lemke") for one in scaled]
        assert len({(one.iterations, *one.z) for one in answers}) == 1


def test_rows_are_weighed_in_their_own_units():
    """Of an A that is nearly singular, not symmetric, and has a row of zeros."""
    A = np.array([[1, 0, -2, 4], [0, 16, -12, 8], [4, 8, -14, 20], [0, 0, 0, 0]])
    A = A + 1e-13 * np.array([[1, 0, 4, 16], [0, 64, 36, 16], [16, 16, 42, 0], [0, 0, 0, 0]])
    for rows, unit in ((np.ones(4), 1.0), (2.0 ** np.array([-17, -40, -40, -40]), 2.0**-40)):
        assert scaled(icp.ICP(A, [3, 0, 0, 0], [-2, -4, 0, 0]), rows, unit).solve().solved


def test_newton_weighs_a_row_of_zeros_in_the_units_of_z():
    """Where it ends without a solution as well: what is left of φ depends on the weight of each row."""
    A = [[1.0, 0.3, 0.4, 1.3], [1.0, 3.4, 1.2, -2.4], [-0.4, -1.9, -0.1, 1.2], [0, 0, 0, 0]]
    problem = icp.ICP(A, [-1.5, 0.3, -1.2, 0.001])
    before = attempt(problem, "newton")
    for row, unit in ((2.0**-40, 1.0), (2.0**40, 1.0), (1.0, 2.0**30)):
        after = attempt(scaled(problem, np.array([1.0, 1.0, 1.0, row]), unit), "newton")
        assert after.status is before.status
        assert (after.z / unit).tolist() == before.z.tolist()


def test_a_tiny_entry_on_the_diagonal_makes_no_residual_small():
    """d_i = a_ii would: D⁻¹q would be 1e12 in row 0, beside which nothing in row 1 is large."""
    problem = icp.ICP([[1e-12, 1.0], [-1.0, 1.0]], [-1.0, -1.0])
    assert problem.residual_scale() == pytest.approx(np.sqrt(2.0))
    assert problem.solve(z0=[5.0, 5.0]).z == pytest.approx([0.0, 1.0], abs=1e-8)


@pytest.mark.parametrize(
    ("A", "q", "below", "above"),
    [
        ([[1.0, 0.0], [0.0, 0.0]], [0.0, 3.0], 0.0, np.inf),
        ([[1.0, 0.0], [0.0, 0.0]], [0.0, -2.0], -np.inf, 0.0),
        (PAIR, [0.0, 0.0], -1e9, np.inf),
        ([[1.0, 0.0], [0.0, 1e-10]], [0.0, 1.0], 0.0, np.inf),
    ],
)
def test_data_far_larger_than_the_start_do_not_make_it_a_solution(A, q, below, above):
    """z = 0 alone solves each: rows of zeros, and obstacles as good as none, make no residual small."""
    solution = icp.ICP(A, q, below, above).solve(z0=[5.0, 3.0])
    assert solution.z == pytest.approx([0.0, 0.0], abs=1e-6)


def test_a_row_whose_p_is_no_float_in_the_units_of_z_is_decided_by_r():
    """1e150/1e-300 is none: z_1 rests on its obstacle, whatever else is computed."""
    problem = icp.ICP([[1.0, 0.0], [0.0, 1e-300]], [-1.0, 1e150], [-1.0, -2.0])
    found = problem.solve()
    assert found.z == pytest.approx([1.0, -2.0])


@pytest.mark.parametrize("unit", [1e-9, 1e9])
def test_many_problems_are_judged_in_all_units_alike(unit):
    A, Q = PAIR, np.array([[-1.0, 3.0], [1.0, 2.0], [0.0, 0.0]])
    for of_A, of_z in ((unit, 1.0), (1.0, unit)):
        many = icp.solve_many(A * of_A, Q * of_A * of_z)
        assert many.Z / of_z == pytest.approx(icp.solve_many(A, Q).Z)
        assert many.tolerances / of_z == pytest.approx(icp.solve_many(A, Q).tolerances)


@pytest.mark.parametrize("factor", [1e-9, 1e-6, 1.0, 1e3, 1e7])
def test_a_factor_on_a_side_of_a_model_changes_no_answer(factor):
    """z = .2 + exp(−z²); in a second condition y = 1e-6 is far smaller than z."""
    for p_factor, r_factor in ((factor, 1.0), (1.0, factor)):
        x = cp.Variable()
        pair = icp.complements(p_factor * (5 * x - 2), r_factor * (x - (0.2 + cp.exp(-(x**2)))))
        problem = icp.Problem(pair)
        problem.solve()
        assert (problem.status, x.value) == ("optimal", pytest.approx(0.76067119, abs=1e-7))
        model = pyo.ConcreteModel()
        model.x, model.y = pyo.Var(initialize=0.0), pyo.Var(initialize=0.0)
        sides = p_factor * (5 * model.x - 2) >= 0, r_factor * (model.x - 0.2 - pyo.exp(-(model.x**2))) >= 0
        model.pair = Complementarity(expr=complements(*sides))
        model.small = Complementarity(expr=complements(model.y >= 0, r_factor * (1e6 * model.y - model.x) >= 0))
        results = SolverFactory("icpmodel").solve(model)
        assert results.solution_status is SolutionStatus.optimal
        assert model.x.value == pytest.approx(0.76067119, abs=1e-7)
        assert model.y.value == pytest.approx(0.76067119e-6, rel=1e-5)


def test_a_solution_from_a_singular_piece_is_the_same_in_all_units():
    """Of the many solutions (0, 4 + 3t, 1 + .75t, 16/3 + 4t) of which a point inside is taken, in fractions."""
    A = np.array([[0.0, 0, 0, 0], [0, -3, -4, 3], [0, 4, 0, -3], [4, 0, 0, 0]])
    c = np.array([0.0, 0, 4, 0])
    z = icp.ICP(A, np.zeros(4), c).solve("enumerate").z
    for rows, unit in ((2.0**-40, 2.0**-40), (1.0, 2.0**-40), (2.0**30, 2.0**20)):
        assert np.array_equal(icp.ICP(rows * A, np.zeros(4), unit * c).solve("enumerate").z, unit * z)
