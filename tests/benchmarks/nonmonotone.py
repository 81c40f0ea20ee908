"""Problems that are neither monotone nor P, with a planted solution, against PATH."""

import time

import numpy as np

import icpmodel as icp

#: solved: the natural residual, in the units of z, is at most this share of the largest entry of q
SOLVED = 1e-6
#: what PATH solves where it runs at all
EASY = icp.solvers.Target(icp.ICP([[2.0]], [-1.0]))


def planted(seed, n):
    """A of whole numbers from −5 to 5 or normal, q = w − Az, half of z positive and w on the other half."""
    random = np.random.default_rng([seed, n])
    A = random.integers(-5, 6, (n, n)) if seed % 2 else random.normal(size=(n, n))
    positive = random.random(n) < 0.5
    z, w = np.where(positive, random.uniform(1, 5, n), 0.0), np.where(positive, 0.0, random.uniform(1, 5, n))
    return icp.ICP(A, w - A @ z)


def table(sizes=(4, 8, 12, 20, 30), count=20, limit=10.0, seed=1, methods=("solve()", "restarts", "enumerate", "milp")):
    """How many of `count` problems of each size are solved, by `solve()`, by its global methods alone, and by PATH.

    Each problem is given to all of them in turn. PATH comes with `pip install "icpmodel[path]"`; where it is not
    installed, or its licence has run out, there is no row of it.

    Parameters
    ----------
    sizes : unknowns
    count : problems of each size
    limit : seconds for one run
    seed : of the first problem of a size
    methods : "solve()" or names of methods
    """
    yield "n", "solver", "solved", "of", "median, s", "longest, s"
    path = icp.solvers.foreign_solvers()["path"]
    has_path = path.why_not(EASY) is None and icp.solvers.ask(path, EASY, 1e-8, limit).solved
    for n in sizes:
        problems = [planted(seed + k, n) for k in range(count)]
        runs = {name: own(name, limit) for name in methods}
        if has_path:
            runs["PATH"] = lambda problem: icp.solvers.ask(path, icp.solvers.Target(problem), 1e-8, limit).z
        found = {name: [] for name in runs if name in ("solve()", "PATH") or why_not(name, problems[0]) is None}
        for problem in problems:
            for name, results in found.items():
                begin = time.perf_counter()
                z = runs[name](problem)
                results.append((good(problem, z), time.perf_counter() - begin))
        for name, results in found.items():
            solved, seconds = zip(*results, strict=True)
            yield n, name, sum(solved), count, float(np.median(seconds)), max(seconds)


def why_not(name, problem):
    return icp.methods.named(name).why_not(problem)


def own(name, limit):
    method = None if name == "solve()" else name
    return lambda problem: problem.solve(method, time_limit=limit, raise_on_failure=False).z


def good(problem, z):
    """Whether `z` is a solution, by a judge that no solver has."""
    if z is None:
        return False
    residual = np.abs(np.minimum(problem.A @ z + problem.q, z)).max()
    return bool(residual <= SOLVED * np.abs(problem.q).max())
