"""solve_many by workers is solve_many: the same answers in the same order, whatever becomes of a worker."""

import os
import subprocess
import sys
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import workers

import icpmodel as icp

TWO = partial(ProcessPoolExecutor, 2)
RNG = np.random.default_rng(0)
A, Q = 2.0 * np.eye(3) - 0.1 * RNG.random((3, 3)), RNG.normal(size=(40, 3))


def assert_same(found, expected, rows=slice(None)):
    for name in ("Z", "residuals", "tolerances"):
        assert np.array_equal(getattr(found, name)[rows], getattr(expected, name)[rows])
    assert np.array_equal(np.array(found.statuses)[rows], np.array(expected.statuses)[rows])


KINDS = ["maps", "one map", "starts", "obstacles", "affine", "two obstacles", "one row without one", "matrices"]


@pytest.mark.parametrize("kind", KINDS)
def test_the_answers_are_those_without_workers_bit_by_bit(kind):
    above = np.where(np.arange(40)[:, None] == 3, [np.inf, 1.0, 1.0], 1.0)  # as no row of another share
    near = (1.0 + 1e-9) * icp.solve_many(A, Q, upper=above).Z
    given = {
        "maps": (A, Q, [workers.sine, icp.Elementwise(np.tanh, lipschitz=1.0)] * 20),
        "one map": (A, Q, workers.sine),
        "starts": (A, Q, workers.sine, None, np.ones((40, 3))),
        "obstacles": (A, Q, RNG.normal(size=(40, 3))),
        "affine": (A, Q, icp.Affine(0.1 * A, -0.1)),
        "two obstacles": (A, Q, -1.0, np.where(RNG.random((40, 3)) < 0.5, np.inf, 1.0)),
        "one row without one": (A, Q, 0.0, above, near),
        "matrices": ([A + 0.01 * k * np.eye(3) for k in range(40)], Q),
    }[kind]
    options = dict(zip(("A", "Q", "psi", "upper", "Z0"), given, strict=False))
    expected = icp.solve_many(**options)
    for pool in (TWO, partial(ThreadPoolExecutor, 2)):
        found = icp.solve_many(**options, executor=pool)
        assert_same(found, expected)
        assert repr(found[7].method) == repr(expected[7].method)


def test_the_share_of_a_worker_that_dies_is_done_again(tmp_path):
    psi = [workers.sine] * 40
    psi[20] = workers.dying(str(tmp_path / "died"))
    found = icp.solve_many(A, Q, psi, executor=TWO)
    assert (tmp_path / "died").exists()
    assert_same(found, icp.solve_many(A, Q, workers.sine))


@pytest.mark.parametrize("fails", [workers.dying(), workers.raises])
def test_a_row_whose_worker_always_fails_is_named_and_all_others_are_kept(fails):
    psi = [workers.sine] * 40
    psi[20] = fails
    found = icp.solve_many(A, Q, psi, executor=TWO, raise_on_failure=False)
    assert found.failed == [20]
    assert found.statuses[20] is icp.Status.WORKER_LOST
    assert "its worker failed: " in found.messages[20]
    expected = icp.solve_many(A, Q, workers.sine)
    assert_same(found, expected, np.r_[:16, 32:40])
    assert np.abs(found.Z - expected.Z)[np.r_[16:20, 21:32]].max() < 1e-7


class Interrupted(ThreadPoolExecutor):
    """A pool in which Ctrl-C comes while the third of the shares is sent."""

    def submit(self, *args):
        self.sent = getattr(self, "sent", -1) + 1
        if self.sent == 3:
            raise KeyboardInterrupt
        end = Future()
        end.set_result(args[0](*args[1:]))
        return end


def test_ctrl_c_leaves_the_shares_that_are_back():
    found = icp.solve_many(A, Q, workers.sine, executor=Interrupted, raise_on_failure=False)
    names = [status.name for status in found.statuses]
    assert names == ["SOLVED"] * 32 + ["INTERRUPTED"] * 8


def test_limits_hold_for_the_rows_of_workers():
    late = icp.solve_many(A, Q, workers.sine, time_limit=0.0, executor=TWO, raise_on_failure=False)
    assert set(late.statuses) == {icp.Status.TIME_LIMIT}
    many = icp.solve_many(A, Q, workers.sine, memory_limit=1e9, time_limit=60.0, executor=TWO)
    assert_same(many, icp.solve_many(A, Q, workers.sine))


def test_what_does_not_reach_a_worker_is_an_error_of_the_input():
    with pytest.raises(icp.InputError, match=r"executor: no data reaches a worker: .* must be picklable"):
        icp.solve_many(A, Q, lambda z: 0.1 * z, executor=TWO)
    with TWO() as pool:
        for executor in (pool, 2, "dask"):
            with pytest.raises(icp.InputError, match=r"executor is .* a function that makes a pool was expected"):
                icp.solve_many(A, Q, executor=executor)


def test_workers_of_mpi_give_the_same_answers(tmp_path):
    pytest.importorskip("mpi4py", reason="mpi4py is not installed")
    script = tmp_path / "study.py"
    script.write_text(
        "import numpy as np, icpmodel as icp, workers\n"
        "from mpi4py.futures import MPIPoolExecutor\n"
        "if __name__ == '__main__':\n"
        "    Q = np.random.default_rng(0).normal(size=(40, 3))\n"
        "    found = icp.solve_many(2 * np.eye(3), Q, workers.sine, executor=MPIPoolExecutor)\n"
        "    print(np.array_equal(found.Z, icp.solve_many(2 * np.eye(3), Q, workers.sine).Z))\n"
    )
    command = ["mpiexec", "--oversubscribe", "-n", "2", sys.executable, "-m", "mpi4py.futures", str(script)]
    paths = os.pathsep.join([str(Path(__file__).parent), str(Path(icp.__file__).parents[1])])
    environment = {**os.environ, "PYTHONPATH": paths}
    for allowed in ("OMPI_ALLOW_RUN_AS_ROOT", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM"):
        environment[allowed] = "1"
    try:
        run = subprocess.run(command, capture_output=True, text=True, env=environment, check=False, timeout=60)
    except FileNotFoundError:
        pytest.skip("there is no mpiexec")
    assert run.stdout == "True\n", run.stderr
