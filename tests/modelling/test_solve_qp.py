"""`solve_qp`: the program's own units, signs and multipliers, proofs, arguments; and the ways to its linear systems."""

from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from known_answers import SEEDS

import icpmodel as icp
from icpmodel.modelling.programs.program import Presolve
from icpmodel.modelling.programs.program_arguments import read
from icpmodel.modelling.programs.program_judge import Judge
from icpmodel.modelling.programs.program_run import ProgramRun
from icpmodel.modelling.programs.solve_qp import solve_program
from icpmodel.numerics import work


def a_program(seed, n=6):
    """A random feasible program with rows, equations and bounds of all kinds."""
    random = np.random.default_rng(seed)
    L, G, A = (random.normal(size=(rows, n)) for rows in (random.integers(0, n + 1), 4, 2))
    inside = random.normal(size=n)
    low, high = inside - random.random(n), inside + random.random(n)
    low[0], high[1] = -np.inf, np.inf
    return L.T @ L, random.normal(size=n), G, G @ inside + random.random(4), A, A @ inside, low, high


@pytest.mark.parametrize("rest", [0, 1])
def test_a_limit_that_is_reached_before_a_method_is_chosen_is_a_status(rest):
    n = 300
    P = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n, n))
    G = sp.eye_array(20, n) + sp.eye_array(20, n, k=100)
    program = read((P, -np.ones(n), G, np.ones(20), None, None, None, None), "Pq")
    before = work.counter()
    ProgramRun(Presolve(program).program, 1e-9)
    with work.work_limit(nanoseconds=work.counter() - before + rest):
        assert solve_program(program)[0].status == "user_limit"


@settings(max_examples=40)
@given(SEEDS)
def test_the_answer_and_its_multipliers_satisfy_the_conditions(seed):
    """Px + q + Gᵀz + Aᵀy + z_box = 0, feasibility, signs and complementarity."""
    P, q, G, h, A, b, low, high = a_program(seed)
    found = icp.solve_qp(P, q, G, h, A, b, low, high)
    x = found.x
    assert found.solved
    assert found.violation <= 1e-7
    assert P @ x + q + G.T @ found.z + A.T @ found.y + found.z_box == pytest.approx(0, abs=1e-6)
    assert A @ x == pytest.approx(b, abs=1e-6)
    assert (G @ x <= h + 1e-6).all()
    assert (found.z >= 0).all()
    assert found.z * (h - G @ x) == pytest.approx(0, abs=1e-6)
    assert (x >= low - 1e-6).all()
    assert (x <= high + 1e-6).all()
    at = np.where(found.z_box < 0, low, high)
    assert x[found.z_box != 0] == pytest.approx(at[found.z_box != 0], abs=1e-6)
    assert found.objective == pytest.approx(0.5 * x @ P @ x + q @ x)


def test_dense_and_sparse_arguments_a_start_and_single_rows_give_the_same():
    P, q, G, h, A, b, low, high = a_program(3)
    x = icp.solve_qp(P, q, G, h, A, b, low, high).x
    sparse = [sp.csc_matrix(M) if np.ndim(M) == 2 else M for M in (P, q, G, h, A, b)]
    assert icp.solve_qp(*sparse, low, high).x == pytest.approx(x, abs=1e-8)
    again = icp.solve_qp(P, q, G, h, A, b, low, high, initvals=x)
    assert again.x == pytest.approx(x, abs=1e-8)
    assert again.iterations <= 1
    for row in ([1, 1], sp.coo_array([1, 1])):
        assert icp.solve_qp(np.eye(2), [0, 0], A=row, b=2).x == pytest.approx([1, 1])
    without = icp.solve_qp(
        np.eye(2), [-3.0, 1.0], G=[[1.0, 0.0], [1.0, 1.0], [2.0, 1.0]], h=[np.inf, np.inf, 2.0], ub=1
    )
    assert without.x == pytest.approx([1.0, -1.0])
    assert without.conditions.residual(np.concatenate([without.x, without.z])) < 1e-12
    assert without.error_bound.value < 1e-12


def test_what_has_no_solution_is_proved_or_raises():
    with pytest.raises(icp.NotSolved, match="row 0 of G and 1 times row 1 of G exceeds") as raised:
        icp.solve_qp(np.eye(2), [0, 0], G=[[1, 1], [-1, -1]], h=[-1, 0])
    assert raised.value.solution.status == "infeasible"
    assert np.isnan(raised.value.solution.x).all()
    fails = icp.solve_qp(np.zeros((2, 2)), [-1, 0], lb=0, A=[[1, -1]], b=[0], raise_on_failure=False)
    assert fails.status == "unbounded"
    assert "falls for ever" in repr(fails)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("nanoseconds", [1.0, 1e5, 3e5])
def test_nothing_is_said_of_a_program_but_that_the_limit_has_ended_it(sign, nanoseconds):
    """Also not that it is convex, or that it is not, which takes time as well."""
    P, *others, low, high = a_program(1, 30)
    with work.work_limit(nanoseconds=nanoseconds):
        late = icp.solve_qp(sign * P, *others, low, high, raise_on_failure=False)
    assert late.status == "user_limit"
    assert ((low <= late.x) & (late.x <= high)).all()
    assert late.violation > 1e-7


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (([[1, 2], [0, 1]], [0, 0]), r"P\[.*\(P \+ P.T\)/2 has the same objective"),
        (([[1, 0], [0, -1]], [0, 0]), "P is not positive semidefinite"),
        (([[1.0]], [0], [[1, 2]], [1]), r"G has shape \(1, 2\); shape \(m, 1\)"),
        (([[1.0]], [0], [[1]], None), "G is given without h"),
        (([[1.0]], [0], np.zeros((0, 1)), [1, 2]), r"h has shape \(2,\); shape \(0,\)"),
        (([[1.0]], [0], [[np.nan]], [1]), r"G\[0, 0\] is nan"),
        (([[1.0]], [0], None, None, None, None, np.inf), r"lb\[0\] is inf"),
    ],
)
def test_wrong_arguments_are_named(arguments, sentence):
    with pytest.raises(icp.InputError, match=sentence):
        icp.solve_qp(*arguments)


def test_qpsolvers_finds_us_by_name(capsys):
    """In its own signs; where there is no solution it says so, and a program that is not convex is its ProblemError."""
    qpsolvers = pytest.importorskip("qpsolvers", reason="qpsolvers is not installed")
    name = icp.qpsolvers_solver()
    assert name == icp.qpsolvers_solver() == "icpmodel"
    assert qpsolvers.available_solvers.count("icpmodel") == 1
    P, q, G, h, A, b, low, high = a_program(5)
    ours = icp.solve_qp(P, q, G, h, A, b, low, high)
    assert qpsolvers.solve_qp(P, q, G, h, A, b, low, high, solver=name) == pytest.approx(ours.x)
    problem = qpsolvers.Problem(P, q, G, h, A, b, low, high)
    found = qpsolvers.solve_problem(problem, solver=name, tolerance=1e-8)
    assert found.is_optimal(1e-6)
    assert found.extras["status"] == "optimal"
    qpsolvers.solve_qp(np.eye(1), -np.ones(1), solver=name, verbose=True)
    assert "optimal after 1 step: solved" in capsys.readouterr().out
    assert qpsolvers.solve_qp(np.eye(1), np.zeros(1), lb=np.ones(1), ub=np.zeros(1), solver=name) is None
    with pytest.raises(qpsolvers.exceptions.ProblemError, match="not positive semidefinite"):
        qpsolvers.solve_qp(-np.eye(1), np.zeros(1), solver=name)
    with pytest.raises(qpsolvers.exceptions.ProblemError, match="raise_on_failure"):
        qpsolvers.solve_qp(np.eye(1), np.zeros(1), solver=name, raise_on_failure=True)


def test_without_qpsolvers_we_say_what_to_install(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "qpsolvers", None)
    with pytest.raises(icp.NotApplicable, match="pip install qpsolvers"):
        icp.qpsolvers_solver()


@pytest.mark.parametrize("row", [[3.0], [-3.0]])
def test_bounds_that_cross_by_their_rounding_touch(row):
    """3x <= .3 and x >= .1, of which no decimal is a float: nobody means that there is no x."""
    sign = np.sign(row[0])
    low, high = (0.1, None) if sign > 0 else (None, -0.1)
    found = icp.solve_qp([[2.0]], [0.0], G=[row], h=[0.3], lb=low, ub=high)
    assert found.x[0] == pytest.approx(sign * 0.1, abs=1e-15)
    assert (
        icp.solve_qp([[2.0]], [0.0], G=[row], h=[0.2999], lb=low, ub=high, raise_on_failure=False).status
        == "infeasible"
    )


def test_an_answer_between_bounds_that_touch_has_a_bound():
    found = icp.solve_qp([[1.0]], [0.0], lb=0.1 + 0.2, ub=0.3)
    assert found.error_bound.value < 1e-15
    assert found.crosscheck(["osqp"]).agrees


def test_a_cross_check_states_the_error_bound_of_the_program():
    """The conditions of these 13 bounds and a row have no bound of their own."""
    found = icp.solve_qp(2 * np.eye(13), -np.arange(13.0), G=np.ones(13), h=[1.0], lb=0)
    report = found.crosscheck(["osqp"])
    assert report.error_bound == found.error_bound.value < 1e-8
    assert report.conclusion().startswith("Solved; no entry of x off by more than ")
    assert "|x - x*| <= " in str(report)


def test_a_program_that_was_proved_infeasible_is_cross_checked_as_such():
    found = icp.solve_qp([[1.0]], [1.0], G=[[1.0], [-1.0]], h=[0.0, -1.0], A=[[1.0]], b=[0.5], raise_on_failure=False)
    assert found.status == "infeasible"
    assert found.crosscheck(["osqp"]).conclusion().startswith("Not solved (infeasible)")


def test_bounds_that_cross_are_named():
    with pytest.raises(icp.InputError, match=r"lb\[0\] = 1 is above ub\[0\] = 0"):
        icp.solve_qp([[1.0]], [0.0], lb=1, ub=0, raise_on_failure=False).crosscheck()


def test_ctrl_c_loses_no_iterate(monkeypatch):
    plain = icp.ICP.p
    calls = []

    def p(self, z):
        calls.append(z)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return plain(self, z)

    monkeypatch.setattr(icp.ICP, "p", p)
    program = a_program_of_rank_1(0, 1.0)[1]
    with pytest.raises(icp.NotSolved, match="Ctrl-C") as raised:
        icp.solve_qp(*program)
    assert len(calls) >= 3
    assert raised.value.solution.status == "user_limit"
    assert np.isfinite(raised.value.solution.x).all()


#: large entries of P in which q disappears: the objective moves along the null space of P alone
FLAT = [
    ([[8e6, -8e6, 0.0], [-8e6, 9e6, -1e6], [0.0, -1e6, 1e6]], [0.0, 1e-4, 0.0], [[-1.0, 0.0, 0.0]], [1.0], -1e-4),
    ([[1e7, 1e7], [1e7, 1e7]], [-1e-4, 0.0], [[1.0, 0.0]], [-1.0], 1e-4),
    ([[4e6, -2e6], [-2e6, 1e6]], [-2e-4, -3e-4], [[0.0, 2.0], [-2.0, 0.0]], [1.0, 2.0], -2.00000000005e-4),
]


@pytest.mark.parametrize(("P", "q", "G", "h", "least"), FLAT)
@pytest.mark.parametrize("unit", [1.0, 1e-6, 1e6])
def test_what_is_optimal_has_the_least_objective_however_large_p_is_beside_q(P, q, G, h, least, unit):
    """Px = 0 holds to rounding at any x in the null space: it says nothing of q, and q is all that matters there."""
    found = icp.solve_qp(np.array(P) * unit, np.array(q) * unit, G, h)
    assert found.objective == pytest.approx(least * unit, rel=1e-5)  # what float64 makes of xᵀPx is off by as much


def a_wild_program(seed):
    """Small data in units that differ by 10^±9 from row to row; some are infeasible or unbounded."""
    random = np.random.default_rng(seed)
    n, m, k = random.integers(1, 4), random.integers(0, 3), random.integers(0, 5)
    B = random.integers(-2, 3, (random.integers(0, n + 1), n))
    rows = [random.integers(-3, 4, (i, n)) * 10.0 ** random.integers(-6, 7, (i, 1)) for i in (m, k)]
    sides = [random.integers(-4, 5, i) * 10.0 ** random.integers(-8, 9) for i in (m, k)]
    q = random.integers(-3, 4, n) * 10.0 ** random.integers(-8, 9)
    return B.T @ B * 10.0 ** random.integers(-12, 9), q, rows[0], sides[0], rows[1], sides[1]


def exactly(*arrays):
    return [
        [[Fraction(float(x)) for x in row] for row in a] if np.ndim(a) == 2 else [Fraction(float(x)) for x in a]
        for a in arrays
    ]


def faults(data, x, equality, inequality):
    """What is wrong in the user's units, in fractions, each with the sum of the |terms| that it is a share of."""
    P, q, A, b, F, g, x, equality, inequality = exactly(*data, x, equality, inequality)
    for row, side in zip(A, b, strict=True):
        yield terms_of(row, x, [-side])
    for row, side in zip(F, g, strict=True):
        wrong, size = terms_of(row, x, [-side])
        yield max(wrong, 0), size
    for j, slope in enumerate(q):
        columns = [row[j] for row in A], [row[j] for row in F]
        yield terms_of(P[j] + columns[0] + columns[1], x + equality + inequality, [slope])
    slack = [side - terms_of(row, x, [])[0] for row, side in zip(F, g, strict=True)]
    sizes = [terms_of(u, v, [])[1] for u, v in ((q, x), (b, equality), (g, inequality))]
    sizes += [abs(x[j]) * terms_of(P[j], x, [])[1] for j in range(len(x))]
    yield terms_of(inequality, slack, [])[0], sum(sizes)
    yield from ((-min(u, 0), Fraction(0)) for u in inequality)


def terms_of(row, x, others):
    terms = [a * b for a, b in zip(row, x, strict=True)] + others
    return sum(terms, Fraction(0)), sum(map(abs, terms), Fraction(0))


@pytest.mark.parametrize("seed", [*range(20), 287, 298, 303, 347, 360, 629, 652])
def test_optimal_is_said_of_what_is_optimal_in_the_units_of_the_user(seed):
    """Rows, gradient, signs and gap hold to 1e-6 of their terms, whatever the units; judged in fractions."""
    P, q, A, b, F, g = data = a_wild_program(seed)
    rows = {"A": A, "b": b} if b.size else {}
    rows |= {"G": F, "h": g} if g.size else {}
    found = icp.solve_qp(P, q, **rows, time_limit=2.0, raise_on_failure=False)
    if found.solved:
        for wrong, size in faults(data, found.x, found.y, found.z):
            assert abs(wrong) <= 1e-6 * size


@pytest.mark.parametrize("exponent", [0, 20, 60, 100])
def test_a_row_of_small_terms_hides_no_gradient(exponent):
    """It is unbounded along the first unknown, whatever the units of the second one and of the first row are."""
    a, b = 4.0**exponent, 2.0**exponent
    G = [[-a, 0.0, -2 * a], [-2.0, -2 * b, 2.0]]
    low = [-2.0, -2 / b, -np.inf]
    found = icp.solve_qp(np.zeros((3, 3)), [-1.0, b, 0.0], G, [-2 * a, -1.0], lb=low, raise_on_failure=False)
    assert not found.solved


@pytest.mark.parametrize("unit", [1.0, 1e-13, 1e-27])
def test_an_entry_that_is_rounding_beside_others_hides_no_violation(unit):
    """u = x_0/1e8 = 1 and v = 1e8 x_1 <= 2, but 2u - v <= -1: infeasible, however small the unit of that row is."""
    rows = {"G": [[2e-8 * unit, -1e8 * unit]], "h": [-unit], "A": [[1e-8, 0]], "b": [1]}
    assert not icp.solve_qp(np.zeros((2, 2)), [1e-8, 0], **rows, ub=[np.inf, 2e-8], raise_on_failure=False).solved


def a_program_of_rank_1(seed, scale):
    """A degenerate program in whole numbers that x solves, its objective times `scale`."""
    random = np.random.default_rng(seed)

    def rows(count):
        return random.integers(-3, 4, (count, 150)) * (random.random((count, 150)) < 0.05) * 1.0

    v, G, A = rows(1), rows(60), rows(25)
    x = random.integers(-2, 3, 150) * 1.0
    weights = random.integers(0, 3, 60) * (random.random(60) < 0.5) * 1.0
    y = random.integers(-2, 3, 25) * 1.0
    kind = random.integers(0, 5, 150)
    low = np.where((kind == 0) | (kind == 3), x, np.where(kind == 2, x - 1, -np.inf))
    high = np.where((kind == 1) | (kind == 3), x, np.where(kind == 2, x + 1, np.inf))
    bounds = np.where(kind == 0, -1.0, np.where(kind == 1, 1.0, 0.0)) * (random.random(150) < 0.5)
    P = v.T @ v
    q = -(P @ x + G.T @ weights + A.T @ y + bounds)
    h = G @ x + np.where(weights > 0, 0, random.integers(0, 3, 60))
    return x, (scale * P, scale * q, G, h, A, A @ x, low, high)


@settings(max_examples=40)
@given(SEEDS, st.booleans(), st.integers(-40, 40), st.integers(-20, 20), st.integers(0, 6))
def test_units_of_the_objective_the_unknowns_and_the_rows_change_no_answer(seed, linear, objective, unknowns, spread):
    x, (P, q, G, h, A, b, low, high) = a_program_of_rank_1(seed, 1.0)
    if linear:
        q += P @ x
        P *= 0.0
    value = 0.5 * x @ P @ x + q @ x
    random = np.random.default_rng(seed)
    u, of_G, of_A = (2.0 ** random.integers(-spread, spread + 1, v.size) for v in (x, h, b))
    u *= 2.0**unknowns
    t = 2.0**objective
    rows = of_G[:, None] * G * u, of_G * h, of_A[:, None] * A * u, of_A * b
    found = icp.solve_qp(t * u * P * u[:, None], t * u * q, *rows, low / u, high / u)
    assert found.objective / t == pytest.approx(value, rel=1e-8, abs=1e-8)
    assert (G @ (found.x * u) <= h + 1e-6).all()


@pytest.mark.parametrize("seed", range(4))
def test_a_start_takes_no_more_steps_than_none(seed):
    x, (P, q, G, h, *others) = a_program_of_rank_1(seed, 1.0)
    h = h + 1e-3 * np.random.default_rng(seed).random(h.size)
    cold = icp.solve_qp(P, q, G, h, *others)
    warm = icp.solve_qp(P, q, G, h, *others, initvals=x)
    assert warm.solved
    assert warm.iterations <= cold.iterations


@pytest.mark.parametrize("seed", range(4))
def test_a_start_next_to_the_solution_takes_no_step(seed):
    """As the answer of another solver is, which is not on the bounds themselves."""
    n = 40
    random = np.random.default_rng(seed)
    program = np.diag(1.0 + random.random(n)), random.normal(size=n), None, None, np.ones((1, n)), [1.0], 0.0
    x = icp.solve_qp(*program).x
    warm = icp.solve_qp(*program, initvals=x + 1e-9 * random.random(n))
    assert warm.solved
    assert warm.iterations == 0


@pytest.mark.parametrize("last", [1.0, 2.0])
def test_a_program_whose_solution_is_known_is_never_called_infeasible(last):
    """x_i = 2^i is exact in floats, and its multipliers are: what is no solution up to rounding proves nothing."""
    m = 50
    G = sp.diags_array([np.full(m - 1, 2.0), np.full(m - 1, -1.0)], offsets=[0, 1], shape=(m - 1, m))
    low, high = np.full(m, -np.inf), np.full(m, np.inf)
    low[0], high[-1] = 1.0, last * 2.0 ** (m - 1)
    program = np.zeros((m, m)), np.ones(m), G, np.zeros(m - 1), None, None, low, high
    found = icp.solve_qp(*program, raise_on_failure=False, time_limit=20.0)
    assert found.status in ("optimal", "optimal_inaccurate", "solver_error")


def test_a_row_without_a_side_leaves_the_others_as_they_are():
    """A product by which it was emptied left the entries of rows in another order than their columns."""
    found = icp.solve_qp(np.eye(2), [0.0, 0.0], [[1.0, 3.0], [1.0, 1.0]], [-3.0, np.inf])
    assert found.x == pytest.approx([-0.3, -0.9])


def test_an_answer_that_leaves_the_range_of_floats_is_not_optimal():
    for P, q in ((1e-200, -1e150), (1e200, 1e-200)):
        assert icp.solve_qp([[P]], [q], raise_on_failure=False).status == "solver_error"


@pytest.mark.parametrize("infinite", [1e12, 1e15, 1e20, 1e30])
def test_bounds_that_stand_for_none_do_not_set_the_units(infinite):
    G, h = [[2.0, 0.0], [3.0, 3.0], [-2.0, 3.0]], [-2.0, -2.0, 1.0]
    found = icp.solve_qp(np.zeros((2, 2)), [-3.0, -1.0], G, h, lb=-infinite, ub=infinite)
    assert found.objective == pytest.approx(10 / 3)


def test_a_proof_is_one_in_the_units_of_the_user():
    rows = {"G": [[1e3, 1e3], [-7e-3, -7e-3]], "h": [1.0, -1.0]}
    found = icp.solve_qp(np.eye(2), [1.0, 1.0], **rows, raise_on_failure=False)
    assert found.status == "infeasible"
    assert "7e-06 times row 0 of G and 1 times row 1 of G" in found.message


def test_a_contradiction_names_the_rows_of_the_user():
    """The row with one entry becomes a bound, and the others keep their numbers."""
    rows = {"A": [[1, 1, 1], [1, 2, 0]], "b": [1, 2], "G": [[1, 0, 0], [0, 1, 1], [0, -1, -1]], "h": [9, 1, -2]}
    found = icp.solve_qp(np.eye(3), np.ones(3), **rows, raise_on_failure=False)
    assert "the sum of 1 times row 1 of G and 1 times row 2 of G exceeds" in found.message
    assert "wherever lb <= x <= ub and the rows of G with one entry hold" in found.message


@pytest.mark.parametrize(
    ("program", "words"),
    [
        ({"lb": 1.0, "ub": 0.0}, "x[0] >= 1.0 by lb and x[0] <= 0.0 by ub exclude each other"),
        ({"lb": 1e308, "ub": -1e308}, "x[0] >= 1e+308 by lb and x[0] <= -1e+308 by ub exclude each other"),
        ({"lb": 0.0, "G": [[2.0], [1.0]], "h": [-4.0, 5.0]}, "x[0] >= 0.0 by lb and x[0] <= -2.0 by row 0 of G"),
        ({"G": [[1.0], [-2.0]], "h": [1.0, -4.0]}, "x[0] >= 2.0 by row 1 of G and x[0] <= 1.0 by row 0 of G"),
        ({"A": [[3.0], [1.0]], "b": [-2.0, -1.0]}, "the sum of -1/3 times row 0 of A and 1 times row 1 of A exceeds"),
    ],
)
def test_what_is_said_to_be_proved_is_true_and_names_what_it_is_of(program, words):
    found = icp.solve_qp([[1.0]], [0.0], **program, raise_on_failure=False)
    assert found.status == "infeasible"
    assert words in found.message


@pytest.mark.parametrize("entry", [-1e-200, 1e-200])
def test_a_row_whose_bound_is_no_float_remains_a_row(entry):
    found = icp.solve_qp([[1.0]], [0.0], G=[[entry], [-1.0], [1.0]], h=[-1e200, 1.0, 1.0], raise_on_failure=False)
    assert found.status in ("infeasible", "solver_error")


def test_whether_a_matrix_next_to_over_or_underflow_is_semidefinite_is_found():
    with np.errstate(all="raise"):
        assert icp.solve_qp([[1e308]], [1e308], lb=-1e308).x == -1.0
        for P in ([[1e308, 1.5e308], [1.5e308, 1e308]], [[1.0, 1e308], [-1e308, 1.0]], [[0, 5e-324], [5e-324, 0]]):
            with pytest.raises(icp.InputError, match=r"semidefinite|symmetric"):
                icp.solve_qp(P, [0.0, 0.0])


def test_labels_of_pandas_that_differ_are_named():
    pd = pytest.importorskip("pandas")
    P = pd.DataFrame(np.diag([2.0, 20.0]), index=list("ab"), columns=list("ab"))
    q = pd.Series([-2.0, -20.0], index=list("ab"))
    G = pd.DataFrame([[1.0, 1.0]], index=["sum"], columns=list("ab"))
    h = pd.Series([1.0], index=["sum"])
    assert icp.solve_qp(P, q, G, h, lb=q).x.sum() == pytest.approx(1.0)
    for name, wrong in (
        ("q.index", {"q": q[::-1]}),
        ("lb.index", {"lb": q[::-1]}),
        ("initvals.index", {"initvals": q[::-1]}),
        ("G.columns", {"G": G[["b", "a"]]}),
        ("G.index", {"G": q[::-1]}),
        ("h.index", {"h": pd.Series([1.0], index=["limit"])}),
    ):
        with pytest.raises(icp.InputError, match=f"{name} has other labels"):
            icp.solve_qp(**{"P": P, "q": q, "G": G, "h": h} | wrong)
    assert icp.solve_qp(P, q, np.abs(q), h).x.size == 2  # a series is one row, which has no name
    for B in (G, q):
        with pytest.raises(icp.InputError, match="has other labels than B"):
            icp.solve_lsq(B, [1.0], lb=q[::-1])


def test_a_start_that_leaves_the_range_of_floats_is_no_error():
    rows = {"G": [[1e10, 1e-5], [1.0, 1.0]], "h": [1.0, 3.0]}
    found = icp.solve_qp(1e-10 * np.eye(2), [-2.0, 1e10], **rows, initvals=[1e308, -1e308], raise_on_failure=False)
    assert found.status in ("optimal", "unbounded", "unbounded_inaccurate", "solver_error")


@pytest.mark.parametrize(("bound", "wrong"), [(1e13, 1e-3), (1e9, 1e-7)])
def test_a_large_unknown_excuses_no_rows_that_it_is_not_in(bound, wrong):
    rows = {"A": [[1.0, 1.0, 0.0], [1.0, 1.0, 0.0]], "b": [1.0, 1.0 + wrong]}
    sides = {"lb": [-9.0, -9.0, 0.0], "ub": [9.0, 9.0, bound]}
    found = icp.solve_qp(np.zeros((3, 3)), [0.0, 0.0, -1.0], **rows, **sides, raise_on_failure=False)
    assert found.status.startswith("infeasible")


@pytest.mark.parametrize(
    ("large", "rows", "wrong"),
    [
        (1e10, {"A": [[1, 1, 0, 0], [0, 1, -1, -1]], "G": [[0, 0, 1, 1], [0, -1, 0, 0]], "h": [1, -1], "lb": 0}, 4e-6),
        (1e8, {"A": [[1, 1, 1]], "G": [[0, 1, 1], [0, -1, -1]], "h": [0, 0], "lb": [0, 0, -5e-8]}, 2e-7),
        (1e15, {"A": [[1, 1, 1]], "G": [[0, 1, 1], [0, -1, -1]], "h": [1, -1]}, 0.5),
    ],
)
def test_rows_beside_a_large_unknown_contradict_each_other_as_without_it(large, rows, wrong):
    """The unknown x_0 of row 0 of A; the last row of G is tightened. The program is feasible before that."""
    n = len(rows["A"][0])
    rows = rows | {"b": [large, 0][: len(rows["A"])]}
    tightened = rows | {"h": np.array(rows["h"]) - [0, wrong]}
    assert icp.solve_qp(np.eye(n), np.zeros(n), **rows).solved
    assert icp.solve_qp(np.eye(n), np.zeros(n), **tightened, raise_on_failure=False).status == "infeasible"


@pytest.mark.parametrize(("wrong", "tolerance"), [(2e-9, 1e-9), (1e-4, 1e-3), (0.1, 0.2)])
def test_what_is_feasible_to_the_tolerance_only_is_not_unbounded(wrong, tolerance):
    rows = {"G": [[1, 1, 0], [-1, -1, 0]], "h": [1, -1 - wrong]}
    found = icp.solve_qp(np.zeros((3, 3)), [0, 0, -1], **rows, tolerance=tolerance, raise_on_failure=False)
    assert found.status == "infeasible"


@pytest.mark.parametrize("bound", [1e6, 1e9, 1e12])
def test_a_loose_bound_hides_no_contradiction(bound):
    G, h = [[5.0, -3.0], [-1.0, 3.0], [-1.0, -7.0]], [-2.0, -5.0, 7.0]
    found = icp.solve_qp(np.zeros((2, 2)), [0.0, -2.0], G, h, ub=[bound, np.inf], raise_on_failure=False)
    assert found.status == "infeasible"


def test_terms_that_are_all_zero_share_nothing():
    """The gap is no share of terms where x, g and the sides add nothing."""
    solution = icp.solve_lsq([[2e-7], [0.0]], [1.0, 1000.0], [1e6], [1e6 + 1e-7])
    assert solution.x[0] == pytest.approx(1e6)


@pytest.mark.parametrize(("assets", "first"), [(40, "Lemke"), (120, "Lemke"), (1200, "Interior")])
def test_a_program_is_pivoted_where_that_costs_less_than_interior_steps(assets, first, caplog):
    """A dense portfolio of some assets; the conditions of a thin chain of many have sparse factors."""
    random = np.random.default_rng(1)
    if first == "Lemke":
        returns = random.normal(size=(10, assets))
        program = {
            "P": returns.T @ returns,
            "q": -random.random(assets),
            "A": np.ones((1, assets)),
            "b": [1.0],
            "lb": 0,
        }
    else:
        rise = sp.diags_array([1.0, -1.0], offsets=[0, 1], shape=(assets - 1, assets))
        program = {"P": sp.eye_array(assets), "q": random.normal(size=assets), "G": rise, "h": np.zeros(assets - 1)}
    with caplog.at_level("INFO", "icpmodel"):
        assert icp.solve_qp(**program).solved
    began = [record.getMessage() for record in caplog.records if "begins" in record.getMessage()]
    assert len(began) == 1
    assert f"{first}() begins" in began[0]


class CountingJudge(Judge):
    calls = 0

    def violation(self, *args):
        self.calls += 1
        return super().violation(*args)


def test_sweeps_are_judged_no_more_often_than_they_cost():
    """To judge an iterate costs some sweeps."""
    path = sp.diags_array([-np.ones(29), 2 * np.ones(30), -np.ones(29)], offsets=[-1, 0, 1])
    grid = sp.kron(path, sp.eye_array(30)) + sp.kron(sp.eye_array(30), path) + 0.02 * sp.eye_array(900)
    q = np.sin(np.arange(900.0) ** 2)
    run = ProgramRun(read((grid, q, None, None, None, None, 0.0, 1.0), "Pq"), 1e-9)
    run.judge = CountingJudge(run.problem, run.conditions.is_x)
    assert run.verdict(None)[0] == "optimal"
    assert run.judge.calls < run.iterations / 3
