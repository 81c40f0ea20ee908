"""Every example runs as written, in an empty folder, and says what it should."""

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parent.parent / "examples"

#: a phrase of each example's output that only a right answer produces
SAYS = {
    "first_problem.py": "The answer is confirmed",
    "membrane.py": "median force per area there: 16\n",
    "dividends.py": "2.14369",
    "when_methods_fail.py": "cycled, residual 6.6",
}


def test_every_example_is_run():
    assert sorted(path.name for path in EXAMPLES.glob("*.py")) == sorted(SAYS)


@pytest.mark.parametrize("name", SAYS)
def test_an_example_runs_as_written(name, tmp_path):
    run = subprocess.run([sys.executable, str(EXAMPLES / name)], cwd=tmp_path, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert run.stderr == ""
    assert SAYS[name] in run.stdout
    if name == "membrane.py":
        assert {path.name for path in tmp_path.iterdir()} == {"membrane.png", "membrane.svg"}
