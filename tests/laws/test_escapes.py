"""No foreign exception leaves the package, whatever a user has set for his process, hands in, or presses."""

import ctypes
import os
import resource
import runpy
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from known_answers import attempt

import icpmodel as icp
from icpmodel.numerics.kernels import compiled

RNG = np.random.default_rng(0)
SMALL = icp.ICP(3 * np.eye(40) + 0.1 * RNG.normal(size=(40, 40)), RNG.normal(size=40))
HUGE = 10**6000  # Python does not print it
BAND = icp.scenes.bearing(n=100).problem


@pytest.mark.parametrize(
    ("size", "psi"),
    [(1e-300, 0.0), (1e-160, icp.Affine(np.eye(4) / 4, -0.1)), (1e160, icp.Elementwise(np.tanh, lipschitz=1))],
)
def test_what_a_user_asks_of_numpy_for_himself_is_not_asked_of_the_package(size, psi):
    rng = np.random.default_rng(1)
    A, q = 4 * np.eye(4) + rng.normal(size=(4, 4)), rng.normal(size=4)
    with np.errstate(all="raise"):
        for problem in (icp.ICP(size * A, q, psi), icp.ICP(A, size * q, psi)):
            solution = attempt(problem)
            told = str(solution), str(solution.polish()), str(problem.explain())
            told += (str(problem.crosscheck(solution, solvers=["osqp"])),)
            attempt(problem, "mnmgs", max_iter=20)
            assert all(told)
            assert np.isfinite(problem.natural_map(solution)).all()
            assert len(problem.p(solution)) == len(problem.r(solution)) == 4


def test_ctrl_c_is_a_keyboard_interrupt_in_compiled_code_too():
    """numba makes a SystemError of it; wherever it comes, the run ends with its best iterate or with Ctrl-C."""

    def press(*_):
        raise KeyboardInterrupt

    def interrupted(problem, after):
        try:
            signal.setitimer(signal.ITIMER_REAL, after)
            attempt(problem)
            signal.setitimer(signal.ITIMER_REAL, 0)
        except KeyboardInterrupt:
            return True
        return False

    usual = signal.signal(signal.SIGALRM, press)
    try:
        for problem in (SMALL, BAND):
            needed = problem.solve().seconds
            for k in range(30):
                interrupted(problem, max(k / 30 * needed, 1e-6))
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, usual)


def test_a_function_of_the_user_that_is_interrupted_has_not_failed():
    def psi(z):
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as pressed:
            raise SystemError("returned a result with an exception set") from pressed

    with pytest.raises(KeyboardInterrupt):
        icp.ICP([[2.0]], [-1.0], psi).solve()


def half(x):
    return 0.5 * x


def test_compiled_code_that_cannot_be_kept_is_compiled_all_the_same():
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, hard))  # as on a full disk
    try:
        with pytest.warns(UserWarning, match="compiled code cannot be kept in .*NUMBA_CACHE_DIR"):
            assert compiled(half)(3.0) == 1.5
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_processes_that_compile_at_the_same_time_never_read_each_others_code(tmp_path):
    """One finds no index and writes its own, for whole numbers; the other one's, for floats, comes later."""
    (tmp_path / "halves.py").write_text("def half(x):\n    return 0.5 * x\n")
    function = runpy.run_path(str(tmp_path / "halves.py"))["half"]
    code = compiled(function)
    assert code(3.0) == 1.5
    index = next(Path(code.stats.cache_path).glob("*.half-*.nbi"))
    late = index.read_bytes()
    index.unlink()
    assert compiled(function)(3) == 1.5
    index.write_bytes(late)
    third = compiled(function)
    assert third(5.5) == 2.75
    assert sum(third.stats.cache_hits.values()) == 1


UNDER_OO = """
import multiprocessing, sys
import icpmodel as icp
from icpmodel.cli import main

def solved(q):
    return icp.ICP([[1.0, -1.0], [-1.0, 1.0]], q).solve().z

if __name__ == "__main__":
    print(icp.scenes.membrane(n=400).problem.solve("multilevel").status.value)
    assert main(["scenes"]) is None, "assertions are off"
    try:
        multiprocessing.get_context("fork").Pool(1).map(solved, [[1.0, 1.0], [-1.0, 0.0]])
    except icp.NotSolved as error:
        print(error.solution.status.value, flush=True)
    main(["explain", "hand-lcp"])
"""


@pytest.mark.slow
def test_without_docstrings_and_assertions_everything_works_and_a_pool_of_processes_returns_its_failed_row():
    run = subprocess.run(
        [sys.executable, "-OO", "-c", UNDER_OO], capture_output=True, text=True, check=False, timeout=60
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.startswith("solved\ninfeasible\nwhat to do")


class Stubborn:
    def __array__(self, *_, **__):
        raise RuntimeError("ask somebody else")


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ([[1.0], [1.0, 2.0]], "cannot be read as an array of numbers"),
        (np.ma.array([1.0, 2.0], mask=[True, False]), "has masked entries"),
        (np.ma.masked, "has masked entries"),
        (HUGE, "an integer of hundreds of digits"),
        ([10**400, 1], "has dtype object"),
        (Stubborn(), "ask somebody else"),
        (np.array(["2001-01-01", "2001-01-02"], "M8[D]"), r"has dtype datetime64\[D\]"),
        (["1", "2"], "has dtype <U1"),
        ([1j, 2.0], "is complex|has dtype complex"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_what_is_no_vector_of_numbers_is_refused_by_name_wherever_it_is_handed_in(value, words):
    problem = icp.ICP(3 * np.eye(2), [-1.0, 2.0])
    for call in (
        lambda: icp.ICP(np.eye(2), value),
        lambda: icp.ICP(value, [1.0, 2.0]),
        lambda: icp.ICP(np.eye(2), [1.0, 2.0], value),
        lambda: problem.with_q(value),
        lambda: problem.solve(z0=value),
        lambda: problem.residual(value),
        lambda: problem.natural_map([1.0, 1.0], value),
        lambda: problem.solve("mnmgs", phi=value),
        lambda: icp.solve_many(np.eye(2), value),
        lambda: icp.solve_many(np.eye(2), [[1.0, 2.0]], Z0=value),
    ):
        with pytest.raises(icp.InputError, match=rf"{words}|A has shape \(2,\)"):
            call()


@pytest.mark.parametrize("value", [10**400, HUGE, np.timedelta64(1), np.ma.masked], ids=type)
@pytest.mark.parametrize("name", ["rtol", "accuracy", "max_iter", "time_limit"])
def test_what_is_no_number_is_refused_by_name(name, value):
    with pytest.raises(icp.InputError, match=f"{name} is"):
        SMALL.solve(**{name: value})


NO_ARGUMENTS = {
    "raise_on_failure": lambda: icp.solve_many([[-1.0]], [[-1.0]], raise_on_failure=np.array([0, 0])),
    "rtol": lambda: icp.select_method(SMALL, rtol="abc"),
    "rtol is -1": lambda: icp.select_method(SMALL, rtol=-1),
    "family": lambda: SMALL.solve(family=np.ones(2)),
    "progress": lambda: SMALL.crosscheck(SMALL.solve(), ["osqp"], progress=np.ones(2)),
    "as_printed": lambda: icp.theory.check("4.3", SMALL, icp.MNMGS(), as_printed="no"),
    "executor": lambda: icp.solve_many(SMALL.A, [SMALL.q] * 2, executor=int),
    "solution": lambda: icp.contact_state(SMALL),
    "problem": lambda: icp.theory.proximal_point(None),
    "there is no scene": lambda: icp.scenes.scene(3),
    "there is no scene '": lambda: icp.scenes.parameters(None),
    "points": lambda: SMALL.solve().plot("x.png", points=["1"] * SMALL.n),
    "findex": lambda: icp.ICP.from_friction_index(np.eye(2), [1, 1], [0, 0], [1, 1], [[1, 2], [3]]),
    "z is": lambda: SMALL.linearised("abc"),
}


@pytest.mark.parametrize("words", NO_ARGUMENTS)
def test_what_is_no_argument_is_refused_before_any_work(words):
    with pytest.raises(icp.InputError, match=words):
        NO_ARGUMENTS[words]()


def test_a_rtol_of_0_is_that_of_rounding():
    assert isinstance(icp.select_method(icp.scenes.membrane(n=400), rtol=0).method, icp.PSOR)


def test_results_with_arrays_are_compared_by_identity():
    certificate = SMALL.solve().certificate
    assert certificate == certificate
    assert certificate not in [SMALL.solve().certificate]
    assert len({certificate, certificate.bound}) == 2


def test_nothing_that_a_callback_is_handed_reaches_the_run():
    def spoil(state):
        with pytest.raises(ValueError, match="read-only"):
            state.z[:] = 7.0
        z = state.z if state.z.base is None else state.z.base
        z.flags.writeable = True
        z[:] = 7.0

    problem = icp.scenes.membrane(n=100).problem
    for method in ("mnmgs", "newton", None):
        spoiled = problem.solve(method, callback=spoil)
        assert np.array_equal(spoiled.z, problem.solve(method).z)


def test_a_foreign_solver_that_prints_is_not_heard(capfd):
    class Chatty(icp.solvers.ForeignSolver):
        name, used_by = "chatty", ()

        def set_up(self, target, tolerance, time_limit):
            print("by Python")
            os.write(1, b"to standard output")
            os.write(2, b"to standard error")
            ctypes.CDLL(None).puts(b"by C")
            print("progress", file=sys.stderr)

        def run(self, model):
            return icp.solvers.Claim(np.zeros(40), "solved", True)

    rows = SMALL.with_q(np.ones(40)).crosscheck(np.zeros(40), solvers=[Chatty()]).rows
    assert rows[0].solver == "chatty"
    ctypes.CDLL(None).fflush(None)  # C keeps what it prints until then
    assert capfd.readouterr() == ("", "progress\n")
