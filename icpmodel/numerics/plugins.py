"""What is around: what other packages add, the way to a public name of this one, and whether a notebook is."""

from __future__ import annotations

import sys
from functools import lru_cache
from importlib.metadata import entry_points
from typing import Any


@lru_cache(maxsize=1)
def load_plugins() -> None:
    """Import, once, the modules that installed packages announce as entry points of the group "icpmodel".

    A method, a foreign solver or a scene that such a module defines is found by its name from then on.
    """
    for one in entry_points(group="icpmodel"):
        one.load()


def public(name: str) -> Any:
    """The public `name` of the package, through its front door: the one way in which a room reaches one above it, when
    a verb is called."""
    return getattr(sys.modules[__name__.partition(".")[0]], name)


def in_notebook() -> bool:
    """Whether this runs in a notebook, where standard output is no terminal and yet somebody looks on."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return getattr(shell, "kernel", None) is not None
