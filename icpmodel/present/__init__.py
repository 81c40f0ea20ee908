"""Tables and cards, shown as text, HTML, CSV or LaTeX; this subpackage knows nothing of the objects that it shows."""

from .card import Card
from .rendering import render
from .table import Table

__all__ = ["Card", "Table", "render"]
