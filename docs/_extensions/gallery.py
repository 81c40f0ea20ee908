"""The pages of `examples/`: what a script says of itself, its picture, what it printed, its code, and a notebook of it.

Nothing is run here. `python docs/record.py examples` runs the scripts and keeps what they print, with a hash of the
script that printed it, in `examples/output/`, and what they draw in `examples/figures/`. A script that was changed
since is a warning, hence an error. The tests run all scripts.
"""

import hashlib
import json
import re
import shutil
import textwrap
from pathlib import Path

from sphinx.util import logging

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
PAGES = ROOT / "docs" / "gallery"
#: the order of the gallery; a script that is in no group comes last
GROUPS = {
    "First steps": ["first_problem", "membrane", "three_front_ends"],
    "Machines and materials": ["friction_block", "journal_bearing"],
    "Markets, games and money": [
        "nash_cournot",
        "market_equilibrium",
        "bimatrix_game",
        "american_option",
        "dividends",
    ],
    "Fitting and design, by derivatives": [
        "recover_obstacle",
        "learn_friction",
        "calibrate_dividends",
        "design_contact",
    ],
    "Trust": ["which_solver_do_you_believe", "when_methods_fail", "paper_under_the_microscope"],
}


def digest(script):
    """What the first line of a recorded output says of its script."""
    return f"# {script.name} {hashlib.sha256(script.read_bytes()).hexdigest()[:16]}\n"


def parts(script):
    """(docstring without its last paragraph on how to run it, the code after it)."""
    text = script.read_text(encoding="utf-8")
    _, told, code = text.split('"""', 2)
    told = "\n\n".join(one for one in told.strip().split("\n\n") if not one.startswith("Run:"))
    return told, code.lstrip("\n")


def cells(code):
    """(comment as prose or "", code) for what lies between the lines that begin with "# %%"."""
    for piece in re.split(r"^# %%.*\n", code, flags=re.MULTILINE):
        prose = re.match(r"(?:#.*\n)*", piece)[0] if piece != code else ""
        yield "\n".join(line.removeprefix("#").strip() for line in prose.splitlines()), piece[len(prose) :].strip("\n")


def prose(text):
    """Text of a docstring as Markdown: indented lines are formulas."""
    found = []
    for paragraph in text.split("\n\n"):
        if paragraph.startswith("    "):
            found.append(f"```text\n{textwrap.dedent(paragraph)}\n```")
        else:
            found.append(re.sub(r"(?<!\w)[*_]|[*_](?!\w)|<", r"\\\g<0>", paragraph))
    return "\n\n".join(found)


def with_cells(code):
    """A script without lines "# %%" gets them where a paragraph begins with a comment, so far as cells stay whole."""
    if re.search(r"^# %%", code, flags=re.MULTILINE):
        return code
    whole: list[str] = []
    for piece in re.split(r"\n\n+(?=# )", code):
        try:
            compile(piece, "cell", "exec")
            compile(whole[-1] if whole else "", "cell", "exec")
            whole.append(piece)
        except SyntaxError:
            whole[-1:] = ["\n\n".join([*whole[-1:], piece])]
    return "\n# %%\n".join(whole)


def notebook(told, code):
    pieces = [("markdown", told)]
    for said, piece in cells(with_cells(code).replace('matplotlib.use("Agg")\n', "")):  # pictures appear in notebooks
        pieces += [("markdown", said)] * bool(said) + [("code", piece)] * bool(piece)
    extra = {"code": {"execution_count": None, "outputs": []}, "markdown": {}}
    made = [
        {"cell_type": kind, "id": f"cell-{k}", "metadata": {}, **extra[kind], "source": text.splitlines(keepends=True)}
        for k, (kind, text) in enumerate(pieces)
    ]
    python = {"name": "python3", "display_name": "Python 3", "language": "python"}
    return json.dumps(
        {"cells": made, "metadata": {"kernelspec": python}, "nbformat": 4, "nbformat_minor": 5}, ensure_ascii=False
    )


def pictures(script):
    """Those that the script drew, the one of its own name first."""
    figures = EXAMPLES / "figures"
    return [*figures.glob(f"{script.stem}.png"), *sorted(figures.glob(f"{script.stem}-*.png"))]


def page(script, output):
    told, code = parts(script)
    title, *rest = told.split("\n\n")
    lines = [f"# {script.stem.replace('_', ' ').capitalize()}", "", f"**{prose(title)}**", ""]
    lines += [prose("\n\n".join(rest)), ""] if rest else []
    for picture in pictures(script):
        alt = f"what {script.name} draws: {title.splitlines()[0]}"
        lines += [f"![{alt}]({picture.name})", ""]
    lines += ["## What it prints", "", f"```text\n{output}```", "", "## The code", ""]
    for said, piece in cells(code):
        lines += [prose(said), ""] if said else []
        lines += [f"```python\n{piece}\n```", ""] if piece else []
    lines += [
        f"{{download}}`{script.stem}.ipynb <{script.stem}.ipynb>` · {{download}}`{script.name} <{script.name}>`",
        "",
    ]
    return "\n".join(lines)


def card(script):
    name = script.stem.replace("_", " ").capitalize()
    question = parts(script)[0].split("\n\n")[0].replace("\n", " ")
    said = f"**[{name}]({script.stem}.md)** {prose(question)}"
    found = pictures(script)
    if not found:
        return f":::{{container}} card\n{said}\n:::\n"
    return (
        f"```{{figure}} {found[0].name}\n:alt: {question}\n:target: {script.stem}.html\n:figclass: card\n"
        f":loading: lazy\n\n{said}\n```\n"
    )


def index(scripts):
    """Cards by group; scripts of no group at the end."""
    placed = {stem for stems in GROUPS.values() for stem in stems}
    groups = {**GROUPS, "More": [one.stem for one in scripts if one.stem not in placed]}
    lines = [
        "# Gallery",
        "",
        "Scripts of `examples/`, each with what it prints and draws; below each page are the script and a notebook to "
        "download. The tests run all of them.",
        "",
    ]
    listed = []
    for title, stems in groups.items():
        here = [one for stem in stems for one in scripts if one.stem == stem]
        listed += [one.stem for one in here]
        cards = [line for one in here for line in card(one).splitlines()]
        lines += [f"## {title}", "", "::::{container} gallery", *cards, "::::", ""] if here else []
    return "\n".join([*lines, "```{toctree}", ":hidden:", *listed, "```", ""])


def write(path, text):
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def generate(app):
    PAGES.mkdir(exist_ok=True)
    scripts = sorted(EXAMPLES.glob("*.py"))
    for script in scripts:
        kept = EXAMPLES / "output" / f"{script.stem}.txt"
        first, _, output = kept.read_text(encoding="utf-8").partition("\n") if kept.exists() else ("", "", "")
        if f"{first}\n" != digest(script):
            logging.getLogger(__name__).warning("%s has changed: python docs/record.py %s", script.name, script.name)
        told, code = parts(script)
        write(PAGES / f"{script.stem}.md", page(script, output))
        write(PAGES / f"{script.stem}.ipynb", notebook(told, code))
        for file in (script, *pictures(script)):
            shutil.copy2(file, PAGES)
    write(PAGES / "index.md", index(scripts))


def setup(app):
    app.connect("builder-inited", generate)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
