"""HTML from templates, which escape the values that they are given."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from ..errors import check_arguments


@check_arguments
def render(template: str, **values: Any) -> str:
    """Fill in a template of the folder `templates`.

    Parameters
    ----------
    template : str
        The name of its file.
    **values
        The values of its variables, which are escaped.

    Returns
    -------
    str
        The text.

    Examples
    --------
    >>> icp.present.render("sentence.html", text="a < b")
    '<p>a &lt; b</p>'
    """
    text: str = _environment().get_template(template).render(**values)
    return text


@lru_cache(maxsize=1)
def _environment() -> Any:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    spaces: Any = {"trim_blocks": True, "lstrip_blocks": True}
    return Environment(loader=PackageLoader("icpmodel.present"), autoescape=True, undefined=StrictUndefined, **spaces)
