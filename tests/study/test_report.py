"""The HTML page: in short first, self-contained, with every section, honest where something cannot be shown."""

import re
import shutil
import subprocess
from html.parser import HTMLParser

import numpy as np
import pytest

import icpmodel as icp

SECTIONS = [
    "The answer",
    "Certainty",
    "Second opinions",
    "Time against accuracy",
    "When the data change",
    "Before the solve",
    "Where relaxation works",
]
QUESTIONS = [
    "Is it solved?",
    "How certain is it?",
    "Which solvers agree?",
    "Which is the fastest?",
    "Does it have a derivative?",
]
#: a figure
STILL = '<svg role="img"'
#: elements that have no end tag
VOID = {"meta", "br", "path", "use", "image", "link", "rect", "input"}


class Page(HTMLParser):
    """Headings, what is loaded from elsewhere, and whether every tag is closed."""

    def __init__(self, text):
        super().__init__()
        self.open, self.headings, self.loaded, self.ids, self.used = [], [], [], [], []
        self.short = {}
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        if tag not in VOID:
            self.open.append(tag)
        for name, value in attributes:
            if name in ("src", "href", "xlink:href") and not value.startswith(("#", "data:")):
                self.loaded.append(value)
            if name == "id":
                self.ids.append(value)
            self.used += re.findall(r"url\(#([^)]+)\)", value or "")

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] == "h2":
            self.headings.append(data)
        if self.open and self.open[-1] == "dt":
            self.short[data] = ""
        if self.open and self.open[-1] == "dd":
            self.short[next(reversed(self.short))] += data


@pytest.fixture(scope="module")
def membrane(tmp_path_factory):
    scene = icp.scenes.membrane(n=100)
    solution = scene.problem.solve(history=True)
    written = tmp_path_factory.mktemp("report") / "page.html"
    page = icp.report(solution, written, title="A <membrane>", about=scene.models, points=scene.points, time_limit=5)
    assert written.read_text(encoding="utf-8") == page
    return page


@pytest.mark.slow
def test_the_page_has_every_section_and_loads_nothing(membrane):
    page = Page(membrane)
    assert page.headings == SECTIONS
    assert page.loaded == []
    assert page.open == []
    assert "A &lt;membrane&gt;" in membrane
    assert membrane.count(STILL) >= 7  # z, p, the way there, the contact closing in, the race in two panels, the map
    assert len(page.ids) == len(set(page.ids))
    assert set(page.used) <= set(page.ids)
    assert re.search(r"<title>solve\(\): [-+.e0-9]+, [-+.e0-9]+</title></use>", membrane)
    assert re.search(r"<title>steps to [^<]*: [0-9]+</title></path>", membrane)
    assert "Not shown" not in membrane
    assert "Where relaxation works" in membrane
    assert len(membrane) < 3_000_000


@pytest.mark.slow
def test_first_of_all_it_is_said_in_short_what_there_is_to_know(membrane):
    page = Page(membrane)
    assert list(page.short) == QUESTIONS
    solved, sure, agrees, quickest, derivative = page.short.values()
    assert solved.startswith("Yes, by ")
    assert sure.startswith("It is proved that no entry of z is off by more than ")
    assert "independent solvers agree" in agrees
    assert quickest.startswith("To 1e-08 of the residual at z = 0: ")
    assert derivative == "Yes, and this is proved: every row is proved to be at an obstacle or off it."
    assert membrane.index("<dl>") < membrane.index(STILL)


@pytest.mark.slow
def test_what_cannot_be_shown_is_said():
    solution = icp.scenes.hard_jump().problem.solve(raise_on_failure=False)
    page = icp.report(solution, title="jump", time_limit=5)
    assert Page(page).short["Is it solved?"].startswith("No: ")
    assert "Not known: " in Page(page).short["Does it have a derivative?"]
    assert Page(page).headings == SECTIONS
    says = [0.1] * 100_000
    gone = icp.ICP([[2.0]], [-1.0], lambda z: says.pop() * z).solve()
    says.clear()  # ψ has no value any more
    assert Page(icp.report(gone, time_limit=5)).headings == SECTIONS
    large = icp.report(icp.scenes.bai_symmetric(n=1089).problem.solve(), title="large", time_limit=5)
    assert "which is done up to n = 1000" in large


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"f": np.exp}, ["p = Az + q + f(z) ≥ 0", "; ψ does not depend on z."]),
        ({"upper": icp.Elementwise(np.cos)}, ["p = Az + q<", "; ψ does not depend on z; ψ̄ is a function of z that"]),
        ({"psi": -1.0, "upper": icp.Affine([[0.1]], 3.0)}, ["; ψ does not depend on z; ψ̄ depends on z: it is Gz + c."]),
    ],
)
def test_each_part_of_the_problem_is_described_as_it_is(arguments, says):
    page = icp.report(icp.ICP([[2.0]], [-5.0], **arguments), time_limit=1)
    assert all(one in page for one in says)
    assert "force p = Az + q with" not in page


@pytest.mark.parametrize(
    "wrong",
    [
        {"problem": 5},
        {"time_limit": 0},
        {"time_limit": float("nan")},
        {"path": 5},
        {"z_exact": [1.0, 2.0, 3.0]},
        {"z_exact": [1.0, float("nan")]},
        {"points": [[1.0, 2.0, 3.0, 4.0]]},
        {"points": "here"},
    ],
)
def test_wrong_arguments_are_named(wrong):
    arguments = {"problem": icp.scenes.hand_lcp().problem.solve(), "title": "x"} | wrong
    with pytest.raises(icp.InputError, match=f"^{next(iter(wrong))}(\\[1\\])? (is|has) "):
        icp.report(**arguments)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("chromium") is None, reason="no chromium on the PATH")
def test_a_browser_opens_it_offline(membrane, tmp_path):
    """The page as the browser sees it has all headings and figures."""
    (tmp_path / "page.html").write_text(membrane, encoding="utf-8")
    command = ["chromium", "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom", f"file://{tmp_path}/page.html"]
    seen = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout
    assert Page(seen).headings == SECTIONS
    assert seen.count(STILL) == membrane.count(STILL)
