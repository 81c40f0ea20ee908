"""icpmodel: state an implicit complementarity problem, solve it, and have independent solvers check the answer.

Find z with p = Az + q ≥ 0, r = z − ψ(z) ≥ 0 and pᵀr = 0.

>>> import icpmodel as icp
>>> problem = icp.ICP([[2, -1], [-1, 2]], [-1, 3])
>>> problem.solve().z.round(6) + 0.0
array([0.5, 0. ])
"""

import importlib as _importlib
from typing import Any as _Any

from .driver import solve
from .errors import (
    FileError,
    IcpError,
    InputError,
    Interrupted,
    MapError,
    NotApplicable,
    NotSolved,
    SingularOperator,
)
from .files import load_problem, load_solution, save_problem, save_solution
from .intervention import Intervention
from .loop import Progress
from .maps import Affine, Constant, Elementwise, Function, Map
from .methods import Method
from .methods.mms import MMS
from .methods.modulus import MNMAOR, MNMGS, MNMJ, MNMMOD, MNMOD, MNMSOR, NMMS, Modulus, ProjectionFixedPoint
from .methods.psor import PSOR
from .problem import ICP
from .solution import Certificate, History, Solution, Status, certify
from .splittings import AOR
from .theory import ErrorBound, comparison_matrix, error_bound

__version__ = "0.1.0"

__all__ = [
    "AOR",
    "ICP",
    "MMS",
    "MNMAOR",
    "MNMGS",
    "MNMJ",
    "MNMMOD",
    "MNMOD",
    "MNMSOR",
    "NMMS",
    "PSOR",
    "Affine",
    "Certificate",
    "Constant",
    "Elementwise",
    "ErrorBound",
    "FileError",
    "Function",
    "History",
    "IcpError",
    "InputError",
    "Interrupted",
    "Intervention",
    "Map",
    "MapError",
    "Method",
    "Modulus",
    "NotApplicable",
    "NotSolved",
    "Progress",
    "ProjectionFixedPoint",
    "SingularOperator",
    "Solution",
    "Status",
    "certify",
    "comparison_matrix",
    "error_bound",
    "load_problem",
    "load_solution",
    "save_problem",
    "save_solution",
    "solve",
]

#: rooms that most scripts do not need; loaded when first named
_ROOMS = ("crosscheck", "measure", "scenes")


def __getattr__(name: str) -> _Any:
    if name in _ROOMS:
        return _importlib.import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
