"""Tables and cards: nothing is lost, numbers align, HTML is escaped, CSV goes through without loss."""

import csv
import io
import re
import sys

import numpy as np
import pytest

import icpmodel as icp
from icpmodel.present import Card, Table

TABLE = Table(
    "Times [s] of <all>",
    ("who", "n", "time, s", "note"),
    (
        ("psor", 900, 0.123456789, 'says "solved" & is not, which is told at some length'),
        ("multilevel", 1_000_000, None, ""),
        ("[bold]x[/bold]", 7, 1e-20, "ok"),
    ),
)


class Screen(io.StringIO):
    """A terminal."""

    def isatty(self):
        return True


def test_numbers_end_and_texts_begin_in_one_column():
    title, heads, *rows = str(TABLE).splitlines()
    assert title == TABLE.title
    assert rows[0].index("says") == heads.index("note")
    assert {row.index(n) + len(n) for row, n in zip(rows, ("900", "1000000", "7"), strict=True)} == {
        heads.index("n ") + 1
    }
    assert rows[1].split() == ["multilevel", "1000000", "-"]
    assert rows[2].startswith("[bold]x[/bold]")


def test_on_a_terminal_lines_fit_and_nothing_is_lost(monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    monkeypatch.setattr("sys.stdout", Screen())
    lines = str(TABLE).splitlines()
    assert max(map(len, lines)) <= 60
    for row in TABLE.rows:
        for word in str(row[3]).split():
            assert any(word in line for line in lines)
    assert any("0.1235" in line for line in lines)
    assert max(map(len, str(Card({"row": "word " * 80})).splitlines())) <= 60


def test_a_table_is_a_data_frame_with_the_numbers_in_full():
    pytest.importorskip("pandas")
    frame = TABLE.to_dataframe()
    assert list(frame.columns) == list(TABLE.heads)
    assert frame["time, s"][0] == 0.123456789
    assert frame["time, s"].isna().tolist() == [False, True, False]
    assert frame["n"].dtype == np.int64
    history = icp.scenes.hand_lcp().problem.solve("mnmgs", history=True).history
    assert (history.to_dataframe()["Res_D(z)"] == history.residual).all()
    assert icp.solve_many([[2.0]], [[-2.0], [3.0]]).to_dataframe()["status"].tolist() == ["solved", "solved"]
    report = icp.crosscheck(icp.ICP([[3.0]], [-1.0]), [1 / 3], ["osqp"])
    assert report.to_dataframe()["seconds"].tolist() == [report.rows[0].seconds]
    assert len(icp.stability("units", points=2, n=9).to_dataframe()) == 4


def test_without_pandas_it_is_said_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(icp.NotApplicable, match="pip install pandas"):
        TABLE.to_dataframe()


def test_html_has_all_cells_escaped():
    page = TABLE.to_html()
    assert "<caption>Times [s] of &lt;all&gt;</caption>" in page
    assert "says &#34;solved&#34; &amp; is not" in page
    cells = re.findall(r"<td[^>]*>([^<]*)</td>", page)
    assert len(cells) == 12
    assert cells[1:3] == ["900", "0.1235"]
    assert page.count("text-align:right") == 6
    assert "&lt;b&gt;" in Card({"x": "<b>"}).to_html()


def test_csv_has_numbers_in_full():
    heads, *rows = csv.reader(io.StringIO(TABLE.to_csv()))
    assert tuple(heads) == TABLE.heads
    assert float(rows[0][2]) == 0.123456789
    assert rows[0][3] == TABLE.rows[0][3]
    assert rows[1][2] == ""


def test_latex_escapes_texts_and_sets_numbers_as_formulas():
    """Braces balance, no line begins with what LaTeX would read as an argument of the line before."""
    special = Table(
        "50 % of {a_b} & <c>", ("who", "RES"), (("[x]~^\\$#", -1.5e-9), ("*", np.inf), ("y|", -2), ("z", None))
    )
    lines = special.to_latex().splitlines()
    assert lines[2] == r"\caption{50 \% of \{a\_b\} \& \textless{}c\textgreater{}}"
    assert lines[3] == r"\begin{tabular}{lr}"
    assert [line for line in lines if line.endswith(r"\\")][1:] == [
        r"{[}x{]}\textasciitilde{}\textasciicircum{}\textbackslash{}\$\# & $-1.5 \times 10^{-9}$ \\",
        r"{*} & inf \\",
        r"y\textbar{} & $-2$ \\",
        r"z & -- \\",
    ]
    assert r"\addlinespace" not in lines
    assert [line for line in lines if "rule" in line] == [r"\toprule", r"\midrule", r"\bottomrule"]
