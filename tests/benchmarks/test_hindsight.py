"""How well solve() chooses: the ratios, who is stopped, what the summary says, and the command."""

import csv

import pytest

import icpmodel as icp
from icpmodel.benchmarks import choice, summary_of
from icpmodel.cli import main
from icpmodel.solvers import Claim
from icpmodel.study.charts.table_charts import choice_figure
from icpmodel.study.competitors import Competitor, Own

#: hand-lcp and its solution
LCP = ["gallery-hand-lcp"]


class _Told(Competitor):
    """One that takes so many seconds for the z that it is told, None for failure, and remembers its limits."""

    def __init__(self, kind, seconds, z=(0.5, 0.0), name=None):
        self.kind, self.name, self.seconds, self.z, self.limits = kind, name or f"told {kind}", seconds, z, []

    def attempt(self, case, tolerance, time_limit):
        self.limits.append(time_limit)
        return Claim(self.z, "stagnated" if self.z is None else "solved by lemke", self.z is not None, self.seconds)


def measured(*entrants, sizes=(2, 2, 1), **options):
    return choice(1, LCP, sizes, entrants=entrants, **options)


def row_of(*entrants):
    return measured(*entrants).records()[0]


@pytest.mark.parametrize(("own", "peer", "note"), [(2.0, 3.0, ""), (1.4, 3.0, "slow"), (3.0, 1.9, "slow")])
def test_a_ratio_above_two_to_the_best_own_method_or_above_one_and_a_half_to_a_peer_is_slow(own, peer, note):
    row = row_of(_Told("solve", 3.0), _Told("own", own), _Told("own", 9.0, name="late"), _Told("peer", peer))
    assert (row["solve() by"], row["best own method"]) == ("lemke", "told own")
    assert row["ratio"] == pytest.approx(3.0 / own)
    assert row["to told peer"] == pytest.approx(3.0 / peer)
    assert row["note"] == note


def test_an_own_method_has_three_times_the_best_so_far_and_a_peer_three_times_solve():
    entrants = _Told("solve", 2.0), _Told("own", 0.5), _Told("own", 1.0, name="second"), _Told("peer", 1.0)
    measured(*entrants, time_limit=100.0)
    assert [one.limits[0] for one in entrants] == [100.0, 6.0, 1.5, 6.0]


def test_where_solve_fails_the_row_says_why_and_who_does_not():
    row = row_of(_Told("solve", 1.0, z=None), _Told("own", 1.0))
    assert (row["solve() by"], row["best own method"], row["ratio"]) == ("", "told own", None)
    assert row["note"] == "not reached in 1 s: stagnated"


def test_ctrl_c_keeps_the_problems_that_were_measured_to_the_end():
    class Pressed(_Told):
        def attempt(self, case, tolerance, time_limit):
            if case.scene == "gallery-hard-many":
                raise KeyboardInterrupt
            return super().attempt(case, tolerance, time_limit)

    with pytest.raises(icp.Interrupted) as stopped:
        choice(1, [*LCP, "gallery-hard-many"], (2, 2, 1), entrants=[Own(), Pressed("own", 1.0)])
    assert [row[0] for row in stopped.value.report.rows] == LCP


def test_a_peer_that_misses_the_residual_has_no_ratio():
    assert row_of(_Told("solve", 1.0), _Told("own", 1.0), _Told("peer", 0.1, z=(0.501, 0.0)))["to told peer"] is None


def test_the_summary_counts_methods_by_family_and_names_failures():
    told = summary_of(measured(_Told("solve", 3.0), _Told("own", 1.0), _Told("peer", 2.0)))
    assert told[0] == "the best own method: median 3.00, worst 3.00 (gallery-hand-lcp, n = 2), above 2 in 1 of 1 cases"
    assert told[1].startswith("told peer: median 1.50, worst 1.50")
    assert told[2].startswith("solves by family of method (all): ")
    assert told[2].endswith("100%")
    assert told[-1] == "not solved: none"
    failed = summary_of(measured(_Told("solve", 1.0, z=None), _Told("own", 1.0)))
    assert failed[-2:] == ["not solved: 1", "  gallery-hand-lcp, n = 2: not reached in 1 s: stagnated"]


def test_the_figure_has_a_mark_for_each_kind_of_family_and_the_bounds():
    table = choice(1, ["plate", "gallery-hand-lcp"], (9, 20, 1), entrants=[_Told("solve", 1.0), _Told("own", 1.0)])
    left, right = choice_figure(table).axes
    assert left.get_legend_handles_labels()[1] == ["gallery", "plate", "not solved"]
    assert [max(line.get_ydata()) for axes in (left, right) for line in axes.lines if line.get_linestyle() == "--"] == [
        2.0,
        1.5,
    ]


def test_peers_take_part_only_in_their_own_problems():
    """An affine ψ and a nonsymmetric A make no energy to minimise; two fixed obstacles are bounds of one."""
    table = choice(1, ["graph-directed", "plate"], (10, 20, 1), own=["lemke"])
    for row in table.records():
        peers = [row[head] for head in table.heads if head.startswith("to ")]
        assert (row["family"] in ("plate", "plate+box")) == any(ratio is not None for ratio in peers)


def test_wrong_names_are_told_before_the_work():
    for options, words in (
        ({"families": ["moon"]}, "there is no family 'moon'"),
        ({"families": ["gallery-moon"]}, "families has 'gallery-moon'"),
        ({"own": ["nwton"]}, "own has 'nwton'"),
        ({"seed": -1}, "seed is -1"),
        ({"repeats": 1}, "repeats is 1"),
    ):
        with pytest.raises(icp.InputError, match=words):
            choice(**options)


def test_the_command_prints_the_ratios_and_the_summary_and_writes_the_figure(capsys, tmp_path):
    target = tmp_path / "choice.png"
    asked = ["--seed", "3", "--family", "graph-expander", "--family", "contact-chain", "--sizes", "10", "30", "1"]
    more = ["--most", "3", "--own", "lemke", "--own", "psor", "--no-peers", "-o", str(target)]
    with pytest.raises(SystemExit) as stop:
        main(["benchmark", "choice", *asked, *more])
    out = capsys.readouterr().out
    assert stop.value.code == 0
    assert "seed 3" in out
    assert "not solved: none" in out
    command, *rows = target.with_suffix(".csv").read_text().splitlines()
    assert command.startswith("# icpmodel benchmark choice --seed 3 --family graph-expander")
    assert len(list(csv.reader(rows))) == 4
    assert target.stat().st_size > 1000
