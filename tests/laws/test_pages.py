"""The pages of docs/ run as written, each by itself in an empty folder, and say what they show."""

import doctest
import re

import numpy as np
import pytest
from installed import HOUSE

PAGES = sorted((HOUSE / "docs").glob("*.md"))


def examples(page):
    """They, with the lines of Markdown around them, which are no output, left empty."""
    text = re.sub(r"^```.*$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return doctest.DocTestParser().get_doctest(text, {}, page.name, str(page), 0)


def test_there_are_pages():
    assert PAGES


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_page_runs_as_written(page, tmp_path, monkeypatch):
    if page.stem == "jax":
        pytest.importorskip("jax", reason="jax is not installed: pip install icpmodel[jax]")
    monkeypatch.chdir(tmp_path)
    said: list[str] = []
    with np.printoptions():
        ran = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS, verbose=False).run(examples(page), out=said.append)
    assert ran.attempted, "a page shows what it says"
    assert not said, "".join(said)
