"""The command line as a person at a shell sees it."""

import pytest

from icpmodel.cli import main


def call(capsys, *arguments):
    with pytest.raises(SystemExit) as stop:
        main(list(arguments))
    out, err = capsys.readouterr()
    return stop.value.code, out, said(err)


def said(err):
    """Standard error without the lines on what is going on, of which a slow machine gets some."""
    return "".join(line for line in err.splitlines(keepends=True) if not line.startswith("icpmodel ... "))
