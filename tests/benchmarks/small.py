"""Small LCPs against OSQP."""

import contextlib
import io

import numpy as np
import scipy.sparse as sp

import icpmodel as icp

from .harness import pair, timer

#: its defaults, and what it takes to come near to the residual of a pivoting method
SETTINGS = {
    "defaults": {},
    "eps = 1e-8, polishing": {"eps_abs": 1e-8, "eps_rel": 1e-8, "max_iter": 100_000, "polishing": True},
}


def table(n=16, k=10_000, repeats=15):
    """Small LCPs against OSQP, one at a time and many with one A, timed in turn.

    A = BBᵀ + I, B and q normal. "one": `ICP(A, q).solve()` against set-up and solve by OSQP, for 20 problems; the
    sparse arrays of OSQP are made before. "with one A": `solve_many` against a loop over one OSQP object.

    Parameters
    ----------
    n : unknowns
    k : right-hand sides of one A
    repeats : pairs of timings
    """
    yield "problems", "n", "OSQP with", "ours, us", "OSQP, us", "ratio", "our residual", "residual of OSQP"
    random = np.random.default_rng(0)
    factors = [(random.normal(size=(n, n)), random.normal(size=n)) for _ in range(20)]
    problems = [(B @ B.T + np.eye(n), q) for B, q in factors]
    A = problems[0][0]
    Q = random.normal(size=(k, n))
    many = [(A, q) for q in Q]

    def each():
        return [icp.ICP(A, q).solve().z for A, q in problems]

    def together():
        return icp.solve_many(A, Q).Z

    kinds = {"one, arrays ready": (problems, each, osqp_each), f"{k} with one A": (many, together, osqp_in_turn)}
    for name, (given, ours, other) in kinds.items():
        for words, settings in SETTINGS.items():
            with contextlib.redirect_stdout(io.StringIO()):  # OSQP prints about polishing whatever one asks
                theirs = other([arrays(A, q) for A, q in given[: len(problems)]], Q, settings)
                times = pair(timer(ours), timer(theirs), repeats, unit=1e-6 * len(given))
                residuals = worst(given, ours()), worst(given, theirs())
            yield name, n, words, *times[:3], *residuals


def arrays(A, q):
    n = q.size
    return sp.csc_matrix(np.triu(A)), q, sp.identity(n, format="csc"), np.zeros(n), np.full(n, np.inf)


def model(given, settings):
    import osqp

    made = osqp.OSQP()
    made.setup(*given, verbose=False, **settings)
    return made


def osqp_each(given, Q, settings):
    return lambda: [model(one, settings).solve(raise_error=False).x for one in given]


def osqp_in_turn(given, Q, settings):
    def run():
        made = model(given[0], settings)
        found = []
        for q in Q:
            made.update(q=q)
            found.append(made.solve(raise_error=False).x)
        return found

    return run


def worst(problems, answers):
    """The largest residual."""
    return max(float(np.linalg.norm(np.minimum(A @ z + q, z))) for (A, q), z in zip(problems, answers, strict=True))
