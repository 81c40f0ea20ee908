"""The modules of the package, and what users reach in them."""

import importlib
import inspect
import pkgutil

import icpmodel


def modules():
    yield icpmodel
    for info in pkgutil.walk_packages(icpmodel.__path__, "icpmodel."):
        yield importlib.import_module(info.name)


def public_objects():
    """The names of the face, and those that a room lists in `__all__`."""
    for room in modules():
        for name in getattr(room, "__all__", ()):
            value = getattr(room, name)
            if inspect.isclass(value) or inspect.isfunction(value):
                yield f"{room.__name__}.{name}", value
