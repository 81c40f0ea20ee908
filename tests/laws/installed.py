"""A package as if it were installed: its entry points are found by a process that this house's package is loaded in."""

import os
import subprocess
import sys
from pathlib import Path

import icpmodel

#: the folder of the package under test
HOUSE = Path(icpmodel.__file__).parent.parent


def announce(folder, name, entry_points):
    """Make `folder` hold the distribution `name` with these entry points, group → {name: object}."""
    about = folder / f"{name}-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    groups = (f"[{group}]\n" + "\n".join(f"{k} = {v}" for k, v in one.items()) for group, one in entry_points.items())
    (about / "entry_points.txt").write_text("\n".join(groups))


def run(*arguments, folder):
    """Python with these arguments, in `folder`, of which it sees the modules and distributions before all others."""
    path = os.pathsep.join([str(folder), str(HOUSE)])
    environment = {**os.environ, "PYTHONPATH": path}
    return subprocess.run(
        [sys.executable, *arguments], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
