"""The command line: text and JSON, exit codes, and errors in one line on standard error."""

import io
import json
import os
import shlex

import click
import numpy as np
import pytest
from installed import announce, run
from known_answers import PAIR
from scipy.io import savemat
from shell import call, said

import icpmodel as icp
from icpmodel.cli import commands


def test_solve_prints_a_card_and_the_distance_to_the_reference(capsys):
    code, out, err = call(capsys, "solve", "coulomb")
    assert code == 0
    assert "solved: residual" in out
    assert "reference z: off by" in out
    assert err == ""


def test_solve_as_json_is_json(capsys):
    code, out, _ = call(capsys, "solve", "hand-lcp", "--json")
    told = json.loads(out)
    assert code == 0
    assert told["status"] == "solved"
    assert told["distance_to_reference"]["z"] < 1e-6
    assert told["unique"] is True


def test_not_solved_is_exit_code_1_with_advice_on_the_card(capsys):
    code, out, err = call(capsys, "solve", "membrane", "--method", "mnmj", "--max-iter", "3")
    assert code == 1
    assert " ".join(out.split()).count("Advice: raise max_iter, ask for less (rtol, accuracy), or pass") == 1
    assert err == "icpmodel: not solved: iteration limit\n"  # the card has the message, in lines that can be read
    assert max(map(len, out.splitlines())) <= 116


def test_problem_and_solution_travel_through_files(capsys, tmp_path):
    problem, answer = str(tmp_path / "problem.npz"), str(tmp_path / "answer.npz")
    assert call(capsys, "solve", "manufactured-affine", "--n", "25", "--save-problem", problem)[0] == 0
    code, out, err = call(capsys, "solve", problem, "-o", answer)
    assert f"wrote {answer}" in err
    assert code == 0
    expected = icp.scenes.manufactured_affine(n=25)
    assert icp.load_solution(answer).z == pytest.approx(expected.z_exact, abs=1e-5)
    code, out, _ = call(capsys, "crosscheck", problem, "--solver", "osqp")
    assert code == 0
    assert "agrees" in out


def test_a_and_q_and_the_obstacles_are_files_or_numbers(capsys, tmp_path):
    np.save(tmp_path / "A.npy", PAIR)
    np.savetxt(tmp_path / "q.csv", [-1.0, 3.0])
    np.save(tmp_path / "psi.npy", [-np.inf, -0.25])
    given = ["--q", str(tmp_path / "q.csv"), "--psi", str(tmp_path / "psi.npy"), "--upper", "0.3", "--json"]
    for source in (["--A", str(tmp_path / "A.npy")], [str(tmp_path / "A.npy")]):
        code, out, _ = call(capsys, "solve", *source, *given)
        assert code == 0
        told = json.loads(out)
        assert told["z"] == pytest.approx([0.3, -0.25])
        assert told["p"] == pytest.approx([-0.15, 2.2])
        assert told["r"] == [None, 0.0]  # JSON has no infinity
    variables = {"A": PAIR, "q": [-1.0, 3.0], "psi": -0.25, "upper": 0.3}
    savemat(tmp_path / "p.mat", variables)
    assert json.loads(call(capsys, "solve", str(tmp_path / "p.mat"), "--json")[1])["z"] == pytest.approx(told["z"])


@pytest.mark.parametrize(
    ("typed", "known"),
    [
        (["st"], {"stability"}),
        (["solve", "memb"], {"membrane"}),
        (["solve", "membrane", "--method", "newt"], {"newton", "newton-josephy"}),
        (["race", "membrane", "--solver", "osq"], {"osqp", "osqp, not polished"}),
        (["stability", "rel"], {"relaxation"}),
        (["stability", "units", "memb"], {"membrane"}),
        (["scenes", "memb"], {"membrane"}),
        (["solve", "./A"], {"./A"}),
        (["solve", "--polish", "--upp"], {"--upper"}),
    ],
)
def test_a_shell_completes_commands_scenes_methods_and_solvers(capsys, monkeypatch, typed, known):
    for name, value in {
        "_ICPMODEL_COMPLETE": "bash_complete",
        "COMP_WORDS": shlex.join(["icpmodel", *typed]),
        "COMP_CWORD": str(len(typed)),
    }.items():
        monkeypatch.setenv(name, value)
    code, out, _ = call(capsys)
    assert code == 0
    assert {line.partition(",")[2] for line in out.splitlines()} == known


def test_a_command_loads_what_it_needs(tmp_path):
    command = "import sys; from icpmodel.cli import main"
    loaded = "print([name for name in sys.modules if name in ('icpmodel.study', 'numba')])"
    ran = run("-c", f"{command}\ntry:\n    main(['scenes', 'hand-lcp'])\nfinally:\n    {loaded}", folder=tmp_path)
    assert (ran.returncode, said(ran.stderr)) == (0, "")
    assert "hand-lcp" in ran.stdout
    assert ran.stdout.endswith("\n[]\n")


@pytest.mark.parametrize(("command", "code"), [(["scenes", "hand-lcp"], 0), (["scenes", "nothing"], 2)])
def test_a_command_does_not_wait_for_a_step_that_was_left_when_its_time_was_over(command, code, tmp_path):
    left = (
        "import contextlib, sys, time\nfrom icpmodel.cli import main\nfrom icpmodel.errors import OutOfTime\n"
        "from icpmodel.numerics import threads, work\n"
        "with contextlib.suppress(OutOfTime), work.work_limit(0.05):\n"
        "    threads.run_with_deadline(lambda: time.sleep(3600), 1e30)\n"
    )
    ran = run("-c", f"{left}sys.argv[1:] = {command}\nmain()", folder=tmp_path)
    assert ran.returncode == code
    assert command[1] in ran.stdout + ran.stderr


def test_crosscheck_reports_and_exits_0_only_when_confirmed(capsys, tmp_path):
    csv = tmp_path / "report.csv"
    code, out, _ = call(capsys, "crosscheck", "hand-lcp", "--solver", "osqp", "--csv", str(csv))
    assert code == 0
    assert "agrees" in out
    assert csv.read_text().startswith("solver,")
    code, out, err = call(capsys, "crosscheck", "membrane", "--solver", "pyomo-highs")
    assert code == 1  # skipped for its size, and so nobody agrees
    assert "not confirmed" in err


def test_standard_input_is_a_file_and_the_first_line_of_a_table_may_have_names(capsys, tmp_path, monkeypatch):
    A = tmp_path / "A.csv"
    A.write_text("first,second\n2,-1\n-1,2\n")
    problem = tmp_path / "p.npz"
    icp.save_problem(icp.ICP(PAIR, [-1, 3]), problem)
    for typed, given in ((["--A", str(A), "--q", "-"], b"q\n-1\n3\n"), (["-"], problem.read_bytes())):
        monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(given)))
        code, out, _ = call(capsys, "solve", *typed, "--json")
        assert (code, json.loads(out)["z"]) == (0, [0.5, 0.0])


def test_what_is_wrong_in_standard_input_is_said_of_it(capsys, tmp_path, monkeypatch):
    np.save(tmp_path / "A.npy", PAIR)
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b"1,nan\n")))
    code, _, err = call(capsys, "solve", "--A", str(tmp_path / "A.npy"), "--q", "-")
    assert (code, err) == (2, "icpmodel: standard input: q[1] is nan; a finite number was expected\n")
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(call(capsys, "scenes", "--json")[1].encode())))
    code, _, err = call(capsys, "crosscheck", "-")
    assert (code, err) == (2, "icpmodel: standard input is JSON, which is not read; use solve -o answer.npz\n")


def test_the_card_says_why_there_is_no_error_bound(capsys):
    assert "no certified bound: it was not computed" in call(capsys, "solve", "hand-lcp", "--no-bound")[1]
    assert "not proved positive definite" in call(capsys, "solve", "bratu", "--n", "9")[1]


def test_closed_standard_input_is_one_line_on_standard_error(capsys, tmp_path, monkeypatch):
    np.save(tmp_path / "A.npy", PAIR)
    monkeypatch.setattr("sys.stdin", None)
    code, _, err = call(capsys, "solve", "--A", str(tmp_path / "A.npy"), "--q", "-")
    assert (code, err.count("\n")) == (2, 1)
    assert err.startswith("icpmodel: standard input: cannot be read")


def test_a_run_goes_on_from_a_saved_answer(capsys, tmp_path):
    first = str(tmp_path / "first.npz")
    arguments = ["solve", "bai-symmetric", "--set", "mu=0", "--method", "mnmgs", "--json"]
    assert call(capsys, *arguments, "--max-iter", "500", "-o", first)[0] == 1
    cold = json.loads(call(capsys, *arguments)[1])["iterations"]
    code, out, _ = call(capsys, *arguments, "--z0", first)
    assert code == 0
    assert json.loads(out)["iterations"] == cold - 500


def test_limits_and_the_start_of_a_scene_reach_the_solver(capsys):
    told = json.loads(call(capsys, "solve", "bai-symmetric", "--set", "mu=0", "--time-limit", "0", "--json")[1])
    assert told["status"] == "time limit"
    assert told["iterations"] == 0
    bai = icp.scenes.bai_symmetric()
    expected = bai.problem.solve("mnmgs", z0=bai.z0, rtol=0.1).iterations
    told = json.loads(call(capsys, "solve", "bai-symmetric", "--method", "mnmgs", "--rtol", "0.1", "--json")[1])
    assert told["iterations"] == expected
    assert expected != bai.problem.solve("mnmgs", rtol=0.1).iterations
    told = json.loads(call(capsys, "solve", "bai-symmetric", "--method", "mnmgs", "--atol", "1e9", "--json")[1])
    assert told["iterations"] == 0


def test_scenes_are_listed_and_described(capsys):
    code, out, _ = call(capsys, "scenes")
    assert code == 0
    assert [line.split()[0] for line in out.split("what it is\n")[1].splitlines()] == icp.scenes.names()
    card = " ".join(call(capsys, "scenes", "membrane")[1].split())
    assert "parameters --n 900 --set mu=0.0 --set skew=0.0" in card
    assert "reference none: The square has no closed form" in card
    assert "solution none: r < 0 below 3/4" in " ".join(call(capsys, "scenes", "hard-jump")[1].split())
    for name in icp.scenes.names():
        assert json.loads(call(capsys, "scenes", name, "--json")[1])["name"] == name


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["solve", "nowhere"], "SOURCE is 'nowhere'; there is neither a scene nor a file or folder of this name"),
        (["solve", "membrain"], "nor a file or folder of this name; did you mean membrane?"),
        (["solve", "no/such.npz"], "icpmodel: no/such.npz: no such file or folder"),
        (["solve", "membrane", "-o", "a" * 300 + ".npz"], "File name too long"),
        (["solve"], "SOURCE or --A names the problem; neither is given"),
        (["solve", "membrane", "--A", "A.npy"], "both are given, membrane and A.npy; drop one"),
        (["solv"], "there is no command 'solv'; did you mean solve?"),
        (["solve", "membrane", "--n", "x"], "'x' is not a valid integer"),
        (["solve", "membrane", "--method", "nwton"], "method is 'nwton'; did you mean newton?"),
        (["solve", "membrane", "--method", "mnmgs", "--option", "phi"], "--option is 'phi'; NAME=VALUE was expected"),
        (["solve", "membrane", "--option", "phi=1"], "name one with --method"),
        (["solve", "membrane", "--theta1", "1.2"], "No such option '--theta1'; --option theta1=VALUE was expected"),
        (["solve", "membrane", "-n", "9"], "No such option '-n'; --n VALUE was expected"),
        (["race", "membrane", "--mu", "1"], "No such option '--mu'; --set mu=VALUE was expected"),
        (["race", "membrane", "--theta1", "1"], "No such option '--theta1'."),
        (["solve", "membrane", "--lower", "0"], "No such option '--lower'; did you mean --psi?"),
        (["solve", "membrane", "--tol", "1e-9"], "No such option '--tol'; did you mean --rtol?"),
        (["solve", "--A", "A.npy", "--q", "q.csv", "--psi", "psi.csv"], "no number, and there is no such file"),
        (["solve", "membrane", "--method", "mnmgs", "--option", "phi2=1,2"], "phi2 is '1,2'; real numbers"),
        (
            ["solve", "membrane", "--method", "mnmgs", "--option", "phi=1", "--option", "phi=2"],
            "--option gives phi twice",
        ),
        (["solve", "membrane", "--accuracy", "1e-6", "--no-bound"], "--no-bound leaves it out; drop one"),
        (["solve", "hand-lcp", "--save-problem", ""], "the path is empty"),
        (
            ["solve", "membrane", "--set", "nu=1"],
            "membrane has no parameter 'nu'; its parameters are: n, mu, skew; did you mean",
        ),
        (["solve", "membrane", "-o", "answer.txt"], "ends in .npz or .csv"),
        (["solve", "membrane", "-o", "no/such/answer.npz"], "the folder no/such does not exist"),
        (["crosscheck", "membrane", "--csv", "."], "ends in .csv"),
        (["crosscheck", "membrane", "--csv", "no/such.csv"], "the folder no does not exist"),
        (["scenes", "dividends"], "did you mean dividend?"),
        (["stability", "unit"], "did you mean units?"),
        (["solve", ""], "SOURCE is ''; there is neither"),
        (["race", "hand-lcp", "--repeats", "0"], "repeats is 0"),
        (["solve", "dividend", "--set", "n=61"], "set by --n"),
        (["solve", "membrane", "--q", "q.mtx"], "--q belongs to a file of A; membrane is a scene, which has its own"),
        (["solve", "membrane", "--n", "1000000000000"], "n is 1000000000000; a whole number >= 1 and <= 1e+08"),
        (["solve", "membrane", "--z0", "nowhere.npz"], "nowhere.npz: no such file"),
        (["report", "membrane", "-o", "page.pdf"], "ends in .html"),
        (["crosscheck", "hand-lcp", "--solver", "osqb"], "did you mean osqp?"),
        (["solve", __file__], "a file name that ends in one of .npy, .npz, .mat, .mtx, .bin, .csv, .txt was expected"),
        (["solve", __file__, "--n", "3"], "--n and --set belong to scenes"),
    ],
)
def test_errors_are_one_line_on_standard_error(capsys, arguments, words):
    code, out, err = call(capsys, *arguments)
    assert code == 2
    assert out == ""
    assert err.startswith("icpmodel: ")
    assert err.count("\n") == 1
    assert words in err


@pytest.mark.parametrize("command", commands.list_commands(click.Context(commands)))
def test_help_explains_every_command(capsys, command):
    code, out, _ = call(capsys, command, "--help")
    assert code == 0
    assert "Usage: icpmodel" in out


METHOD = """
import signal
from dataclasses import dataclass

from icpmodel import Method

signal.signal(signal.SIGINT, signal.default_int_handler)  # it may have been started with SIGINT ignored


@dataclass(frozen=True, kw_only=True, repr=False)
class Outside(Method):
    name = "outside-method"
    steps: int = 50

    def iterates(self, problem, z):
        for k in range(self.steps):
            yield z, None
            z = z - problem.natural_map(z) / 4
        signal.raise_signal(signal.SIGINT)
"""

SOLVER = """
from icpmodel.solvers.foreign import ForeignSolver


class Pressed(ForeignSolver):
    name = "pressed"

    def set_up(self, target, tolerance, time_limit):
        raise KeyboardInterrupt

    def run(self, model):
        raise AssertionError
"""


def outside(folder, source):
    """A function that runs the command line where a package with the module `source` is installed."""
    (folder / "outside.py").write_text(source)
    announce(folder, "outside", {"icpmodel": {"more": "outside"}})
    return lambda *arguments: run("-c", f"from icpmodel.cli import main; main({list(arguments)})", folder=folder)


def test_what_a_library_prints_is_not_in_the_output(tmp_path):
    (tmp_path / "outside.py").write_text("import os; os.write(1, b'a library says hello\\n')")
    announce(tmp_path, "outside", {"icpmodel": {"more": "outside"}})
    ran = run("-m", "icpmodel", "solve", "hand-lcp", "--json", folder=tmp_path)
    assert json.loads(ran.stdout)["status"] == "solved"
    assert said(ran.stderr) == "a library says hello\n"


def test_ctrl_c_shows_the_best_iterate_and_no_traceback(tmp_path):
    ran = outside(tmp_path, METHOD)("solve", "membrane", "--method", "outside-method", "--option", "steps=3")
    assert ran.returncode == 1
    assert said(ran.stderr) == "icpmodel: not solved: interrupted\n"
    assert "residual" in ran.stdout


def test_ctrl_c_ends_a_report_before_its_other_sections(tmp_path):
    options = ["--method", "outside-method", "--option", "steps=3", "-o", str(tmp_path / "x.html")]
    ran = outside(tmp_path, METHOD)("report", "membrane", *options)
    assert (ran.returncode, said(ran.stderr).strip()) == (130, "icpmodel: interrupted")
    assert not (tmp_path / "x.html").exists()


@pytest.mark.slow
def test_ctrl_c_while_a_compiled_module_is_imported_is_ctrl_c(tmp_path):
    """Its initialisation ends as an ImportError because of it."""
    (tmp_path / "matplotlib.py").write_text("raise ImportError('initialization failed') from KeyboardInterrupt()")
    told = outside(tmp_path, METHOD)("race", "hand-lcp", "--solver", "osqp", "--repeats", "1", "-o", "x.png")
    assert (told.returncode, said(told.stderr)) == (130, "icpmodel: interrupted\n")


@pytest.mark.slow
def test_after_ctrl_c_a_crosscheck_shows_what_was_done_before(tmp_path):
    solvers = [word for name in ("osqp", "pressed", "cvxpy-clarabel") for word in ("--solver", name)]
    command = outside(tmp_path, SOLVER)
    ran = command("crosscheck", "hand-lcp", *solvers)
    assert (ran.returncode, said(ran.stderr)) == (0, "")  # osqp had agreed
    assert ran.stdout.count("interrupted") == 2
    assert "1 of 1 independent solvers agree" in ran.stdout
    ran = command("crosscheck", "hand-lcp", "--solver", "pressed")
    assert ran.returncode == 1
    assert said(ran.stderr).startswith("icpmodel: not confirmed")


def test_explain_prints_a_page_and_json(capsys):
    code, out, err = call(capsys, "explain", "hand-cyclic")
    assert (code, err) == (0, "")
    assert "P-matrix                      yes" in out
    code, out, _ = call(capsys, "explain", "membrane", "--n", "25", "--method", "mnmgs", "--accuracy", "1e-3", "--json")
    told = json.loads(out)
    assert (code, told["accuracy"], told["unique"]) == (0, 1e-3, True)
    assert [method["method"] for method in told["methods"]] == ["MNMGS()"]
    assert told["methods"][0]["theorems"]["sharper"]["holds"] is True


def test_solve_to_an_accuracy_and_polish(capsys):
    code, out, _ = call(capsys, "solve", "membrane", "--n", "100", "--accuracy", "1e-3", "--json")
    assert code == 0
    assert json.loads(out)["error_bound"] <= 1e-3
    assert json.loads(out)["tolerance"] is None  # no residual was asked for
    code, out, _ = call(capsys, "solve", "membrane", "--n", "100", "--rtol", "1e-3", "--polish", "--json")
    assert code == 0
    assert json.loads(out)["error_bound"] <= 1e-11
    code, _, err = call(capsys, "solve", "membrane", "--accuracy", "1e-3", "--rtol", "1e-3")
    assert code == 2
    assert "give accuracy alone" in err


def test_stability_prints_counts_and_writes_figure_and_data(capsys, tmp_path):
    target = tmp_path / "map.png"
    code, out, err = call(capsys, "stability", "units", "--points", "3", "--n", "9", "-o", str(target))
    assert code == 0
    assert "proved, and yet failed: 0; as printed: " in out
    assert [line.split(".")[-1] for line in err.splitlines()] == ["png", "csv"]
    assert target.with_suffix(".csv").read_text().startswith("# icpmodel")
    code, out, err = call(capsys, "stability", "relaxation", "hand-lcp", "--points", "2", "--csv")
    assert code == 0
    assert len(out.splitlines()) == 5
    assert call(capsys, "stability", "relaxation", "hand-lcp", "--points", "2", "--latex")[1].count(r" \\") == 5
    assert "MNMAOR on" in call(capsys, "stability", "--points", "2", "--n", "9")[1]
    assert call(capsys, "stability", "units", "--set", "mu=1")[0] == 2
    assert call(capsys, "stability", "no-plane")[0] == 2
    assert call(capsys, "stability", "units", "-o", "no/such/folder/x.png")[0] == 2


@pytest.mark.slow
def test_a_report_is_written_and_its_exit_code_is_that_of_the_solve(capsys, tmp_path):
    page = tmp_path / "page.html"
    code, out, err = call(capsys, "report", "hand-lcp", "-o", str(page), "--time-limit", "5")
    assert (code, out) == (0, "")
    assert f"wrote {page}" in err
    assert "<h1>hand-lcp, 2 unknowns</h1>" in page.read_text()
    assert call(capsys, "report", "hard-jump", "-o", str(page), "--time-limit", "5")[0] == 1
    assert "cycled" in page.read_text()
    assert call(capsys, "report", "hand-lcp", "-o", "no/such/folder.html")[0] == 2


def test_a_race_is_printed_and_written(capsys, tmp_path):
    target = tmp_path / "race.png"
    asked = ("--method", "mnmgs", "--solver", "osqp", "--repeats", "1", "-o", str(target))
    code, out, _ = call(capsys, "race", "hand-lcp", *asked)
    assert code == 0
    assert "max |z - z*|" in out
    assert "mnmgs" in out
    assert out.startswith("First to Res_D(z) <= 1e-08 Res_D(0): ")
    assert target.exists()
    assert target.with_suffix(".csv").read_text().startswith("# icpmodel")
    assert call(capsys, "race", "hand-lcp", "--solver", "nonsense")[0] == 2


@pytest.mark.parametrize(
    "command",
    [
        ["race", "--repeats", "1", "-o", "q.png"],
        ["crosscheck", "--csv", "q.csv"],
        ["report", "-o", "q.html"],
        ["solve", "-o", "q.csv"],
    ],
)
def test_what_is_written_takes_the_place_of_nothing_else(capsys, tmp_path, monkeypatch, command):
    """The table beside a picture would have the name of the file of q."""
    monkeypatch.chdir(tmp_path)
    np.save("A.npy", 2.0 * np.eye(2))
    np.savetxt("q.csv", [-1.0, 3.0])
    (tmp_path / "q.html").write_text("<html></html>")
    code, out, err = call(capsys, command[0], "--A", "A.npy", "--q", "q.csv", *command[1:])
    assert (code, out) == (2, "")
    assert "is in the way" in err


COMPILES = """
import sys
from types import SimpleNamespace
import numba.core.event as event
import icpmodel.cli, icpmodel.cli.output, icpmodel.numerics.kernels as kernels
told = {"dispatcher": SimpleNamespace(py_func=SimpleNamespace(__module__=kernels.__name__))}
if sys.argv[1] == "command":
    with icpmodel.cli.output.compilation_announced():
        event.start_event("numba:compile", told)
else:
    event.start_event("numba:compile", told)
"""


@pytest.mark.parametrize(("who", "said"), [("command", "icpmodel ... compiles loops, each once"), ("library", "")])
def test_a_command_says_that_it_compiles_wherever_standard_error_goes_and_the_library_does_not(tmp_path, who, said):
    heard = run("-c", COMPILES, who, folder=tmp_path).stderr
    assert heard.startswith(said)
    assert bool(heard) is bool(said)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="a Linux device that is always full")
@pytest.mark.parametrize(
    ("command", "written"),
    [
        (["solve", "hand-lcp", "-o", "answer.npz"], "answer.npz"),
        (["stability", "relaxation", "hand-lcp", "--points", "2", "-o", "map.png"], "map.csv"),
    ],
)
def test_what_is_written_is_not_lost_where_the_text_cannot_be_printed(command, written, tmp_path):
    script = f"import sys; sys.stdout = open('/dev/full', 'w')\nfrom icpmodel.cli import main; main({command})"
    ran = run("-c", script, folder=tmp_path)
    assert ran.returncode == 2
    assert "cannot write the output: No space left on device" in ran.stderr
    assert (tmp_path / written).stat().st_size > 0


def test_a_reader_that_has_left_is_exit_code_2(tmp_path):
    script = (
        "import os, sys\nreader, writer = os.pipe(); os.close(reader)\n"
        "sys.stdout = open(writer, 'w', buffering=1)\nfrom icpmodel.cli import main; main(['scenes'])"
    )
    ran = run("-c", script, folder=tmp_path)
    assert (ran.returncode, said(ran.stderr)) == (2, "icpmodel: cannot write the output: Broken pipe\n")


def test_letters_that_standard_output_has_not_lose_nothing_else(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONIOENCODING", "latin-1")
    ran = run("-m", "icpmodel", "scenes", folder=tmp_path)
    assert (ran.returncode, said(ran.stderr)) == (0, "")


def test_a_wrong_limit_of_solvers_is_an_error_before_the_solve(capsys):
    code, out, err = call(capsys, "crosscheck", "hand-lcp", "--solver-time-limit", "0")
    assert (code, out) == (2, "")
    assert "--solver-time-limit is 0.0" in err
