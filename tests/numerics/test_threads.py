"""One thread of BLAS, and who gets their threads back; and steps that take too long."""

import os
import time
from concurrent.futures import ThreadPoolExecutor
from threading import Event, Thread, current_thread

import pytest
import threadpoolctl

from icpmodel.errors import OutOfMemory, OutOfTime
from icpmodel.numerics import threads, work
from icpmodel.numerics.processes import CAN_FORK, in_a_process, run_script
from icpmodel.numerics.threads import one_blas_thread, run_with_deadline
from icpmodel.solvers.foreign import _silence


def threads_of_blas():
    return {one["filepath"]: one["num_threads"] for one in threadpoolctl.threadpool_info() if one["user_api"] == "blas"}


def test_every_blas_has_one_thread_and_gets_its_own_back():
    """SciPy's, which is another one than NumPy's, too."""
    with one_blas_thread():
        assert set(threads_of_blas().values()) == {1}


def test_who_ends_last_gives_them_back():
    """Two threads that overlap and live on: the first one to begin is the first one to end. A third has a limit."""
    first, second = one_blas_thread(), one_blas_thread()
    with ThreadPoolExecutor(1) as one, ThreadPoolExecutor(1) as other:
        all_threads = threads_of_blas()
        with threadpoolctl.threadpool_limits(2, "blas"):
            before = threads_of_blas()
            for pool, step in ((one, first.__enter__), (other, second.__enter__)):
                pool.submit(step).result()
                assert set(threads_of_blas().values()) == {1}
            one.submit(first.__exit__, None, None, None).result()
            assert set(threads_of_blas().values()) == {1}
            other.submit(second.__exit__, None, None, None).result()
            assert threads_of_blas() == before
        assert threads_of_blas() == all_threads


@pytest.mark.skipif(not CAN_FORK, reason="there are no forks here")
def test_a_fork_has_locks_of_its_own_and_all_threads_of_blas():
    """Another thread holds the locks meanwhile."""

    def in_the_fork():
        yield threads_of_blas()
        with one_blas_thread(), _silence():
            yield threads_of_blas()

    with one_blas_thread():
        pass
    before = threads_of_blas()
    held, end = Event(), Event()

    def hold():
        with one_blas_thread(), _silence(), threads._BLAS_LOCK:
            held.set()
            end.wait()

    other = Thread(target=hold)
    other.start()
    held.wait()
    try:
        here, inside = in_a_process(in_the_fork, time.perf_counter() + 20.0)
    finally:
        end.set()
        other.join()
    assert here == before
    assert set(inside.values()) == {1}


def test_a_step_that_may_take_too_long_gives_its_result_or_error_or_is_left_at_the_end_of_the_time():
    def fails():
        raise ZeroDivisionError

    ended = Event()
    for most in (0.0, 1e30):  # here or in a thread of its own
        with work.work_limit(10.0):
            assert run_with_deadline(lambda: 7, most) == 7
            with pytest.raises(ZeroDivisionError):
                run_with_deadline(fails, most)
    assert run_with_deadline(current_thread, 1e30) is current_thread()  # nothing limits it
    with work.work_limit(0.05), pytest.raises(OutOfTime):
        run_with_deadline(ended.wait, 1e30)
    ended.set()


def test_a_script_ends_with_the_time_and_fails_with_its_exit_code():
    """And leaves no file open."""
    before = len(os.listdir("/dev/fd"))
    echo = "import pickle, sys; pickle.dump(pickle.load(sys.stdin.buffer), sys.stdout.buffer)"
    assert run_script(echo, [7]) == [7]
    with pytest.raises(ChildProcessError, match="exit code 3"):
        run_script("raise SystemExit(3)", None)
    with pytest.raises(ChildProcessError, match="no answer"):
        run_script("print('hello')", None)
    with pytest.raises(OutOfMemory):
        run_script("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", None)
    with work.work_limit(0.05), pytest.raises(OutOfTime):
        run_script("import time; time.sleep(60)", None)
    assert len(os.listdir("/dev/fd")) == before
