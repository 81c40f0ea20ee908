"""Every example runs as written, in an empty folder, and says what it should."""

import re
import sys

import pytest
from installed import HOUSE, run

sys.path.insert(0, str(HOUSE / "docs" / "_extensions"))

import gallery

EXAMPLES = HOUSE / "examples"

#: a phrase, or several, of each example's output that only a right answer produces
SAYS = {
    "first_problem.py": "2 of 2 independent solvers agree.",
    "paper_under_the_microscope.py": (
        "4.4 case 2       fails      the same",
        "Of 20 statements 8 hold, 5 were mended and 7 fail. 0 are not shown by their numbers.",
    ),
    "modulus_in_one_unknown.py": (
        "6.0         0.5000               0.5000             0.5000",
        "predicted: 40, counted: 40",
        "Omega = 0.01667 leaves 0.7143",
        "certified to be the only solution: False",
    ),
    "why_relaxation_helps.py": (
        "the best one, 1.6895, is 8.4 times as fast",
        "0.9517      inf",
        "full steps: 0.8165, 0.3854, 0.2616, 0.2602, 0.2602, 0.2602",
        "319 points: best 1.9558,  306 sweeps instead of  27043",
        "proved up to 1.00",
    ),
    "what_a_bound_is_worth.py": (
        "residuals of 0, 1/2 and 1: [0.0, 5e-07, 0.0]",
        "A is not positive definite: A[0, 0] = -1e-06 is not positive",
        "100   3.2e-05   3.3e-03   3.3e-03     5.7e-02          198",
        "that are proved 0\n",
    ),
    "membrane.py": "median force per area there: 16\n",
    "dividends.py": "2.14369",
    "market_equilibrium.py": "1.0    2.7938    3.3663    3.0683      2.7281",
    "american_option.py": "the put is worth 6.09; a binomial tree gives 6.09",
    "friction_block.py": "0.3    16.75 deg   16.70 deg       0.4856 m/s",
    "box_stack.py": ("rank of A: 9 of 12", "0.5    18.5 deg   topples", "carries 1.000000 of the weight"),
    "journal_bearing.py": "0.5            0.7458      219.2 deg    1.0759",
    "nash_cournot.py": ("3   20.0      30.0   18.333       18.333              0.000", "price 38.333, sold 61.667"),
    "bimatrix_game.py": (
        "Lemke's pivoting: stagnated",
        "certified to be the only solution: False",
        "4 equilibria, 0 faces of others, all found: True",
        "third standard worth  1.0: 7 equilibria",
    ),
    "three_front_ends.py": ("CVXPY and NumPy: the same z to 1e-9", "Pyomo and NumPy: the same z to 1e-9"),
    "which_solver_do_you_believe.py": (
        "     OSQP  optimal   0.0",  # and not 1.0759
        " icpmodel   solved   1.0759",
        "0 of 1 independent solvers agree, 1 disagrees.",
        "1 of 2 independent solvers agree, 1 loose.",
    ),
    "calibrate_dividends.py": (
        "0.1200   0.0501   0.0008   0.0500",
        "0.3006   0.0008   0.3000",
        "4.5788 to the left, 4.4811 to the right",
    ),
    "thermal_explosion.py": ("molten: top 5.0000", "heat 3.5: mild top 1.0923", "heat 3.4: the top grows by 1.143"),
    "learn_friction.py": ("friction coefficient 0.2988 ± 0.0009, true 0.3", "certain in 60 of 60", "0.0   0.8000"),
    "design_contact.py": ("uniform load            512      24             828    2994", "               0    3822"),
    "recover_obstacle.py": ("misfit / noise²: 0.97", "0.0022      0.0024", "hangs free, not seen", "certain: True"),
    "when_methods_fail.py": (
        "Lemke() infeasible: no z has Az + q >= 0 and z >= psi(z)",
        " 0.100   -5.000   converges          -  cycled",
    ),
}

MORE_FIGURES = {
    "which_solver_do_you_believe.py": {"which_solver_race.png"},
    "paper_under_the_microscope.py": {"paper_counterexamples.png"},
}


def test_every_example_is_run():
    assert sorted(path.name for path in EXAMPLES.glob("*.py")) == sorted(SAYS)


def phrases(name):
    return [SAYS[name]] if isinstance(SAYS[name], str) else SAYS[name]


@pytest.mark.slow
@pytest.mark.parametrize("name", SAYS)
def test_an_example_runs_as_written_and_as_a_notebook(name, tmp_path):
    """Cell by cell in one namespace, with the `sys.argv` of a kernel: both are the same statements."""
    ran = run(str(HOUSE / "docs" / "lesson.py"), str(EXAMPLES / name), folder=tmp_path)
    assert (ran.returncode, ran.stderr) == (0, "")
    for phrase in phrases(name):
        assert phrase in ran.stdout
    stem = name.removesuffix(".py")
    assert {path.name for path in tmp_path.iterdir()} == {f"{stem}.png", f"{stem}.svg"} | MORE_FIGURES.get(name, set())


@pytest.mark.parametrize("name", SAYS)
def test_the_gallery_shows_the_right_answer_of_each_script_as_it_is_now(name):
    kept = (EXAMPLES / "output" / name.replace(".py", ".txt")).read_text(encoding="utf-8")
    assert kept.startswith(gallery.digest(EXAMPLES / name)), f"python docs/record.py {name}"
    for phrase in phrases(name):
        assert phrase in kept, f"python docs/record.py {name}"


#: the parts of a lesson after its question, in this order
PARTS = ["The model", "What is seen", "Vary one thing", "Exercises"]
PAPER = EXAMPLES / "paper_under_the_microscope.py"
each_lesson = pytest.mark.parametrize(
    "lesson", sorted({EXAMPLES / name for name in SAYS} - {PAPER}), ids=lambda x: x.stem
)


def cells_by_part(path):
    """{part: [(its prose, its code, what was recorded of it)]}"""
    found, part, (_, outputs) = {}, "", gallery.recorded(path)
    outputs = iter(outputs)
    for prose, code in gallery.cells(gallery.parts(path)[1]):
        heading = re.match(r"## (.*)\n", prose)
        part = heading[1] if heading else part
        found.setdefault(part, []).append((prose, code, next(outputs)[0] if code else ""))
    assert not list(outputs)
    return found


@each_lesson
def test_a_lesson_has_its_parts_and_exercises_whose_answers_are_computed(lesson):
    assert gallery.question(lesson).endswith("?")
    parts = cells_by_part(lesson)
    assert [one for one in parts if one] == PARTS
    assert len(parts["Exercises"]) >= 2
    for prose, code, output in parts["Exercises"]:
        assert "\n\nAnswer: " in prose
        assert "print(" in code
        assert output.strip()


def numbers(text):
    return re.findall(r"(?<![\w.])\d+\.\d+(?![\w.])", text)


@each_lesson
def test_every_number_of_a_lessons_prose_is_in_its_code_or_printed_by_it(lesson):
    """But for rounding: no sentence can say another number than what is computed beside it."""
    cells = [cell for part in cells_by_part(lesson).values() for cell in part]
    there = [float(one) for _, code, output in cells for one in numbers(code + output)]
    for number in numbers(gallery.parts(lesson)[0] + "".join(prose for prose, *_ in cells)):
        digits = len(number.partition(".")[2])
        assert any(f"{one:.{digits}f}" == number for one in there), number


def statements(source):
    """{name of a statement: (the heading of its cell, the code that it needs)} of the lesson on the paper."""
    found, before = {}, []
    for said, code in gallery.cells(source):
        judged = re.search(r'^judge\(\s*"(.+?)"', code, re.MULTILINE)
        if judged:
            found[judged[1]] = re.findall(r"^### (.+)", said, re.MULTILINE)[-1], "\n".join([*before, code])
        if not judged or re.search(r"^def ", code, re.MULTILINE):
            before.append(code)
        if "savefig" in code:
            return found
    return found


def test_the_headings_of_the_paper_say_the_verdicts_that_are_computed():
    text = (EXAMPLES / "output" / PAPER.name.replace(".py", ".txt")).read_text(encoding="utf-8")
    assert not re.search("^NO |NOT SHOWN", text, re.MULTILINE)
    found = statements(gallery.parts(PAPER)[1])
    assert len(found) == 20
    for name, (heading, _) in found.items():
        assert re.search(rf"^{re.escape(name)} +{heading.rpartition(': ')[2]} ", text, re.MULTILINE), name


@pytest.mark.parametrize(
    ("right", "wrong", "name"),
    [("phi1 * phi if corrected", "phi if corrected", "4.4 case 1"), ("- phi1 * A\n", "+ phi1 * A\n", "4.4 case 2")],
)
def test_a_wrong_number_or_sign_is_marked(right, wrong, name, capsys):
    """The lesson with one thing changed says which statement is no longer shown, and keeps no verdict on it."""
    heading, code = statements(gallery.parts(PAPER)[1])[name]
    assert code.count(right) >= 1
    namespace = {}
    exec(compile(code.replace(right, wrong), heading, "exec"), namespace)
    assert namespace["FOUND"][name][0] == "NOT SHOWN"
    assert re.search("^NO ", capsys.readouterr().out, re.MULTILINE)
