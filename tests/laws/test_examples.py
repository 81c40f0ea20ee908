"""Every example runs as written, in an empty folder, and says what it should."""

import functools
import runpy
import sys

import pytest
from installed import HOUSE, run

EXAMPLES = HOUSE / "examples"

#: a phrase, or several, of each example's output that only a right answer produces
SAYS = {
    "first_problem.py": "The answer is confirmed",
    "paper_under_the_microscope.py": "4.4 (2)      FALSE AS PRINTED",
    "membrane.py": "median force per area there: 16\n",
    "dividends.py": "2.14369",
    "market_equilibrium.py": "1.0    2.7938    3.3663    3.0683      2.7281",
    "american_option.py": "the put is worth 6.09; a binomial tree gives 6.09",
    "friction_block.py": "0.3    16.75 deg   16.70 deg       0.4856 m/s",
    "journal_bearing.py": "0.5            0.7458      219.2 deg    1.0759",
    "nash_cournot.py": ("3   20.0      30.0   18.333       18.333              0.000", "price 38.333, sold 61.667"),
    "bimatrix_game.py": (
        "Lemke's pivoting: stagnated",
        "certified to be the only solution: False",
        "opera with probability 0.75 and 0.25",
        "3 equilibria were found",
    ),
    "three_front_ends.py": ("CVXPY and NumPy: the same z to 1e-9", "Pyomo and NumPy: the same z to 1e-9"),
    "which_solver_do_you_believe.py": (
        "2999      OSQP  optimal   0.0",  # and not 1.0759
        "2999  icpmodel   solved   1.0759",
        "0 of 1 independent checks agree; 1 disagrees. The answer is not confirmed.",
        ". The answer is confirmed.",
    ),
    "calibrate_dividends.py": (
        "0.1200   0.0501   0.0008   0.0500",
        "0.3006   0.0008   0.3000",
        "4.3928 to the left and 4.3471",
    ),
    "learn_friction.py": ("friction coefficient 0.2994 ± 0.0005, true 0.3", "slips in 0 steps", "certain: True"),
    "design_contact.py": ("uniform load           1204      66            1470    6138", "               0    7608"),
    "recover_obstacle.py": ("misfit / noise²: 0.99", "touches    35", "0.0012      0.0013", "hangs free, not seen"),
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
        "100   6.3e-05   3.3e-03   3.3e-03     5.7e-02    198 by the sharp one",
        "that are proved 0\n",
    ),
    "when_methods_fail.py": "Lemke() infeasible: no z has Az + q >= 0 and z >= psi(z)",
}

WITHOUT_FIGURE = {"first_problem.py", "paper_under_the_microscope.py", "when_methods_fail.py"}


def test_every_example_is_run():
    assert sorted(path.name for path in EXAMPLES.glob("*.py")) == sorted(SAYS)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """The name of an example → (what it said, the names of the files that it left in its empty folder), run once."""

    @functools.cache
    def of(name):
        folder = tmp_path_factory.mktemp("empty")
        return run(str(EXAMPLES / name), folder=folder), {path.name for path in folder.iterdir()}

    return of


@pytest.mark.parametrize("name", SAYS)
def test_an_example_runs_as_written(name, runs):
    ran, files = runs(name)
    assert ran.returncode == 0, ran.stderr
    assert ran.stderr == ""
    for phrase in [SAYS[name]] if isinstance(SAYS[name], str) else SAYS[name]:
        assert phrase in ran.stdout
    stem = name.removesuffix(".py")
    figures = set() if name in WITHOUT_FIGURE else {f"{stem}.png", f"{stem}.svg"}
    if name == "which_solver_do_you_believe.py":
        figures |= {"which_solver_race.png"}
    assert files == figures


@pytest.mark.parametrize("name", SAYS)
def test_what_the_gallery_shows_says_it_as_well(name):
    kept = (EXAMPLES / "output" / name.replace(".py", ".txt")).read_text(encoding="utf-8")
    for phrase in [SAYS[name]] if isinstance(SAYS[name], str) else SAYS[name]:
        assert phrase in kept, f"python docs/record.py {name}"


PAPER = EXAMPLES / "paper_under_the_microscope.py"


def test_the_paper_is_judged_by_numbers_that_are_computed(runs):
    """Every verdict is shown by every line, and the counterexamples have the numbers of the theory."""
    text = runs(PAPER.name)[0].stdout
    assert "NO  " not in text
    assert "NOT SHOWN" not in text
    assert text.count("FALSE AS PRINTED") == 2 * 7  # beside the numbers and in the table
    for number in (
        "the limit is 0.250000\n",
        "with only the + restored 0.500000\n",
        "the limit is [0.75 0.5 ]\n",
        "rho(L) is at most 0.283196, below 1\n",
        "|e0| = [0. 2.], |e1| = [1.    0.125]",
        "is at most 0.500001, below 1 (but the theorem as printed is false)\n",
        "[ 56. -10.  56.]\n",
        "multiplies the error by -3\n",
        "the spectral radius 1.1514\n",
        "the condition as printed: 0.01 > 0; corrected: -0.07 < 0\n",
        "multiplies the error by -1.375\n",
        "multiplies the error by -1.85714\n",
    ):
        assert number in text, number


def ended(monkeypatch, path, *words):
    """What the example at `path`, run with these words, hands to sys.exit."""
    monkeypatch.setattr(sys, "argv", [str(path), *words])
    with pytest.raises(SystemExit) as end:
        runpy.run_path(str(path), run_name="__main__")
    return end.value.code


def test_words_choose_the_statements(monkeypatch, capsys):
    """What begins with a word is read, in the order of the paper; an unknown word is answered with what there is."""
    assert not ended(monkeypatch, PAPER, "4.3", "2.1")
    lines = capsys.readouterr().out.splitlines()
    names = [line[1 : line.index("]")] for line in lines if line.startswith("[")]
    assert names == ["2.1", "4.3 ()", "4.3 phi", "4.3 theta2"]
    assert "nothing begins with 5; there are: 2 M, 2.1" in ended(monkeypatch, PAPER, "5")


@pytest.mark.parametrize(
    ("right", "wrong", "name"),
    [
        ("phi1 * phi if corrected", "phi if corrected", "4.4 (1)"),
        ("- phi2 * G", "+ phi2 * G", "4.4 (1)"),
        ("min(phi2, phi1 * A) - phi1", "min(phi2, phi1 * A) + phi1", "4.4 (2)"),
        ("phi=-1.5", "phi=1.5", "4.3 phi"),
        ("theta2=-4.0", "theta2=4.0", "4.3 theta2"),
        ("icp.Affine([[-5.0]], 6.0)", "icp.Affine([[-0.5]], 1.5)", "4.3 ()"),
        ("np.array([1.0, 3.0])", "np.array([3.0, 1.0])", "4.1 proof"),
        ("- P1 @ q + P2", "- P1 @ q - P2", "3 method"),
        ("z4 - 2 * np", "z4 + 2 * np", "3 method"),
        ("two * z4 + one", "two * z4 - one", "3.1"),
        ("[[1e-6]], [-1e-6]", "[[2.0]], [-2.0]", "3 Res"),
        ("q + psi) - q + psi", "q + theta * psi) - q + theta * psi", "3 MNMMOD"),
        ("- np.tril(A, -1), np.triu", "+ np.tril(A, -1), -np.triu", "3 L, U"),
        ("x + y == np.abs(x - y)", "x - y == np.abs(x - y)", "2.1"),
        ("a * U4) / a", "a * U4 + phi4) / a", "3 members"),
        ("two / one), z4)", "two * one), z4)", "3 Remark"),
    ],
)
def test_a_wrong_number_or_sign_is_marked(right, wrong, name, tmp_path, monkeypatch, capsys):
    """The example with one thing changed ends with status 1, and says which statement is no longer shown."""
    source = PAPER.read_text(encoding="utf-8")
    assert source.count(right) >= 1
    changed = tmp_path / "changed.py"
    changed.write_text(source.replace(right, wrong), encoding="utf-8")
    assert ended(monkeypatch, changed, name) == 1
    assert "NOT SHOWN" in capsys.readouterr().out
