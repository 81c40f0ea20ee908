"""Studies: races, stability maps, sensitivity, and the report."""

from .charts import map_charts, race_charts, solution_charts  # noqa: F401  they register what they draw
from .charts.field_charts import Fields
from .charts.figures import figure, plot
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
