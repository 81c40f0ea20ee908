"""Options from functions: types and defaults are those of the signature, descriptions those of the docstring."""

from __future__ import annotations

import click
import pytest
from click.testing import CliRunner

from icpmodel.cli.arguments import from_signature, options
from icpmodel.cli.output import measured
from icpmodel.errors import Interrupted


def study(time_limit: float = 3.0, k: int = 5, n: int | None = None, progress: bool = False) -> None:
    """Take options.

    Parameters
    ----------
    time_limit : float, default 3
        Seconds.
    k, n : int
        Numbers of right-hand sides
        and unknowns.

        More of them.

    Returns
    -------
    None
    """


def invoked(*arguments):
    """The arguments of the command, or its exit code and what it prints."""
    seen = {}
    command = click.command()(
        options(*from_signature(study, "time_limit", "k", "n"))(lambda **given: seen.update(given))
    )
    result = CliRunner().invoke(command, arguments)
    return seen or (result.exit_code, result.output)


def test_an_option_has_the_type_and_the_default_of_its_parameter():
    assert invoked() == {"time_limit": 3.0, "k": 5, "n": None}
    given = invoked("--time-limit", "1", "--k", "1e3", "--n", "2")
    assert given == {"time_limit": 1.0, "k": 1000, "n": 2}
    assert isinstance(given["time_limit"], float)
    assert invoked("--k", "many")[0] == 2
    _, page = invoked("--help")
    assert "Numbers of right-hand sides and unknowns. More of them. [default: 5]" in " ".join(page.split())
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
