"""The environment of the process: packages that extend this one, and whether it is a notebook."""

from __future__ import annotations

import builtins
from functools import lru_cache
from importlib.metadata import entry_points


@lru_cache(maxsize=1)
def load_plugins() -> None:
    """Import, once, the modules that installed packages announce as entry points of the group "icpmodel".

    A method, a foreign solver or a scene that such a module defines is found by its name from then on.
    """
    for one in entry_points(group="icpmodel"):
        one.load()


def in_notebook() -> bool:
    """Whether this runs in a notebook: IPython makes `get_ipython` a builtin, and a notebook's shell has a kernel."""
    get_ipython = getattr(builtins, "get_ipython", lambda: None)
    return getattr(get_ipython(), "kernel", None) is not None
