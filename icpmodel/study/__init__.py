"""Studies: races, stability maps, sensitivity, and the report."""

from .charts.study_charts import solution_figure
from .html_report import report
from .planes import Axis, Plane
from .race import Race, race
from .sensitivity import Sensitivity, sensitivity
from .stability_map import StabilityMap, stability

__all__ = [
    "Axis",
    "Plane",
    "Race",
    "Sensitivity",
    "StabilityMap",
    "race",
    "report",
    "sensitivity",
    "solution_figure",
    "stability",
]
