"""What is certain before a solve, as a page that a person can read."""

from .forecasts import Forecast
from .page import Explanation, explain

__all__ = ["Explanation", "Forecast", "explain"]
