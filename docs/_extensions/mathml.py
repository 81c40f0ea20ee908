"""Formulas as MathML, which docutils makes of TeX and every present browser shows: no script, no font, no network."""

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.util import logging


def of(node, tex, block):
    try:
        return tex2mathml(tex, as_block=block)
    except MathError as error:
        logging.getLogger(__name__).warning("%s: %s", tex, error, location=node)
        return ""


def inline(translator, node):
    translator.body.append(of(node, node.astext(), False))
    raise nodes.SkipNode


def displayed(translator, node):
    # browsers break no formula, so that each part between wide gaps is one of its own, and wraps on a phone
    parts = "".join(of(node, part.strip(), True) for part in node.astext().split(r"\qquad") if part.strip())
    translator.body.append(f'<div class="math">{parts}</div>\n')
    raise nodes.SkipNode


def setup(app):
    app.add_html_math_renderer("mathml", (inline, None), (displayed, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
