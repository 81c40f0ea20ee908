"""Problems on ranks: what holds on one, two and three of them, each in one run of `checks_on_ranks.py`."""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import icpmodel

HERE = Path(__file__).parent
MISSING = [name for name in ("petsc4py", "mpi4py") if importlib.util.find_spec(name) is None]
MISSING += [] if shutil.which("mpiexec") else ["mpiexec"]
#: seconds after which a run counts as hanging: a rank waits for one that has failed
HANGS = 300.0
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

with_petsc = pytest.mark.skipif(
    bool(MISSING), reason=f"{' and '.join(MISSING)} not installed: CONTRIBUTING.md says how to get them"
)


def on_ranks(ranks, *arguments):
    """The finished run of Python on so many ranks."""
    command = ["mpiexec", "-n", str(ranks), sys.executable, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=HANGS, env=ENVIRONMENT, check=False)


@with_petsc
@pytest.mark.parametrize("ranks", [1, 2, 3])
def test_on_any_number_of_ranks_the_answers_proofs_limits_and_errors_are_those_of_one_process(ranks):
    """What each of the checks says is in its name and in `checks_on_ranks.py`."""
    run = on_ranks(ranks, str(HERE / "checks_on_ranks.py"))
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout.splitlines()[-1]) == {}


@pytest.mark.skipif("petsc4py" not in MISSING, reason="petsc4py is installed")
def test_without_petsc_one_sentence_says_what_is_missing():
    with pytest.raises(icpmodel.NotApplicable, match="needs petsc4py and mpi4py"):
        icpmodel.ICP([[2.0]], [1.0]).distribute()
