"""No false claim, whatever the problem: drawn by Hypothesis, judged in fractions.

`python tests/fuzz --minutes 10 --seed 1` draws more of them.
"""

import math
import os
import time
from contextlib import suppress

import cvxpy as cp
import numpy as np
import pyomo.environ as pyo
import pytest
from exact import ExactProblem
from hypothesis import HealthCheck, given, note, settings
from hypothesis import strategies as st
from judge import COUNTS, false_bound, false_claims, false_model, false_program, false_status, worse_than_seen
from nonlinear import ExactNonlinear, false_proof, nonlinear
from pyomo.mpec import Complementarity, complements
from strategies import PROVED, Data, data, options, planted, programs, scales

import icpmodel as icp
import icpmodel.modelling.pyomo

#: the short run draws the same examples every time
_EXAMPLES = os.environ.get("FUZZ_EXAMPLES")
law = settings(
    max_examples=int(_EXAMPLES or 40),
    derandomize=_EXAMPLES is None,
    database=None,
    deadline=None,
    suppress_health_check=list(HealthCheck),
    print_blob=False,
)
AFFINE = ("constant", "affine")
#: where a bound is asked for: so far from the answer
OFF = (0.0, 1e-200, 1e-9, 1e-3, 1e9, 1e150)


def check(law, drawn, lies, solved):
    """Count, and fail with the code of the problem."""
    lies = list(lies)
    COUNTS.update([(law, "examples"), *[(law, "solved")] * bool(solved), *{(law, kind) for kind, _ in lies}])
    note(drawn.code() if hasattr(drawn, "code") else repr(drawn))
    assert lies == []


def problem_of(drawn):
    """The problem, None where its data are refused."""
    with suppress(icp.IcpError):
        return drawn.problem()
    return None


def lateness(limit, begin):
    seconds = min(time.perf_counter() - begin[0], time.process_time() - begin[1])
    return [("late", f"{seconds:.2g} s, time_limit = {limit:g}")] if seconds > 1.1 * limit + 0.2 else []


def solved_and_judged(drawn, asked, seen, exact_of):
    """(exact problem, answer, what is false of it); None where the data or the options are refused."""
    problem, (method, chosen), path = problem_of(drawn), asked, []
    if problem is None:
        return None
    callback = {"callback": lambda state: path.append(state.z.copy())} if seen else {}

    def solved():
        begin = time.perf_counter(), time.process_time()
        answer = problem.solve(method, raise_on_failure=False, **chosen, **callback)
        return answer, lateness(chosen.get("time_limit", math.inf), begin)

    try:
        answer, late = solved()
        if late:  # again, now that all loops are compiled
            path.clear()
            answer, late = solved()
    except icp.IcpError:
        return None
    exact = exact_of(problem)
    lies = [*late, *false_claims(drawn, exact, problem, answer, chosen)]
    # Res ≤ atol may hold where Res_D is not the least
    if seen and not (chosen.get("atol") and answer.status is icp.Status.SOLVED):
        lies += worse_than_seen(exact, problem, answer.z, path)
    return exact, answer, lies


@law
@given(drawn=st.one_of(data(), planted(), data(largest=13, kinds=AFFINE)), asked=options(), seen=st.booleans())
def test_no_answer_of_solve_claims_what_is_false(drawn, asked, seen):
    if (found := solved_and_judged(drawn, asked, seen, ExactProblem)) is not None:
        _, answer, lies = found
        check("solve", drawn, lies, answer.solved)


@law
@given(drawn=nonlinear(), asked=options(), seen=st.booleans(), start=st.booleans(), off=st.sampled_from(OFF))
def test_no_answer_claims_what_is_false_where_p_is_nonlinear(drawn, asked, seen, start, off):
    method, chosen = asked
    chosen |= {"z0": np.array(drawn.b) + 1.5 * np.cos(np.arange(len(drawn.b)))} if start else {}
    if (found := solved_and_judged(drawn, (method, chosen), seen, ExactNonlinear)) is not None:
        exact, answer, lies = found
        z = answer.z + off * np.cos(3 * np.arange(exact.n))
        with suppress(icp.MapError):
            lies += false_proof(drawn, exact, z, icp.error_bound(exact.problem, z))
        check("nonlinear", drawn, lies, answer.solved)


@law
@given(
    drawn=data(largest=6, matrices=PROVED, kinds=AFFINE),
    off=st.sampled_from(OFF),
    kind=st.sampled_from([{}, {"sharp": True}, {"sharp": False}, {"rigorous": True}]),
)
def test_bounds_and_uniqueness_are_true_at_any_z(drawn, off, kind):
    problem = problem_of(drawn)
    if problem is None:
        return
    with suppress(icp.IcpError):
        answer = problem.solve(raise_on_failure=False, max_iter=100, time_limit=1.0)
        z = answer.z + off * np.cos(3 * np.arange(problem.n))
        bound = icp.error_bound(problem, z, **kind)
        check("bounds", drawn, false_bound(ExactProblem(problem), z, bound), answer.solved)


@law
@given(drawn=st.one_of(data(), planted()), tolerance=st.sampled_from([{}, {"rtol": 1e-5}, {"atol": 1e-9}]))
def test_no_answer_of_solve_many_claims_what_is_false(drawn, tolerance):
    problem = problem_of(drawn)
    if problem is None:
        return
    with suppress(icp.IcpError):
        Q = np.stack([problem.q, -problem.q])
        upper = {} if problem.upper is None else {"upper": problem.upper}
        psi = problem.psi if problem.upper is None else problem.psi.lower
        many = icp.solve_many(problem.A, Q, psi, **upper, **tolerance, time_limit=0.1, raise_on_failure=False)
        lies = []
        for q, status, z in zip(Q, many.statuses, many.Z, strict=True):
            one = problem.with_q(q)
            known = drawn if q is Q[0] else Data(*[()] * 2, "constant", (), ())
            lies += false_status(known, ExactProblem(one), one, status, z, tolerance)
        check("solve_many", drawn, lies, many.statuses[0] is icp.Status.SOLVED)


@pytest.mark.filterwarnings("ignore")
@law
@given(program=programs(), front=st.sampled_from(["solve_qp", "cvxpy"]))
def test_no_program_is_called_optimal_infeasible_or_unbounded_falsely(program, front):
    P, q, G, h = (np.array(one) for one in (program.P, program.q, program.G, program.h))
    e = program.equal
    x, status = None, ""
    if front == "solve_qp":
        with suppress(icp.IcpError):
            found = icp.solve_qp(P, q, G[e:], h[e:], G[:e], h[:e], raise_on_failure=False)
            x, status = found.x, found.status
    else:
        unknown = cp.Variable(len(q))
        rows = [G[:e] @ unknown == h[:e]] * (e > 0) + [G[e:] @ unknown <= h[e:]] * (e < len(h))
        model = cp.Problem(cp.Minimize(0.5 * cp.quad_form(unknown, cp.psd_wrap(P)) + q @ unknown), rows)
        with suppress(cp.SolverError):
            model.solve(solver=icp.cvxpy_solver())
            x, status = unknown.value, model.status
    check("programs", program, false_program(program, status, x), status == "optimal")


@law
@given(
    drawn=data(kinds=("constant",), scaled=False),
    factors=st.tuples(*[scales(4, (-6, 0, 6))] * 2),
    front=st.sampled_from(["pyomo", "cvxpy"]),
)
def test_no_model_is_called_optimal_falsely(drawn, factors, front):
    if drawn.upper or problem_of(drawn) is None:
        return
    of_p, of_r = (one[: len(drawn.q)] for one in factors)
    A, q, c = of_p[:, None] * drawn.A, of_p * drawn.q, np.array(drawn.c)
    with suppress(icp.IcpError, cp.SolverError):
        x = (pyomo_answer if front == "pyomo" else cvxpy_answer)(A, q, of_r, c)
        lies = [] if x is None else false_model(A, q, of_r, c, x)
        check(front, drawn, lies, x is not None)


def pyomo_answer(A, q, of_r, c):
    """x of Ax + q ⟂ of_r·(x − c), None where it is not called optimal."""
    model, n = pyo.ConcreteModel(), len(q)
    model.x = pyo.Var(range(n))

    def rule(m, i):
        p = sum(A[i, j] * m.x[j] for j in range(n)) + q[i]
        return complements(p == 0, m.x[i]) if c[i] == -np.inf else complements(p >= 0, of_r[i] * (m.x[i] - c[i]) >= 0)

    model.rows = Complementarity(range(n), rule=rule)
    answer = pyo.SolverFactory("icpmodel").solve(
        model, load_solutions=False, raise_exception_on_nonoptimal_result=False, timelimit=1
    )
    if str(answer.solver.termination_condition) != "optimal":
        return None
    model.solutions.load_from(answer)
    return [model.x[i].value for i in range(n)]


def cvxpy_answer(A, q, of_r, c):
    """x of Ax + q ⟂ of_r·(x − c), None where it is not called optimal."""
    x, held = cp.Variable(len(q)), np.isfinite(c)
    p = A @ x + q
    rows = [p[~held] == 0] * bool((~held).any())
    rows += [icp.complements(p[held], cp.multiply(of_r, x)[held] - (of_r * c)[held])] * bool(held.any())
    problem = icp.Problem(*rows)
    problem.solve(time_limit=1.0)
    return x.value if problem.status == "optimal" else None


@law
@given(
    drawn=data(kinds=AFFINE, scaled=False),
    rows=scales(4, (-40, -17, 0, 13, 40), base=2.0),
    unit=st.sampled_from([2.0**-40, 1.0, 2.0**30]),
)
def test_units_of_rows_and_of_z_do_not_change_the_verdict(drawn, rows, unit):
    """By powers of two, as a proof may hold of the exact numbers alone."""
    problem = problem_of(drawn)
    if problem is None:
        return
    other = problem_of(drawn.scaled(rows[: problem.n], unit))
    one, two = (each.solve(raise_on_failure=False) for each in (problem, other))
    # how a run fails, and whether it comes across a proof, is up to the path
    same = one.solved is two.solved or beyond_rounding(one) or beyond_rounding(two)
    lies = [] if same else [("units", f"{one.status.value}, and scaled {two.status.value}")]
    if one.solved and two.solved and one.certificate.unique:
        # both are near the one solution, the closer the better its condition is
        allowed = 1e-6 * np.abs(one.z).max() + 1e-300
        allowed += errors(one) + errors(two) / unit
        if (np.abs(two.z / unit - one.z) > allowed).any():
            lies.append(("units", f"z = {one.z}, and scaled {two.z / unit}"))
    check("units", drawn, lies, one.solved)


def beyond_rounding(answer):
    """Whether the tolerance is less than what rounding makes of the residual: which iterate meets it is chance."""
    return answer.tolerance < answer.problem.rounding_of_residual(answer.z)


def errors(answer):
    """What the answer may be off in every entry, as far as that is known."""
    bound = answer.certificate.bound
    return np.zeros(answer.z.size) if bound.value is None else bound.componentwise
