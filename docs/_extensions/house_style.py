"""Docstrings as this house writes them, plain text with names in backticks, and a link for every public name.

A name in backticks, on a page or in a docstring, becomes a link where it is public: `ICP`, `icp.race`, `solve()`,
`theory.check`, `Solution.polish`; inside of the entry of a class or of a room also its members alone.
"""

import importlib
import inspect
import re
from functools import cached_property

from docutils import nodes
from sphinx import addnodes
from sphinx.transforms import SphinxTransform
from sphinx.util.docutils import SphinxDirective

import icpmodel

#: the rooms that have public names of their own
ROOMS = (
    "cli",
    "crosscheck",
    "derivatives",
    "distributed",
    "explain",
    "methods",
    "modelling",
    "modelling.jax",
    "modelling.pyomo",
    "present",
    "scenes",
    "solve",
    "solvers",
    "study",
    "theory",
)


#: words of other packages as well, which mean ours only where `icp` stands before them
OTHERS = ("Complementarity", "Problem", "complements")


#: what pages call an object of a class
INSTANCES = {
    "solution": "icpmodel.Solution",
    "certificate": "icpmodel.Certificate",
    "derivative": "icpmodel.Derivative",
    "bound": "icpmodel.ErrorBound",
}


#: pages whose verbs are those of a class
SPEAK_OF = {"cvxpy": "icpmodel.Problem"}


def public_names():
    """{where it is documented: the object} of what users may name: at the face, if it is there, else in its room."""
    found = {f"icpmodel.{name}": getattr(icpmodel, name) for name in icpmodel.__all__}
    for room in ROOMS:
        module = importlib.import_module(f"icpmodel.{room}")
        for name in module.__all__:
            value = getattr(module, name)
            if not any(value is known for known in found.values()):
                found[f"{module.__name__}.{name}"] = value
    return found


def targets():
    """{as it is written: where it leads}, longer ways of writing included."""
    found = {}
    verbs = {id(value): path for path, value in public_names().items()}
    for path, value in public_names().items():
        short = path.removeprefix("icpmodel.")
        found |= {path: path, f"icp.{short}": path} | ({short: path} if short not in OTHERS else {})
        if inspect.isclass(value):
            found |= {f"{short}.{member}": where for member, where in members(value, verbs)}
            if issubclass(value, icpmodel.Method) and value.__dict__.get("name"):
                found.setdefault(value.name, path)
    for room in ROOMS:
        module = importlib.import_module(f"icpmodel.{room}")
        for name in module.__all__:
            told = next(path for path, value in public_names().items() if value is getattr(module, name))
            ways = [f"{room}.{name}", f"icp.{room}.{name}", f"icpmodel.{room}.{name}"]
            if (name != name.lower() or "_" in name) and name not in OTHERS:
                ways.append(name)  # no word of the language
            for way in ways:
                found.setdefault(way, told)
    for word, path in INSTANCES.items():
        found |= {f"{word}.{name}": where for name, where in members(public_names()[path], verbs)}
    return found


SECTION = re.compile(r"(Parameters|Reference|Returns|Raises|Yields)\b")
VECTOR = re.compile(
    r"~?(numpy\.)?ndarray\[tuple\[~?(typing\.)?Any, \.\.\.\], ~?(numpy\.)?dtype\[~?(numpy\.)?float64\]\]"
)
ERRORS = re.compile(r"\b(\w+Error|NotApplicable|NotSolved|SingularOperator|Interrupted)\b")


def members(owner, known):
    """(name, where it is documented) of the members of a class that are: with the class that introduces it."""
    for name in dir(owner):
        home = next((one for one in owner.__mro__ if name in vars(one)), None)
        if name.startswith("_") or home is None:
            continue
        if id(getattr(owner, name)) in known:
            yield name, known[id(getattr(owner, name))]
        elif inspect.isroutine(vars(home)[name]) or isinstance(vars(home)[name], property | cached_property):
            told = [one for one in owner.__mro__ if name in vars(one) and vars(one)[name].__doc__]
            place = owner if owner is icpmodel.ICP else told[0] if told else None
            if id(place) in known:
                yield name, f"{known[id(place)]}.{name}"


class Links(SphinxTransform):
    """Names in backticks become references, but in headings, and in the entry of the very name."""

    default_priority = 400
    known = targets()

    def apply(self, **kwargs):
        for block in self.document.findall(nodes.literal_block):  # doctest wants an empty line at the end, nobody else
            block.rawsource = block.astext().rstrip()
            block[:] = [nodes.Text(block.rawsource)]
        for typed in self.document.findall(addnodes.desc_annotation):  # of properties; functions: see `short_types`
            if VECTOR.search(typed.astext()):
                typed[:] = [nodes.Text(VECTOR.sub("Vector", typed.astext()))]
        for node in list(self.document.findall(nodes.literal)):
            if isinstance(node.parent, nodes.reference | nodes.title | addnodes.pending_xref | addnodes.desc_name):
                continue
            text = re.sub(r"\(.*\)$", "", node.astext())
            target = self.target_of(text, *self.around(node))
            if target:
                reference = addnodes.pending_xref(
                    "", refdomain="py", reftype="obj", reftarget=target, refexplicit=True, refwarn=True
                )
                reference["refdoc"] = self.env.docname
                node.replace_self(reference)
                reference += node

    def around(self, node):
        """The ids of the entries that hold the node, the innermost first."""
        found = []
        while node is not None:
            if isinstance(node, addnodes.desc) and node.get("domain") == "py":
                found.append(node[0]["ids"][0] if node[0]["ids"] else "")
            node = node.parent
        return [*found, SPEAK_OF.get(self.env.docname, "")]

    def target_of(self, text, *entries):
        for entry in entries:
            room = entry.rpartition(".")[0]
            for inside in (f"{entry.removeprefix('icpmodel.')}.{text}", f"{room}.{text}"):
                if inside in self.known and entry:
                    return None if self.known[inside] in entries else self.known[inside]
        target = self.known.get(text)
        return None if target in entries else target


def as_rst(lines):
    """The lines of a docstring of this house as reStructuredText."""
    found: list[tuple[bool, str]] = []  # whether it is prose, and the line
    kind = ""
    for line in lines:
        text = line.strip()
        section = SECTION.match(text)
        ended = found[-1:] and found[-1][1].endswith(".") and text[:1].isupper()
        if not text:
            kind = ""
        elif text.startswith(">>>") or kind == "example":
            kind = "example"
            found.append((False, line))
            continue
        elif line.startswith("    ") and kind in ("", "formula"):
            found += [(False, one) for one in ("", "::", "")] if not kind else []
            kind = "formula"
            found.append((False, line))
            continue
        elif section and section[1] == "Parameters":
            kind = "parameters"
        elif text.startswith("- "):
            kind = "item"
        elif section or kind in ("", "formula") or (kind == "parameters" and ended):
            found += [(False, "")] * (kind == "parameters")
            kind = "text"
        if kind in ("parameters", "item") and not section and not text.startswith("- ") and text:
            found[-1] = (True, f"{found[-1][1]} {text}")
        else:
            found += [(False, "")] * bool(section) + [(True, line)]
    return [one for is_prose, line in found for one in (spread(line) if is_prose else [line])]


def spread(line):
    """Parameters as a list; what is said after the last one follows below; sections begin in bold."""
    section = SECTION.match(line)
    if not section:
        return [prose(line)]
    rest = line[section.end() :]
    if section[1] != "Parameters":
        return [f"**{section[1]}**{prose(rest)}"]
    *first, last = re.split(r"; +(?=`)", rest.lstrip(": "))
    last, *after = re.split(r"(?<=[\w`)]\.) +(?=[A-Z])", last, maxsplit=1)
    items = [f"- {prose(one.removesuffix('.'))}" for one in (*first, last)]
    return ["**Parameters**", "", *items, "", *map(prose, after)]


def prose(text):
    """Text as it stands: names in backticks stay so, errors become such names, everything else means only itself."""
    parts = text.replace("``", "`").split("`")
    for at, part in enumerate(parts):
        if at % 2:
            parts[at] = f"\\ ``{part}``\\ "
        else:
            part = re.sub(r"\\|\||(?<!\*)\*(?!\*)|_(?!\w)", r"\\\g<0>", part)
            parts[at] = ERRORS.sub(r"``\g<0>``", part)
    return "".join(parts)


def markdown(text):
    """Text as it stands, as Markdown: names in backticks stay so, everything else means only itself."""
    return re.sub(r"(`[^`]*`)|([\\*_<\[$])", lambda found: found[1] or f"\\{found[2]}", text)


class Overview(SphinxDirective):
    """Every public name with the first line of its docstring, room by room."""

    def run(self):
        rooms = {}
        for path, value in public_names().items():
            if not inspect.ismodule(value) and (told := inspect.getdoc(value)):
                room = path.removeprefix("icpmodel.").rpartition(".")[0]
                rooms.setdefault(room, []).append((path, told.partition("\n")[0]))
        lines = []
        for room in sorted(rooms):
            lines += [f"**icpmodel{room and '.'}{room}**", ""]
            lines += [f"- `{path}`: {markdown(told)}" for path, told in sorted(rooms[room])]
            lines += [""]
        return self.parse_text_to_nodes("\n".join(lines))


def short_types(app, what, name, obj, options, signature, returns):
    """The house's own name for arrays of float64, and a default that is made anew as one that Sphinx can read."""
    return tuple(text and VECTOR.sub("Vector", text).replace("<factory>", "...") for text in (signature, returns))


def process(app, what, name, obj, options, lines):
    if name.startswith("icpmodel"):
        lines[:] = as_rst(list(lines))


def skip(app, what, name, obj, skipped, options):
    """A verb of a class that is a public function is told of there; modules hold names of others."""
    return True if any(obj is value for value in public_names().values()) else None


def setup(app):
    app.connect("autodoc-skip-member", skip)
    app.connect("autodoc-process-signature", short_types)
    app.connect("autodoc-process-docstring", process)
    app.add_transform(Links)
    app.add_directive("overview", Overview)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
