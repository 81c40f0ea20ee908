# ruff: noqa: F403  the scenes are listed nowhere but in their files
# For type checkers and editors: what the files of the gallery register is found by its name when the package runs.
from collections.abc import Callable
from typing import Any

from ..problem.by_rows import ByRows
from .contact import *
from .equilibria import *
from .hand import *
from .hard import *
from .impulse_control import *
from .lubrication import *
from .manufactured import *
from .nonlinear_forces import *
from .options import *
from .phases import *
from .plasticity import *
from .registry import Quantity as Quantity
from .registry import Scene as Scene
from .registry import register as register

def scene(name: str, /, n: int | None = None, **parameters: Any) -> Scene: ...
def by_rows(name: str, /, n: int | None = None, **parameters: Any) -> ByRows: ...
def names() -> list[str]: ...
def titles() -> dict[str, str]: ...
def parameters(name: str) -> dict[str, Any]: ...
def __getattr__(name: str) -> Callable[..., Scene]: ...  # those of plug-ins
