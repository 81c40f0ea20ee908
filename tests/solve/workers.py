"""What workers of other processes are sent by the tests of `solve_many`: they find it by its name."""

import os
from functools import partial
from pathlib import Path

import numpy as np


def sine(z):
    return 0.3 * np.sin(z)


def dies(where, flag, z):
    """ψ whose process dies, but not that of the test, the first time if there is a `flag` to be left, else always."""
    if os.getpid() != where and not (flag and Path(flag).exists()):
        if flag:
            Path(flag).touch()
        os._exit(3)
    return sine(z)


def raises(z):
    raise SystemExit("ended by the user's own code")


def dying(flag=None):
    return partial(dies, os.getpid(), flag)
