"""The README and the pages of docs/: their examples run, their numbers are recorded, every name is on one."""

import doctest
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from installed import HOUSE, run
from shell import call

from icpmodel.cli import commands

DOCS = HOUSE / "docs"
sys.path.insert(0, str(DOCS))
sys.path.insert(0, str(DOCS / "_extensions"))

import gallery  # noqa: E402
import record  # noqa: E402

README = HOUSE / "README.md"
PAGES = [page for page in (README, *sorted(DOCS.glob("*.md"))) if ">>>" in page.read_text(encoding="utf-8")]
#: the pages that are read in the repository as well
READ = [README, HOUSE / "CONTRIBUTING.md", *sorted(DOCS.glob("*.md")), *sorted(DOCS.glob("api/*.md"))]
SCRIPTS = sorted(gallery.EXAMPLES.glob("*.py"))


def examples(page):
    """They, with the lines of Markdown around them, which are no output, left empty."""
    text = re.sub(r"^```.*$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return doctest.DocTestParser().get_doctest(text, {}, page.name, str(page), 0)


def statements(code):
    """The lines that are not empty and no comments."""
    return [line for line in code.splitlines() if line.strip() and not line.startswith("#")]


def said_wrongly(page):
    """What running the page says where it differs from what is written; nothing where it is as written."""
    said: list[str] = []
    with np.printoptions():
        ran = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS, verbose=False).run(examples(page), out=said.append)
    return "".join(said) if ran.attempted else "a page shows what it says"


#: a method that a page defines is registered, for all that its process does afterwards
ALONE = "import sys; sys.path.insert(0, sys.argv[1]); import pathlib, test_pages as t"
ALONE += "; sys.exit(t.said_wrongly(pathlib.Path(sys.argv[2])) or 0)"


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=[pytest.mark.slow] if page.stem == "research" else [], id=page.name) for page in PAGES],
)
def test_a_page_runs_as_written(page, tmp_path, monkeypatch):
    if page.stem == "jax":
        pytest.importorskip("jax", reason="jax is not installed: pip install icpmodel[jax]")
    if "(icp.Method)" in page.read_text(encoding="utf-8"):
        ran = run("-c", ALONE, str(Path(__file__).parent), str(page), folder=tmp_path)
        assert ran.returncode == 0, ran.stderr
        return
    monkeypatch.chdir(tmp_path)
    assert not (said := said_wrongly(page)), said


def test_every_public_name_has_one_entry_in_the_reference():
    """A name of several rooms is told of where users name it; rooms themselves are pages."""
    found = []
    for page in [*(DOCS / "api").glob("*.md"), DOCS / "cli.md"]:
        room = ""
        for line in page.read_text(encoding="utf-8").splitlines():
            directive = re.match(r"\.\. (?:py:)?(currentmodule|module|auto\w+):: (\S+)", line)
            if directive and directive[1] == "currentmodule":
                room = f"{directive[2]}."
            elif directive:
                found.append(directive[2] if directive[2].startswith("icpmodel.") else f"{room}{directive[2]}")
    assert len(found) == len(set(found))
    style = pytest.importorskip("house_style", reason="Sphinx, which comes with the extra docs, is not installed")
    assert set(style.public_names()) - set(found) == set()


def test_the_readme_is_short():
    assert len(README.read_text(encoding="utf-8").encode()) < 8192


@pytest.mark.parametrize("page", READ, ids=lambda page: str(page.relative_to(HOUSE)))
def test_every_link_of_a_page_has_a_text_and_leads_to_what_the_repository_holds(page):
    """Pages are read there too, where nothing is built, and an empty text shows nothing."""
    built = (HOUSE / ".gitignore").read_text(encoding="utf-8").split()
    text = re.sub(r"```(?!\{).*?```|`[^`\n]+`(?!\])", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    links = re.findall(r"\[([^\]]*)\]\(([^)#]*)[^)]*\)|(src)=\"([^\"]+)\"", text)
    for words, link, *picture in links:
        assert words or picture[0], (link, "has no text")
        target = (page.parent / (link or picture[1])).resolve()
        if not link.startswith("http"):
            assert target.exists(), target
            assert not str(target.relative_to(HOUSE)).startswith(tuple(built)), f"{link} is built, not kept"


def test_every_measured_number_of_the_readme_is_a_recorded_one():
    """What has a decimal point outside of code was printed by a command of the benchmarks, but for rounding."""
    prose = re.sub(r"```.*?```|`[^`]*`|Python ≥ [\d.]+", "", README.read_text(encoding="utf-8"), flags=re.DOTALL)
    outputs = record.BLOCK.findall((DOCS / "benchmarks.md").read_text(encoding="utf-8"))
    printed = [float(one) for _, output in outputs for one in re.findall(r"\d+\.\d+", output)]
    numbers = re.findall(r"\d+\.(\d+)", prose), re.findall(r"\d+\.\d+", prose)
    assert numbers[0]
    for digits, number in zip(*numbers, strict=True):
        assert any(f"{one:.{len(digits)}f}" == number for one in printed), number


def test_what_a_page_says_a_command_prints_is_what_it_prints(capsys):
    """Of the commands that are no measurements."""
    page = (DOCS / "certain.md").read_text(encoding="utf-8")
    [(command, output)] = record.BLOCK.findall(page)
    assert call(capsys, *command.split()[1:])[1] == output


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_the_notebook_of_a_script_is_its_code(script):
    """Comments that begin a cell become its text."""
    told, code = gallery.parts(script)
    cells = json.loads(gallery.notebook(told, code))["cells"]
    sources = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    for source in sources:
        compile(source, script.name, "exec")
    assert statements("\n".join(sources)) == statements(code)
    assert cells[0]["source"][0] in script.read_text(encoding="utf-8")


def test_every_command_is_on_the_page_of_the_command_line():
    told = (DOCS / "cli.md").read_text(encoding="utf-8")
    assert [name for name in commands.list_commands(None) if f"icpmodel {name}" not in told] == []


def test_code_of_a_page_has_at_most_88_columns():
    """The site cuts longer lines; what a program prints may be longer."""
    for page in (README, *sorted(DOCS.glob("*.md"))):
        for block in re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL):
            code = [line for line in block.splitlines() if line.startswith((">>> ", "... "))]
            assert [line for line in code if len(line) > 88] == [], page.name
