"""Problems on ranks: what holds on one to four of them, each in one run of `checks_on_ranks.py`."""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from shell import call

import icpmodel

HERE = Path(__file__).parent
MISSING = [name for name in ("petsc4py", "mpi4py") if importlib.util.find_spec(name) is None]
MISSING += [] if shutil.which("mpiexec") else ["mpiexec"]
#: seconds after which a run counts as hanging, as a rank waits for one that has failed; a run of 5 s took 300 on a busy
#: machine, where ranks give way while they wait
HANGS = 600.0
#: parts of the names of what is checked on each number of ranks; on three, where the parts differ in size, all is
FEW = ["the_answer_is", "files_are_read", "what_one_rank_finds_wrong"]
#: Open MPI may run as root, on more ranks than there are cores, which then give way to each other
ENVIRONMENT = os.environ | {
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
    "OMPI_MCA_mpi_yield_when_idle": "1",
    "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "PYTHONPATH": os.pathsep.join([str(Path(icpmodel.__file__).parent.parent), os.environ.get("PYTHONPATH", "")]),
}


def with_petsc(test):
    """Marks what starts ranks, which `.ci/run` does, or loads what they need."""
    why = f"{' and '.join(MISSING)} not installed: CONTRIBUTING.md says how to get them"
    return pytest.mark.slow(pytest.mark.skipif(bool(MISSING), reason=why)(test))


def on_ranks(ranks, *arguments, **environment):
    """The finished run of Python on these ranks."""
    command = ["mpiexec", "-n", str(ranks), sys.executable, *arguments]
    environment = ENVIRONMENT | environment
    return subprocess.run(command, capture_output=True, text=True, timeout=HANGS, env=environment, check=False)


@with_petsc
@pytest.mark.parametrize(("ranks", "checks"), [(1, FEW), (2, FEW), (3, []), (4, FEW)], ids=["1", "2", "3", "4"])
def test_on_any_number_of_ranks_the_answers_proofs_files_limits_and_errors_are_those_of_one_process(ranks, checks):
    """What each of the checks says is in its name, in `checks_on_ranks.py` and `checks_of_files.py`."""
    run = on_ranks(ranks, str(HERE / "checks_on_ranks.py"), *checks)
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout.splitlines()[-1]) == {}


@with_petsc
def test_levels_that_are_left_to_fewer_ranks_lead_to_the_same_answers():
    gamg = {"PETSC_OPTIONS": "-icpmodel_pc_type gamg"}
    run = on_ranks(4, str(HERE / "checks_on_ranks.py"), "the_answer_is", "obstacle_that_moves", **gamg)
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout.splitlines()[-1]) == {}


@with_petsc
@pytest.mark.parametrize(
    ("way", "codes", "said"),
    [
        # Open MPI's mpiexec says 1 of a Ctrl-C, whatever the ranks say
        ("ctrl-c", {1, 130}, "interrupted"),
        ("ctrl-c of all", {130}, "interrupted"),
        ("raises", {1}, "ZeroDivisionError: broken (rank 1 of 2)"),
        ("nan", {2}, "psi of rows(50, 100)"),
    ],
)
def test_what_ends_one_rank_ends_all_with_one_line_and_one_exit_code(way, codes, said):
    run = on_ranks(2, str(HERE / "ended_on_ranks.py"), way)
    assert run.returncode in codes, run.stderr
    told = [line for line in run.stderr.splitlines() if line.startswith("icpmodel: ")]
    assert len(told) == 1, run.stderr
    assert said in told[0]
    assert "Traceback" not in run.stderr


@with_petsc
@pytest.mark.parametrize("way", ["dies", "script"])
def test_nobody_waits_for_a_rank_that_died_or_ended_by_an_error_of_the_script(way):
    run = on_ranks(2, str(HERE / "ended_on_ranks.py"), way)
    assert run.returncode != 0
    assert run.stderr.count("KeyError: 'of the script'") == (way == "script")


@with_petsc
def test_the_command_solves_what_is_in_files_and_writes_what_the_command_of_one_process_reads(tmp_path):
    problem = icpmodel.scenes.torsion(n=400).problem
    icpmodel.save_problem(problem, tmp_path / "p.npz")
    run = on_ranks(2, "-m", "icpmodel", "distributed", str(tmp_path / "p.npz"), "-o", str(tmp_path / "z.bin"))
    assert run.returncode == 0, run.stderr
    assert run.stdout.count("400 unknowns on 2 ranks") == 1
    assert run.stderr.count(f"wrote {tmp_path / 'z.bin'}") == 1
    z = np.fromfile(tmp_path / "z.bin", ">f8", offset=8)
    assert np.allclose(z, problem.solve().z, atol=1e-6)
    assert icpmodel.certify(problem, z).bound.value < 1e-6


@with_petsc
@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["membrane", "--n", "10.5"], "'10.5' is not a valid integer"),
        (["coulomb"], "not assembled by rows; the scenes that are: ball"),
        (["membrane", "--n", "100", "-o", "z.npz"], "a file name that ends in .bin or .h5 was expected"),
        (["A.npy", "--q", "q.npy"], "A.npy: no such file"),
        (["membrane", "--z0", "z.npz"], "z.npz: no such file"),
        ([], "SOURCE or --A names the problem"),
    ],
)
def test_wrong_arguments_are_one_line_and_exit_code_2(capsys, arguments, said):
    code, out, err = call(capsys, "distributed", *arguments)
    assert (code, out) == (2, "")
    assert said in err
    assert err.count("\n") == 1


@pytest.mark.skipif("petsc4py" not in MISSING, reason="petsc4py is installed")
def test_without_petsc_one_sentence_says_what_is_missing():
    with pytest.raises(icpmodel.NotApplicable, match="needs petsc4py and mpi4py"):
        icpmodel.ICP([[2.0]], [1.0]).distribute()
