"""The HTML page: self-contained, with every section, honest where something cannot be shown."""

import re
import shutil
import subprocess
from html.parser import HTMLParser

import pytest

import icpmodel as icp

SECTIONS = [
    "Answer",
    "Picture",
    "What is certain before a solve",
    "Cross-check",
    "Sensitivity of the answer",
    "Race",
    "Where relaxation works",
]
#: elements that have no end tag
VOID = {"meta", "br", "path", "use", "image", "link", "rect"}


class Page(HTMLParser):
    """Headings, what is loaded from elsewhere, and whether every tag is closed."""

    def __init__(self, text):
        super().__init__()
        self.open, self.headings, self.loaded, self.ids, self.used = [], [], [], [], []
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


@pytest.fixture(scope="module")
def membrane():
    scene = icp.scenes.membrane(n=100)
    return icp.report(scene.problem.solve(), title="A <membrane>", about=scene.models, points=scene.points)


def test_the_page_has_every_section_and_loads_nothing(membrane):
    page = Page(membrane)
    assert page.headings == SECTIONS
    assert page.loaded == []
    assert page.open == []
    assert "A &lt;membrane&gt;" in membrane
    assert membrane.count("<svg") == 3
    assert "Not shown" not in membrane
    assert "independent checks agree" in membrane


def test_names_within_the_figures_do_not_meet(membrane):
    page = Page(membrane)
    assert len(set(page.ids)) == len(page.ids)
    assert set(page.used) <= set(page.ids)


def test_what_cannot_be_shown_is_said():
    solution = icp.scenes.hard_jump().problem.solve(raise_on_failure=False)
    page = icp.report(solution, title="jump", time_limit=5)
    assert "only the sensitivity of a solution can be told" in page
    assert Page(page).headings == SECTIONS
    large = icp.report(icp.scenes.bai_symmetric(n=1089).problem.solve(), title="large", time_limit=5)
    assert "which is done up to n = 1000" in large


@pytest.mark.parametrize("wrong", [{"problem": 5}, {"time_limit": 0}, {"time_limit": float("nan")}])
def test_wrong_wishes_are_named(wrong):
    arguments = {"problem": icp.scenes.hand_lcp().problem.solve(), "title": "x"} | wrong
    with pytest.raises(icp.InputError, match=f"^{next(iter(wrong))} is "):
        icp.report(**arguments)


@pytest.mark.skipif(shutil.which("chromium") is None, reason="no chromium on the PATH")
def test_a_browser_opens_it_offline(membrane, tmp_path):
    """The page as the browser sees it has all headings, both figures and no script."""
    (tmp_path / "page.html").write_text(membrane, encoding="utf-8")
    command = ["chromium", "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom", f"file://{tmp_path}/page.html"]
    seen = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout
    assert all(f"<h2>{heading}</h2>" in seen for heading in SECTIONS)
    assert seen.count("<svg") == 3
    assert "<script" not in seen
