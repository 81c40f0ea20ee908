"""Run a script of examples/ as its notebook is run: cell by cell, in one namespace, with the words of a kernel.

python docs/lesson.py SCRIPT      in the folder where its pictures shall lie

After what a cell prints comes a line "# %%" with the names of the pictures that it drew.
"""

import re
import runpy
import sys
from pathlib import Path

#: where a cell begins
CELL = re.compile(r"^# %%.*\n", re.MULTILINE)
#: what a Jupyter kernel finds in sys.argv
KERNEL = ["ipykernel_launcher.py", "-f", "kernel-1.json"]


def parts(script):
    """(docstring without its last paragraph on how to run it, the code after it)."""
    text = script.read_text(encoding="utf-8")
    _, told, code = text.split('"""', 2)
    told = "\n\n".join(one for one in told.strip().split("\n\n") if not one.startswith("Run:"))
    return told, code.lstrip("\n")


def cells(code):
    """(comment as prose or "", code) for what lies between the lines that begin with "# %%"."""
    for piece in CELL.split(code):
        prose = re.match(r"(?:#.*\n)*", piece)[0] if piece != code else ""
        text = "\n".join(line.removeprefix("#").removeprefix(" ").rstrip() for line in prose.splitlines())
        yield text.strip("\n"), piece[len(prose) :].strip("\n")


def main(script):
    _, code = parts(script)
    if not CELL.search(code):  # no lesson
        sys.argv = [str(script)]
        runpy.run_path(str(script), run_name="__main__")
        return
    namespace, there = {"__name__": "__main__"}, set(Path().glob("*.png"))
    sys.argv = KERNEL
    for k, (_, piece) in enumerate(one for one in cells(code) if one[1]):
        exec(compile(piece, f"{script.name}, cell {k + 1}", "exec"), namespace)
        drawn = sorted(set(Path().glob("*.png")) - there)
        there |= {*drawn}
        print(" ".join(["# %%", *map(str, drawn)]), flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
