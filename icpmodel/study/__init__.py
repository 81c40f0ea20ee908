"""Studies: races, stability maps, sensitivity, and the report."""

from .charts import solution_charts as solution_charts
from .charts import study_charts as study_charts
from .charts.figures import figure, plot
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
    "figure",
    "plot",
    "race",
    "report",
    "sensitivity",
    "stability",
]
