"""What other packages add: methods, foreign solvers, scenes."""

from __future__ import annotations

from functools import lru_cache
from importlib.metadata import entry_points


@lru_cache(maxsize=1)
def load_plugins() -> None:
    """Import, once, the modules that installed packages announce as entry points of the group "icpmodel".

    A method, a foreign solver or a scene that such a module defines is found by its name from then on.
    """
    for one in entry_points(group="icpmodel"):
        one.load()
