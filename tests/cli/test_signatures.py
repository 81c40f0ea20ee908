"""Commands from functions: what the signature and the docstring say is what a user types and reads."""

import click
import pytest
from click.testing import CliRunner

from icpmodel.cli.arguments import options, parameters, summary
from icpmodel.cli.output import measured
from icpmodel.errors import Interrupted


def study(scenes=(), sizes=(1, 2), method=None, time_limit=3.0, k=5, progress=False):
    """What it does, in one
    paragraph.

    More. Parameters: `scenes` as NAME or NAME,PARAMETER=NUMBER; `sizes` of `it`; `method` by name, `time_limit`
    seconds; `k` right-hand
    sides. Returns nothing.
    """


def invoked(*arguments):
    """What the function would be called with, or what is printed."""
    seen = {}
    command = click.command(help=summary(study))(options(*parameters(study))(lambda **given: seen.update(given)))
    result = CliRunner().invoke(command, arguments)
    return seen or (result.exit_code, result.output)


def test_defaults_are_those_of_the_signature():
    assert invoked() == {"scenes": (), "sizes": (1, 2), "method": None, "time_limit": 3.0, "k": 5}


def test_values_have_the_types_of_the_defaults_and_tuples_are_options_that_can_be_repeated():
    given = invoked("a", "b,mu=4", "--n", "7", "--n", "9", "--method", "x", "--time-limit", "1", "--k", "2")
    assert given == {"scenes": ("a", "b,mu=4"), "sizes": (7, 9), "method": "x", "time_limit": 1.0, "k": 2}
    assert isinstance(given["time_limit"], float)
    code, said = invoked("--k", "many")
    assert code == 2
    assert "'many' is not a valid integer" in said


def test_help_is_what_the_docstring_says():
    _, page = invoked("--help")
    assert "What it does, in one paragraph." in page
    lines = {line.split()[0]: " ".join(line.split()) for line in page.splitlines() if line.strip().startswith("--")}
    assert lines["--k"] == "--k INTEGER right-hand sides [default: 5]"
    assert lines["--n"] == "--n INTEGER of it [default: 1, 2]"
    assert lines["--method"] == "--method TEXT by name"
    assert "NAME[,PARAMETER=NUMBER]" in page
    assert "progress" not in page


@pytest.mark.parametrize(("stopped", "code"), [(False, 0), (True, 130)])
def test_after_ctrl_c_what_there_is_is_shown(capsys, stopped, code):
    def measure():
        if stopped:
            raise Interrupted("so far")
        return "all"

    shown = []
    assert measured(measure, shown.append, "the rest is missing") == code
    assert shown == ["so far" if stopped else "all"]
    assert capsys.readouterr().err == ("icpmodel: interrupted: the rest is missing\n" if stopped else "")
