"""A person is told how far a run is: by a bar on a terminal and in a notebook, by a line now and then in a log."""

import io
import logging

from known_answers import PAIR

import icpmodel as icp
from icpmodel.solve.progress import progress_bar, status_line

SLOW = icp.scenes.bai_symmetric(n=900, mu=0).problem


def test_a_bar_is_shown_on_a_terminal(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    SLOW.solve("mnmj", progress=True)
    assert "iteration" in terminal.getvalue()


def test_the_lines_of_a_log_come_after_1_2_4_seconds_and_then_one_a_minute(capsys):
    now = 0
    with progress_bar(True, lambda: float(now)) as bar:
        bar.begin("newton")
        for now in range(300):
            bar.update(now, 0.5, 1e-8)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "icpmodel ... newton: iteration 1, residual 5.00e-01 -> 1.00e-08"
    assert [int(line.split()[4][:-1]) for line in lines] == [1, 2, 4, 8, 16, 32, 64, 124, 184, 244]


def test_a_study_says_beforehand_how_much_it_is_and_in_a_page_as_well(caplog):
    problem = icp.ICP(PAIR, [-1.0, 3.0])
    with caplog.at_level("INFO", "icpmodel"), status_line(False, "outer") as outer, status_line(True, "inner") as inner:
        assert inner is outer  # a page shows what its parts are at
    assert "outer" in caplog.text
    few = {"tolerances": [1e-4], "repeats": 1, "time_limit": 2}
    studies = {
        "4 points": lambda: icp.stability("relaxation", points=2, n=9, starts=1),
        "a run of 2 s at most": lambda: icp.race(problem, [], [], z_exact=[0.5, 0.0], **few),
        "3 s at most": lambda: icp.crosscheck(problem, [0.5, 0.0], ["osqp"], time_limit=3),
    }
    for said, study in studies.items():
        caplog.clear()
        with caplog.at_level("INFO", "icpmodel"):
            study()
        assert said in caplog.text


def test_nothing_is_printed_by_default(capsys):
    SLOW.solve("mnmj")
    assert capsys.readouterr().err == ""


def test_the_log_names_each_method_why_it_begins_and_how_it_ends_and_at_debug_the_others(caplog):
    with caplog.at_level(logging.DEBUG, "icpmodel"):
        solution = icp.scenes.membrane(n=100).problem.solve()
    info = [one.getMessage() for one in caplog.records if one.levelno == logging.INFO]
    debug = [one.getMessage() for one in caplog.records if one.levelno == logging.DEBUG]
    assert any("begins: a trial of 12 sweeps" in text for text in info)
    assert info[-1].startswith(f"n = 100: solved, z is from {solution.method!r}; {solution.iterations} iterations")
    assert any("steps are expected" in text for text in debug)
    assert any("Tridiagonal() is left out: A is not tridiagonal" in text for text in debug)
    caplog.clear()
    with caplog.at_level(logging.INFO, "icpmodel"):
        icp.solve_many([[2.0]], [[-2.0], [3.0]])
    assert caplog.messages == ["2 rows, n = 1: 2 are solved at once by Lemke(), the others one by one"]
