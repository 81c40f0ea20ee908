"""icpmodel: state an implicit complementarity problem, solve it, and have independent solvers check the answer.

Find z with p = Az + q ≥ 0, r = z − ψ(z) ≥ 0 and pᵀr = 0.

>>> import icpmodel as icp
>>> problem = icp.ICP([[2, -1], [-1, 2]], [-1, 3])
>>> problem.solve().z.round(6) + 0.0
array([0.5, 0. ])
"""

import importlib as _importlib
from typing import TYPE_CHECKING
from typing import Any as _Any

if TYPE_CHECKING:
    from .driver import solve as solve
    from .errors import FileError as FileError
    from .errors import IcpError as IcpError
    from .errors import InputError as InputError
    from .errors import Interrupted as Interrupted
    from .errors import MapError as MapError
    from .errors import NotApplicable as NotApplicable
    from .errors import NotSolved as NotSolved
    from .errors import SingularOperator as SingularOperator
    from .files import load_problem as load_problem
    from .files import load_solution as load_solution
    from .files import save_problem as save_problem
    from .files import save_solution as save_solution
    from .intervention import Intervention as Intervention
    from .loop import Progress as Progress
    from .many import Solutions as Solutions
    from .many import solve_many as solve_many
    from .maps import Affine as Affine
    from .maps import Constant as Constant
    from .maps import Elementwise as Elementwise
    from .maps import Function as Function
    from .maps import Map as Map
    from .measure.racing import race as race
    from .measure.stability_map import stability as stability
    from .methods import Method as Method
    from .methods.accelerated import Accelerated as Accelerated
    from .methods.josephy import Josephy as Josephy
    from .methods.lemke import Lemke as Lemke
    from .methods.mms import MMS as MMS
    from .methods.modulus import MNMAOR as MNMAOR
    from .methods.modulus import MNMGS as MNMGS
    from .methods.modulus import MNMJ as MNMJ
    from .methods.modulus import MNMMOD as MNMMOD
    from .methods.modulus import MNMOD as MNMOD
    from .methods.modulus import MNMSOR as MNMSOR
    from .methods.modulus import NMMS as NMMS
    from .methods.modulus import Modulus as Modulus
    from .methods.modulus import ProjectionFixedPoint as ProjectionFixedPoint
    from .methods.multilevel import Multilevel as Multilevel
    from .methods.newton import Newton as Newton
    from .methods.psor import PSOR as PSOR
    from .methods.reduced import Reduced as Reduced
    from .methods.tridiagonal import Tridiagonal as Tridiagonal
    from .modelling.cvxpy_problem import Complementarity as Complementarity
    from .modelling.cvxpy_problem import Problem as Problem
    from .modelling.cvxpy_problem import complements as complements
    from .modelling.cvxpy_solver import cvxpy_solver as cvxpy_solver
    from .problem import ICP as ICP
    from .solution import Certificate as Certificate
    from .solution import History as History
    from .solution import Solution as Solution
    from .solution import Status as Status
    from .solution import certify as certify
    from .splittings import AOR as AOR
    from .theory import ErrorBound as ErrorBound
    from .theory import comparison_matrix as comparison_matrix
    from .theory import error_bound as error_bound

__version__ = "0.1.0"

#: public name → the room that holds it; a room is loaded when one of its names is first used, so that the import itself
#: costs next to nothing. The list above says the same to type checkers; a test holds the two together.
_HOMES = {
    "driver": ("solve",),
    "errors": (
        "FileError",
        "IcpError",
        "InputError",
        "Interrupted",
        "MapError",
        "NotApplicable",
        "NotSolved",
        "SingularOperator",
    ),
    "files": ("load_problem", "load_solution", "save_problem", "save_solution"),
    "intervention": ("Intervention",),
    "loop": ("Progress",),
    "many": ("Solutions", "solve_many"),
    "maps": ("Affine", "Constant", "Elementwise", "Function", "Map"),
    "measure.racing": ("race",),
    "measure.stability_map": ("stability",),
    "methods": ("Method",),
    "methods.accelerated": ("Accelerated",),
    "methods.josephy": ("Josephy",),
    "methods.lemke": ("Lemke",),
    "methods.mms": ("MMS",),
    "methods.modulus": (
        "MNMAOR",
        "MNMGS",
        "MNMJ",
        "MNMMOD",
        "MNMOD",
        "MNMSOR",
        "NMMS",
        "Modulus",
        "ProjectionFixedPoint",
    ),
    "methods.multilevel": ("Multilevel",),
    "methods.newton": ("Newton",),
    "methods.psor": ("PSOR",),
    "methods.reduced": ("Reduced",),
    "methods.tridiagonal": ("Tridiagonal",),
    "modelling.cvxpy_problem": ("Complementarity", "Problem", "complements"),
    "modelling.cvxpy_solver": ("cvxpy_solver",),
    "problem": ("ICP",),
    "solution": ("Certificate", "History", "Solution", "Status", "certify"),
    "splittings": ("AOR",),
    "theory": ("ErrorBound", "comparison_matrix", "error_bound"),
}
_HOME = {name: room for room, names in _HOMES.items() for name in names}
#: rooms that are public as such
_ROOMS = ("crosscheck", "measure", "methods", "scenes", "theory")

__all__ = sorted(_HOME)


def __getattr__(name: str) -> _Any:
    if name in _HOME:
        value = getattr(_importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
        globals()[name] = value
        return value
    if name in _ROOMS:
        return _importlib.import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME, *_ROOMS})
