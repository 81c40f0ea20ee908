"""The pages of `examples/`: the question of a script, its cells, each with what it printed and drew, and a notebook.

Nothing is run here. `python docs/record.py examples` runs the scripts and keeps what they print, with a hash of the
script that printed it, in `examples/output/`, and what they draw in `examples/figures/`. A script that was changed
since is a warning, hence an error. The tests run all scripts.

Prose is Markdown. What follows "Answer: " in a cell is folded, and its code with it; so is code that draws.
"""

import hashlib
import json
import logging
import re
import shutil
import struct
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
from lesson import CELL, cells, parts

#: below the logger of Sphinx, which counts the warnings; without an import, as the tests read this file too
LOG = logging.getLogger("sphinx.gallery")
ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
PAGES = ROOT / "docs" / "gallery"
#: the order of the gallery; a script that is in no group comes last
GROUPS = {
    "First steps": ["first_problem", "membrane", "three_front_ends"],
    "Ideas": ["modulus_in_one_unknown", "why_relaxation_helps"],
    "Machines and materials": ["friction_block", "box_stack", "journal_bearing", "thermal_explosion"],
    "Markets, games and money": ["nash_cournot", "market_equilibrium", "bimatrix_game", "american_option", "dividends"],
    "Fitting and design, by derivatives": [
        "recover_obstacle",
        "learn_friction",
        "calibrate_dividends",
        "design_contact",
    ],
    "Trust": [
        "what_a_bound_is_worth",
        "which_solver_do_you_believe",
        "when_methods_fail",
        "paper_under_the_microscope",
    ],
}

#: what a page offers to download
KINDS = {"ipynb": "notebook", "py": "script"}


def digest(script):
    """What the first line of a recorded output says of its script."""
    return f"# {script.name} {hashlib.sha256(script.read_bytes()).hexdigest()[:16]}\n"


def with_cells(code):
    """A script without lines "# %%" gets them where a paragraph begins with a comment, so far as cells stay whole."""
    if CELL.search(code):
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


def fold(words, lines):
    """What a reader may open."""
    return [f"<details><summary>{words}</summary>", "", *lines, "</details>", ""]


#: a link to another page, or to a place of the same one, which a notebook finds neither of
LINK = re.compile(r"\[([^\]]+)\]\((?!http)[^)\s]*\)")


def notebook(told, code):
    pieces = [("markdown", told, {})]
    for said, piece in cells(with_cells(code)):
        asked, _, answer = said.partition("\n\nAnswer: ")
        text = "\n".join([asked, "", *fold("Answer", [answer, ""])]).rstrip() if answer else said
        folded = {"jupyter": {"source_hidden": True}} if answer else {}
        pieces += [("markdown", text, {})] * bool(said) + [("code", piece, folded)] * bool(piece)
    empty = {"code": {"execution_count": None, "outputs": []}, "markdown": {}}
    made = []
    for k, (kind, text, about) in enumerate(pieces):
        lines = (LINK.sub(r"\1", text) if kind == "markdown" else text).splitlines(keepends=True)
        made.append({"cell_type": kind, "id": f"cell-{k}", "metadata": about, **empty[kind], "source": lines})
    python = {"name": "python3", "display_name": "Python 3", "language": "python"}
    return json.dumps(
        {"cells": made, "metadata": {"kernelspec": python}, "nbformat": 4, "nbformat_minor": 5}, ensure_ascii=False
    )


def pictures(script):
    """Those that the script drew, the one of its own name first."""
    figures = EXAMPLES / "figures"
    return [*figures.glob(f"{script.stem}.png"), *sorted(figures.glob(f"{script.stem}-*.png"))]


def kept_name(script, picture):
    """What a picture that a script drew is called in `examples/figures/`."""
    return picture if picture.startswith(script.stem) else f"{script.stem}-{picture}"


def recorded(script):
    """(whether it is of this script, [what a cell printed, the names of the pictures that it drew])."""
    kept = EXAMPLES / "output" / f"{script.stem}.txt"
    first, _, rest = kept.read_text(encoding="utf-8").partition("\n") if kept.exists() else ("", "", "")
    found = re.split(r"^# %%(.*)\n", rest, flags=re.MULTILINE)
    drawn = [[kept_name(script, one) for one in names.split()] for names in found[1::2]]
    return f"{first}\n" == digest(script), list(zip(found[0::2], drawn or [[]], strict=False))


def heading(script):
    if script.stem == "nash_cournot":  # two names
        return "Nash–Cournot"
    return script.stem.replace("_", " ").capitalize()


def question(script):
    return parts(script)[0].split("\n\n")[0].replace("\n", " ")


def opening(script):
    """A heading, and what the docstring says, the question in bold."""
    _, *rest = parts(script)[0].split("\n\n")
    return "\n\n".join([f"# {heading(script)}", f"**{question(script)}**", *rest])


def placed(name, alt):
    """A picture in its place; one of a single panel, which has the shape of a panel, fits on a phone as a whole."""
    width, height = struct.unpack(">II", (EXAMPLES / "figures" / name).read_bytes()[16:24])  # of a PNG file
    return [f"![{alt}]({name})" + "{.panel}" * (width < 2 * height), ""]


def shown(said, code, output, drawn, alt):
    """A cell on its page."""
    asked, _, answer = said.partition("\n\nAnswer: ")
    block = [f"```python\n{code}\n```", ""] if code else []
    result = [f"```text\n{output.strip(chr(10))}\n```", ""] if output.strip() else []
    result += [line for name in drawn for line in placed(name, alt)]
    if answer:
        return [asked, "", *fold("Answer", [answer, "", *block, *result])]
    if drawn:
        return [said, "", *result, *fold("How it is drawn", block)]
    return [*([said, ""] if said else []), *block, *result]


def page(script, outputs):
    links = [f"{{download}}`{words} <{script.stem}.{kind}>`" for kind, words in KINDS.items()]
    lines = [opening(script), "", " · ".join(links), ""]
    alt = f"what {script.name} draws: {question(script)}"
    outputs, drawn = iter(outputs), [name for _, names in outputs for name in names]
    lines += [line for one in pictures(script) if one.name not in drawn for line in placed(one.name, alt)]
    for said, piece in cells(parts(script)[1]):
        lines += shown(said, piece, *(next(outputs, ("", [])) if piece else ("", [])), alt)
    return "\n".join(lines)


def card(script):
    said = f"**[{heading(script)}]({script.stem}.md)** {question(script)}"
    found = pictures(script)
    if not found:
        return f":::{{container}} card\n{said}\n:::\n"
    return (
        f"```{{figure}} {found[0].name}\n:alt: {question(script)}\n:target: {script.stem}.html\n:figclass: card\n"
        f":loading: lazy\n\n{said}\n```\n"
    )


def index(scripts):
    """Cards by group; scripts of no group at the end."""
    placed = {stem for stems in GROUPS.values() for stem in stems}
    groups = {**GROUPS, "More": [one.stem for one in scripts if one.stem not in placed]}
    lines = [
        "# Gallery",
        "",
        "Lessons of ten minutes: a question, a model, what is seen, one thing to vary, and exercises whose answers are "
        "computed. Each can be downloaded as a notebook or as a script; the tests run all of them.",
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


def on_site(app, docname, source):
    """A repository shows the scripts of lessons, and what the site includes; the site has pages of them."""
    text = re.sub(r"\]\(\.\./examples/(\w+)\.py", r"](gallery/\1.md", source[0])
    text = text.replace("](../examples)", "](gallery/index.md)")
    source[0] = text.replace("](../CONTRIBUTING.md", "](contributing.md")


def generate(app):
    PAGES.mkdir(exist_ok=True)
    scripts = sorted(EXAMPLES.glob("*.py"))
    for script in scripts:
        fresh, outputs = recorded(script)
        if not fresh:
            logging.getLogger("sphinx.gallery").warning(
                "%s has changed: python docs/record.py %s", script.name, script.name
            )
        write(PAGES / f"{script.stem}.md", page(script, outputs))
        write(PAGES / f"{script.stem}.ipynb", notebook(opening(script), parts(script)[1]))
        for file in (script, *pictures(script)):
            shutil.copy2(file, PAGES)
    write(PAGES / "index.md", index(scripts))


def setup(app):
    app.connect("builder-inited", generate)
    app.connect("source-read", on_site)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
