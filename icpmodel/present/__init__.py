"""Tables and cards: one description, shown as text, HTML, CSV or LaTeX; this room knows nothing of what it shows."""

from .card import Card
from .rendering import render
from .table import Table

__all__ = ["Card", "Table", "render"]
