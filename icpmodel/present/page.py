"""HTML from templates, which escape what they are given."""

from __future__ import annotations

from functools import lru_cache
from typing import Any


def render(template: str, **values: Any) -> str:
    """The `template` of the folder `templates` with these `values`, escaped.

    >>> print(icp.present.render("card.html", rows={"a": "b < c"}).split("<td>")[1].split("</td>")[0])
    b &lt; c
    """
    text: str = _environment().get_template(template).render(**values)
    return text


@lru_cache(maxsize=1)
def _environment() -> Any:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    spaces: Any = {"trim_blocks": True, "lstrip_blocks": True}
    return Environment(loader=PackageLoader("icpmodel.present"), autoescape=True, undefined=StrictUndefined, **spaces)
