"""Methods: one file per method or family, and the contract; nothing else."""

import importlib
import pkgutil

from .contract import Method, named, names

__all__ = ["Method", "named", "names"]

for _module in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_module.name}")
