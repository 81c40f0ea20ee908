"""The examples in the docstrings run. They may use np, sp, icp and ICP without saying where these come from."""

import doctest
import importlib
import pkgutil

import numpy as np
import pytest
import scipy.sparse as sp

import icpmodel as icp

NAMES = {"np": np, "sp": sp, "icp": icp, "ICP": icp.ICP}
MODULES = ["icpmodel", *(info.name for info in pkgutil.walk_packages(icp.__path__, "icpmodel."))]
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] if name == "icpmodel.study.html_report" else [])
        for name in MODULES
        if name != "icpmodel.__main__"
    ],
)
def test_the_examples_of_a_module_run(name):
    if name.startswith("icpmodel.distributed"):
        pytest.importorskip("petsc4py", reason="petsc4py is not installed: CONTRIBUTING.md says how to get it")
    module = importlib.import_module(name)
    said: list[str] = []
    for example in doctest.DocTestFinder(exclude_empty=True).find(module, extraglobs=NAMES):
        doctest.DocTestRunner(optionflags=FLAGS, verbose=False).run(example, out=said.append)
    assert not said, "".join(said)
