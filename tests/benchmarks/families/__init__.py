"""Random families of problems, one file per field, drawn anew for every seed."""

from .gallery import drawn, drawn_sizes, expander, family_names, problem_of

__all__ = ["drawn", "drawn_sizes", "expander", "family_names", "problem_of"]
