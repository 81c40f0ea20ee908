"""Quadratic programs inside CVXPY."""

import numpy as np

import icpmodel as icp

from .harness import pair, timer


def table(size=200, repeats=15):
    """CVXPY's `solve` by `icp.cvxpy_solver()` and by the solver beside it, timed in turn.

    Support vector machines with 2½·`size` points and dense programs are built anew each time. Small programs with
    parameters are built once and solved again and again, with data that drift or are new. CVXPY's own work counts on
    both sides. The last column is the largest relative difference of the two values.

    Parameters
    ----------
    size : unknowns of the dense programs, with three times as many rows, and the other way round
    repeats : pairs of timings
    """
    yield "program", "against", "solve, s", "the other, s", "ratio", "lowest", "highest", "difference of values"
    for name, against, make in programs(size, np.random.default_rng(0)):
        calls, values = [], []
        for solver in (icp.cvxpy_solver(), against):
            seen = []
            values.append(seen)

            def solve(program, solver=solver, seen=seen):
                seen.append(program.solve(solver=solver))

            calls.append(timer(solve, make()))
        times = pair(*calls, repeats)
        off = max(abs(a - b) / max(abs(b), 1.0) for a, b in zip(*values, strict=True))
        yield name, against, *times, off


def programs(size, random):
    """Name, solver beside ours, and what makes the same sequence of programs again."""
    points = 5 * size // 2
    for features in (2, size // 10 or 1, size // 2):
        yield f"support vectors, {points} x {features}", "CLARABEL", support_vectors(points, features, random)
    for n, m in ((size, 3 * size), (3 * size, size)):
        yield f"dense, {n} x {m}", "CLARABEL", dense(n, m, random)
    for n in (5, 10, 30):
        for kind, drift in (("drift", 0.05), ("are new", 1.0)):
            yield f"again and again, {n} x {2 * n}, data {kind}", "OSQP", parametric(n, drift, random)


def support_vectors(points, features, random):
    import cvxpy as cp

    X = random.normal(size=(points, features))
    sides = np.sign(X @ random.normal(size=features) + 0.5 * random.normal(size=points))

    def program():
        w, b, hinge = cp.Variable(features), cp.Variable(), cp.Variable(points, nonneg=True)
        rows = [cp.multiply(sides, X @ w + b) >= 1 - hinge]
        return cp.Problem(cp.Minimize(0.5 * cp.sum_squares(w) + cp.sum(hinge)), rows)

    return lambda: program


def dense(n, m, random):
    import cvxpy as cp

    B, q, G, h = random.normal(size=(n, n)), random.normal(size=n), random.normal(size=(m, n)), random.random(m)

    def program():
        x = cp.Variable(n)
        objective = 0.5 * cp.quad_form(x, cp.psd_wrap(B @ B.T / n)) + q @ x
        return cp.Problem(cp.Minimize(objective), [G @ x <= h])

    return lambda: program


def parametric(n, drift, random):
    import cvxpy as cp

    B, G, seed = random.normal(size=(n, n)), random.normal(size=(2 * n, n)), int(random.integers(2**31))
    L = np.linalg.cholesky(B @ B.T / n + 0.1 * np.eye(n))

    def make():
        x, q, h = cp.Variable(n), cp.Parameter(n), cp.Parameter(2 * n)
        data = np.random.default_rng(seed)
        program = cp.Problem(cp.Minimize(0.5 * cp.sum_squares(L.T @ x) + q @ x), [G @ x <= h])
        now = [data.normal(size=n), data.random(2 * n)]

        def following():
            new = data.normal(size=n), data.random(2 * n)
            now[:] = [(1.0 - drift) * a + drift * b for a, b in zip(now, new, strict=True)]
            q.value, h.value = now
            return program

        return following

    return make
