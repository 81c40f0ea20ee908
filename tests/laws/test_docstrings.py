"""The examples in the docstrings run. They may use np, sp, icp and ICP without saying where these come from."""

import doctest
import importlib
import pkgutil

import numpy as np
import pytest
import scipy.sparse as sp

import icpmodel as icp

NAMES = {"np": np, "sp": sp, "icp": icp, "ICP": icp.ICP}
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
#: examples that take long, or need PETSc
SLOW = ("study.html_report", "distributed")
#: the modules of each room; the face is one of its own
ROOMS = {"": [icp.__name__], SLOW[0]: [f"icpmodel.{SLOW[0]}"]}
for info in pkgutil.walk_packages(icp.__path__, "icpmodel."):
    if info.name not in ("icpmodel.__main__", *ROOMS[SLOW[0]]):
        ROOMS.setdefault(info.name.split(".")[1], []).append(info.name)


@pytest.mark.parametrize("room", [pytest.param(room, marks=[pytest.mark.slow] * (room in SLOW)) for room in ROOMS])
def test_the_examples_of_a_room_run(room):
    if room == "distributed":
        pytest.importorskip("petsc4py", reason="petsc4py is not installed: CONTRIBUTING.md says how to get it")
    said: list[str] = []
    finder = doctest.DocTestFinder(exclude_empty=True)
    for module in map(importlib.import_module, ROOMS[room]):
        for example in finder.find(module, extraglobs=NAMES):
            doctest.DocTestRunner(optionflags=FLAGS, verbose=False).run(example, out=said.append)
    assert not said, "".join(said)
