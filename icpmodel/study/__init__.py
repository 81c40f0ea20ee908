"""Studies: races, stability maps, sensitivity, and the report."""

from .charts import study_charts as study_charts
from .charts.figures import figure, plot
from .charts.solution_charts import Fields
from .html_report import report
from .planes import Axis, Plane
from .race import Race, race
from .sensitivity import Sensitivity, sensitivity
from .stability_map import StabilityMap, stability

__all__ = [
    "Axis",
    "Fields",
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
