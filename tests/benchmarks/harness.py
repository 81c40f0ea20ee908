"""What the benchmarks share: fresh problems, scenes by their text, one linear solve, and pairs of timings."""

import inspect
import time
from functools import partial

import numpy as np
import scipy.sparse as sp

import icpmodel as icp
from icpmodel.study.cases import uncached_copy
from icpmodel.study.timing import run_interleaved


def scene(text, n):
    """The scene NAME or NAME,PARAMETER=NUMBER with about `n` unknowns, if it has a size."""
    has_size = "n" in icp.scenes.parameters(text.partition(",")[0])
    return icp.scenes.scene(text, n if has_size else None)


def timer(call, prepare=None):
    """A timer of `call`, whose argument `prepare`, if given, makes before the clock starts.

    What it returns is freed at once: kept, it would make the next run pay for fresh memory.
    """

    def run():
        arguments = () if prepare is None else (prepare(),)
        start_time = time.perf_counter()
        call(*arguments)
        return time.perf_counter() - start_time

    return run


def on_new(problem, call):
    """A timed `call` of the problem, each time of a new object."""
    return timer(call, partial(uncached_copy, problem))


def time_calls(calls, rounds, warm=True):
    """The seconds of the `calls`, which return them, one for each round; if `warm` after a first run, which compiles
    and takes fresh memory."""
    if warm:
        for call in calls.values():
            call()
    runs = list(run_interleaved(calls, rounds))
    return {name: np.array([seconds for one, seconds in runs if one == name]) for name in calls}


def linear_solve(A, b):
    """Solve Ax = b to 1e-8 by PyAMG: Ruge–Stüben with CG, or BiCGSTAB where A is not symmetric, set-up included."""
    import pyamg

    symmetric = abs(A - A.T).sum() == 0
    hierarchy = pyamg.ruge_stuben_solver(sp.csr_matrix(A))
    return hierarchy.solve(b, tol=1e-8, maxiter=100, accel="cg" if symmetric else "bicgstab")


def pair(ours, other, repeats, unit=1.0):
    """The numbers of `compared` of two calls, timed in turn."""
    return compared(time_calls({"ours": ours, "other": other}, repeats), "ours", "other", unit)


def compared(taken, ours, other, unit=1.0):
    """Medians of two of the calls of `taken`, then the median, lowest and highest ratio, pair by pair."""
    ratios = taken[ours] / taken[other]
    medians = (float(np.median(taken[name])) / unit for name in (ours, other))
    return *medians, float(np.median(ratios)), float(ratios.min()), float(ratios.max())


def warm(call, times=5, seconds=0.2):
    """A timed `call`: the median of those in a row, so often and so long that its caches are warm."""

    def run():
        marks = [time.perf_counter()]
        while len(marks) <= times or marks[-1] - marks[0] < seconds:
            call()
            marks.append(time.perf_counter())
        return float(np.median(np.diff(marks)))

    return run


def relaxed(problem, omega):
    """MNMAOR with X = 2(D/ω − L) and Ω = (2 − ω)D."""
    share = 2.0 - omega
    theta1 = 1.0 / (2.0 / omega - share)
    return icp.MNMAOR(theta1=theta1, theta2=2.0 * theta1, phi2=share * problem.A.diagonal())


def affine(problem):
    """The problem on a square grid with a quarter of each of two neighbours added to its fixed obstacle."""
    m = int(np.sqrt(problem.n))
    G = sp.kron(sp.eye_array(m), sp.diags_array([0.25, 0.25], offsets=[-1, 1], shape=(m, m)))
    return problem.with_psi(icp.Affine(G, problem.psi.value(problem.q)))


def elementwise(problem, steep):
    """The problem with `steep`·sin(z_i) added to its fixed obstacle."""
    c = problem.psi.value(problem.q)
    psi = icp.Elementwise(lambda z: steep * np.sin(z), lambda z: steep * np.cos(z), lipschitz=steep, c=c)
    return problem.with_psi(psi)


def run(problem, method, **limits):
    """Seconds of one solve of a new object, by a method or a function that makes it of the problem; the solution."""
    new = uncached_copy(problem)
    begin = time.perf_counter()
    made = method(new) if inspect.isfunction(method) else method
    solution = new.solve(made, raise_on_failure=False, **limits)
    if solution.status is icp.Status.INTERRUPTED:
        raise KeyboardInterrupt
    return time.perf_counter() - begin, solution
