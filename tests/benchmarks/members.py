"""IT, CPU (s) and RES of the members."""

import json
from functools import partial

import numpy as np

import icpmodel as icp
from icpmodel.study.cases import uncached_copy

from .harness import run, scene, time_calls, timer

#: Bai's two matrices without ψ, with an affine and with an elementwise one, hard and easy
PROBLEMS = tuple(
    f"{problem},mu={mu}"
    for problem in (
        "bai-symmetric",
        "bai-nonsymmetric",
        "manufactured-affine",
        "manufactured-affine,skew=0.5",
        "manufactured-elementwise",
        "manufactured-elementwise,skew=0.5",
    )
    for mu in (0, 4)
)
#: all that the paper prints, and the method that its kind is compared with
MEMBERS = ("mms", "mnmod", "mnmmod,theta1=4", "mnmj", "mnmgs", "mnmsor,theta1=1.2", "mnmaor,theta1=1.2,theta2=1.5")
#: a run that needs more is given up
MOST = 20_000


def table(
    scenes=PROBLEMS, sides=(10, 20, 30, 40, 50, 60), methods=MEMBERS, phis=(0.0, -0.5, 0.5), atol=1e-5, repeats=3
):
    """IT, CPU and RES of the members of the family on the test problems of the literature, without ψ and with one.

    Each runs from z⁰ = (1, 0, 1, 0, …) until RES = Res(z) ≤ `atol`. IT is the number of steps, CPU the seconds of the
    whole solve, the median of runs in turn; "-" where 20 000 steps do not do, or where the run is seen to fail.

    Parameters
    ----------
    scenes : NAME or NAME,PARAMETER=NUMBER, on a square grid
    sides : m of the grids, n = m²
    methods : NAME or NAME,OPTION=NUMBER
    phis : numbers f; a member named without phi is run with φ = fI for each
    atol : where to stop
    repeats : rounds of timings

    References
    ----------
    Bai, Numer. Linear Algebra Appl. 17 (2010), for the problems with ψ = 0, the start and `atol`.
    """
    yield "problem", "method", "", *(f"m = {m}" for m in sides)
    labels, members = zip(*named(methods, phis), strict=True)
    for text in scenes:
        columns = [column(text, m, members, atol, repeats) for m in sides]
        for label, *cells in zip(labels, *columns, strict=True):
            for quantity, *values in zip(("IT", "CPU", "RES"), *cells, strict=True):
                yield text, label, quantity, *values


def named(methods, phis):
    """(label, method), each with every φ that it may have."""
    for text in methods:
        takes_phi = hasattr(method_of(text), "phi") and ",phi=" not in text
        for phi in phis if takes_phi else [0]:
            full = f"{text},phi={phi:g}" if phi else text
            method = method_of(full)
            _, *options = full.split(",")
            yield type(method).__name__ + (f"({', '.join(options)})" if options else ""), method


def method_of(text):
    name, *pairs = text.split(",")
    return icp.methods.named(
        name, **{key: json.loads(value) for key, _, value in (one.partition("=") for one in pairs)}
    )


def column(text, m, methods, atol, repeats):
    """(IT, CPU, RES) of each method; a first run, which compiles, tells IT and RES."""
    problem = scene(text, m * m).problem
    z0 = np.arange(1, problem.n + 1) % 2.0
    limits = {"z0": z0, "atol": atol, "rtol": 0.0, "max_iter": MOST}
    found, calls = {}, {}
    for k, method in enumerate(methods):
        if method.why_not(problem) is None:
            _, found[k] = run(problem, method, **limits)
            if found[k].solved:
                calls[k] = timer(partial(run, method=method, **limits), partial(uncached_copy, problem))
    taken = time_calls(calls, repeats, warm=False)
    cells = {k: (found[k].iterations, float(np.median(taken[k])), found[k].residual) for k in calls}
    return [cells.get(k, (None, None, None)) for k in range(len(methods))]
