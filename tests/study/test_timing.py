"""The harness: who runs when, and what is counted. Times are told, not taken."""

import pytest
from benchmarks.harness import time_calls, timer

from icpmodel.study.timing import run_interleaved


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
    assert [name for name, _ in run_interleaved(calls, 4)] == log
    assert "".join(log) == "abc" + "bca" + "cab" + "abc"


def test_a_first_run_that_compiles_does_not_count():
    taken = time_calls({"x": told([], "x", 100.0, 1.0, 1.0)}, 2)
    assert taken["x"].tolist() == [1.0, 1.0]


def test_what_was_run_before_ctrl_c_is_there():
    def stop():
        raise KeyboardInterrupt

    runs = []
    with pytest.raises(KeyboardInterrupt):
        runs.extend(name for name, _ in run_interleaved({"a": told([], "a", 1.0), "b": stop}, 1))
    seen = run_interleaved({"a": told([], "a", 1.0), "b": stop}, 1)
    assert next(seen)[0] == "a"


def test_what_a_call_is_given_is_made_anew_each_time_and_off_the_clock():
    given = iter("xyz")
    got = []
    run = timer(got.append, lambda: next(given))
    assert run() >= 0.0
    run()
    assert got == ["x", "y"]
