"""Each table of the documentation is measured by a command; the random families keep what they promise."""

import numpy as np
import pytest

from benchmarks.__main__ import NAMES, main, measured
from benchmarks.families import drawn, family_names

#: the smallest that each can be asked for, its first heads, and the number of its rows
SMALLEST = {
    "bounds": ({"n": 31, "trials": 1}, ("scene", "n", "z"), None),
    "certificate": ({"n": 100, "repeats": 1}, ("n", "bound", "s"), 3),
    "choice": ({"families": ("plate",), "low": 20, "high": 30, "most": 1, "own": ("psor",)}, ("family", "n"), 1),
    "constants": ({"sizes": (100,), "repeats": 1}, ("constant", "in the table, ns"), 10),
    "derivative": ({"sizes": (100,), "layers": (), "repeats": 1}, ("n", "derivative"), 3),
    "distributed": ({"sizes": (900,), "ranks": (1, 2), "repeats": 1}, ("scene", "n", "method", "ranks"), 5),
    "limit": ({"sizes": (100,), "repeats": 1}, ("problem", "n", "method"), 7),
    "members": ({"scenes": ("bai-symmetric,mu=0",), "sides": (10,), "phis": (0.0,)}, ("problem", "method"), 21),
    "memory": ({"scenes": ("membrane",), "sizes": (400,)}, ("scene", "n", "method", "A, MiB"), 1),
    "modelling": ({"cvxpy_n": 16, "pyomo_n": 9, "repeats": 1}, ("language", "model", "n"), 4),
    "nonmonotone": ({"sizes": (4,), "count": 2}, ("n", "solver", "solved", "of"), None),
    "programs": ({"size": 10, "repeats": 1}, ("program", "against"), 11),
    "small": ({"n": 4, "k": 2, "repeats": 1}, ("problems", "n", "OSQP with"), 4),
    "tuning": ({"scenes": ("ball",), "n": 16, "repeats": 1}, ("scene", "n", "theta"), 1),
}
SEMIDEFINITE = ("market-trade", "market-prices", "market-traffic", "contact", "program")


#: these have other solvers or processes to start
LONG = ("distributed", "limit", "memory", "programs")
each_table = [pytest.param(name, marks=[pytest.mark.slow] * (name in LONG)) for name in NAMES]


@pytest.mark.parametrize("name", each_table)
def test_a_table_has_its_heads_and_its_rows(name):
    """Of `members` the count for MMS is that of an independent implementation."""
    options, heads, rows = SMALLEST[name]
    try:
        table, below = measured(name, **options)
    except SystemExit as missing:
        pytest.skip(str(missing))
    assert table.heads[: len(heads)] == heads
    assert len(table.rows) == (rows or len(table.rows)) > 0
    assert {len(row) for row in table.rows} == {len(table.heads)}
    assert name != "choice" or list(below)[-1] == "not solved: none"
    assert name != "distributed" or {row[-1] for row in table.rows} == {""}
    assert name != "members" or table.rows[0][3] == 142


def test_the_command_prints_csv_and_refuses_what_a_table_does_not_know(capsys):
    main(["small", "--n", "4", "--k", "2", "--repeats", "1", "--csv"])
    assert capsys.readouterr().out.startswith("problems,n,OSQP with,")
    with pytest.raises(SystemExit):
        main(["small", "--sizes", "4"])


def test_a_family_draws_problems_by_its_seed_alone():
    """That these have a solution: `tests/solve/test_choice.py`."""
    for family in family_names():
        one, same, other = (drawn(family, 33, np.random.default_rng(seed)) for seed in (1, 1, 2))
        assert (one.A != same.A).nnz == 0, family
        assert np.array_equal(one.q, same.q), family
        assert not np.array_equal(one.q, other.q), family
        A = one.dense()
        least = np.linalg.eigvalsh(A + A.T)[0] / abs(A).max()
        if not family.startswith(("convection", "graph-directed", "market-leontief", "option")):
            assert least > (-1e-12 if family.startswith(SEMIDEFINITE) else 0.0), family
