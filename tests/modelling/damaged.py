"""Files that are cut, changed or set as traps, for the tests of what reads them."""

import contextlib
import os

import numpy as np

import icpmodel as icp


class Trap:
    """Unpickling this creates a file."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return open, (str(self.path), "w")


def read_or_refused(load, *arguments):
    """What is read, None where one of our errors says that it cannot be."""
    with contextlib.suppress(icp.FileError):
        return load(*arguments)


def cut(path):
    """The file at `path` without its last byte, its last two, and so on."""
    for size in reversed(range(path.stat().st_size)):
        os.truncate(path, size)
        yield path


def mutated(path, seed, count):
    """The file at `path` with a byte changed, each in turn."""
    rng, whole = np.random.default_rng(seed), path.read_bytes()
    with path.open("r+b", buffering=0) as file:
        for place in rng.integers(len(whole), size=count):
            os.pwrite(file.fileno(), rng.bytes(1), place)
            yield path
            os.pwrite(file.fileno(), whole[place : place + 1], place)
