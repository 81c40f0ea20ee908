"""What the front ends for modelling languages cost, against what those languages do with the same model themselves."""

from __future__ import annotations

import io
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import InputError
from ..maps import Affine, Elementwise
from ..modelling.pyomo_reader import read_pyomo
from ..scenes import scene
from .tables import Table, machine


def pyomo_cost(n: int = 100_000, repeats: int = 3) -> Table:
    """Time of reading a Pyomo model against that of Pyomo's NL writer for the same expressions, timed in turn.

    The models are the membrane with its fixed obstacle, with ψ affine, a quarter of each of two neighbours, and with ψ
    nonlinear, 0.3 sin(z_i) + c_i. The writer gets the 2n sides as constraints, side ≥ 0, which spares it Pyomo's
    transformation of complementarity conditions. The ratio is the median of the ratios pair by pair.
    Parameters: `n` conditions (the nearest square), `repeats` ≥ 3. Returns a `Table` (seconds).

    >>> pyomo_cost(n=100, repeats=3).heads
    ('model', 'n', 'read, s', 'NL writer, s', 'ratio', 'lowest', 'highest')
    """
    if repeats < 3:
        raise InputError(f"repeats is {repeats}; at least 3 were expected")
    from pyomo.repn.plugins.nl_writer import NLWriter

    rows = []
    for name, model in _models(n):
        pairs = []
        for _ in range(repeats):
            model.sides.deactivate()
            model.complementarity.activate()
            begin = time.perf_counter()
            read_pyomo(model)
            between = time.perf_counter()
            model.sides.activate()
            model.complementarity.deactivate()
            middle = time.perf_counter()
            NLWriter().write(model, io.StringIO())
            pairs.append((between - begin, time.perf_counter() - middle))
        ours, writer = np.array(pairs).T
        ratios = ours / writer
        median = (float(np.median(x)) for x in (ours, writer, ratios))
        rows.append((name, len(model.z), *median, float(ratios.min()), float(ratios.max())))
    heads = ("model", "n", "read, s", "NL writer, s", "ratio", "lowest", "highest")
    return Table(f"Reading a Pyomo model against writing it ({machine()})", heads, tuple(rows))


def _models(n: int) -> Iterator[tuple[str, Any]]:
    """Models with `complementarity`, and its 2n sides as constraints `sides`."""
    import pyomo.environ as pyo

    problem = scene("membrane", n).problem
    m, c = int(np.sqrt(problem.n)), problem.psi.value(np.zeros(problem.n))
    neighbours = sp.diags_array([0.25, 0.25], offsets=[-1, 1], shape=(m, m))
    models = {
        "constant psi": problem,
        "affine psi": problem.with_psi(Affine(sp.kron(sp.eye_array(m), neighbours), c)),
        "nonlinear psi": problem.with_psi(Elementwise(lambda z: 0.3 * np.sin(z), c=c)),
    }
    for name, one in models.items():
        model = one.to_pyomo()
        pairs = [condition._args for condition in model.complementarity.values()]
        model.sides = pyo.Constraint(range(problem.n), [0, 1], rule=lambda _, i, k, pairs=pairs: pairs[i][k])
        yield name, model
