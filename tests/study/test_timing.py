"""The harness: who runs when, and what is counted. Times are told, not taken."""

import pytest

from icpmodel.study.timing import clocked, interleaved, middle, timed


def told(log, name, *seconds):
    """A call that takes these seconds, in turn, and notes that it was run."""
    left = iter(seconds)

    def run():
        log.append(name)
        return next(left)

    return run


def test_each_round_begins_with_another_one():
    log = []
    calls = {name: told(log, name, *[1.0] * 4) for name in "abc"}
    assert [name for name, _ in interleaved(calls, 4)] == log
    assert "".join(log) == "abc" + "bca" + "cab" + "abc"


def test_ratios_are_those_of_the_pairs():
    """Both slow down by four in the second round: the ratio does not notice."""
    taken = timed({"ours": told([], "ours", 2.0, 8.0, 3.0), "theirs": told([], "theirs", 1.0, 4.0, 1.0)}, 3, warm=False)
    assert taken.ratio("ours", "theirs") == (2.0, 2.0, 3.0)
    assert taken.ratio("ours", "theirs", per=2.0) == (1.0, 1.0, 1.5)
    assert taken.median("ours", 1e-3) == pytest.approx(3000.0)


def test_a_first_run_that_compiles_does_not_count():
    taken = timed({"x": told([], "x", 100.0, 1.0, 1.0)}, 2)
    assert taken.seconds["x"].tolist() == [1.0, 1.0]


def test_short_calls_are_run_in_more_rounds():
    assert len(list(interleaved({"x": told([], "x", *[0.0] * 9)}, 2, most=7, within=60.0))) == 7
    assert len(list(interleaved({"x": told([], "x", *[0.0] * 9)}, 2, most=7, within=0.0))) == 2
    assert list(interleaved({}, 2, most=7, within=60.0)) == []


def test_what_was_run_before_ctrl_c_is_there():
    def stop():
        raise KeyboardInterrupt

    runs = []
    with pytest.raises(KeyboardInterrupt):
        runs.extend(name for name, _ in interleaved({"a": told([], "a", 1.0), "b": stop}, 1))
    seen = interleaved({"a": told([], "a", 1.0), "b": stop}, 1)
    assert next(seen)[0] == "a"


def test_what_a_call_is_given_is_made_anew_each_time_and_off_the_clock():
    given = iter("xyz")
    got = []
    run = clocked(got.append, lambda: next(given))
    assert run() >= 0.0
    run()
    assert got == ["x", "y"]


def test_a_median_is_of_so_many_calls_in_a_row():
    got = []
    assert middle(lambda: got.append(1), times=5, seconds=0.0)() >= 0.0
    assert len(got) == 5
