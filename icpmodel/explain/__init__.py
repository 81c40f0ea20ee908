"""What is certain before a solve, as a page that a person can read."""

from .explanation import Explanation, explain
from .forecasts import Forecast

__all__ = ["Explanation", "Forecast", "explain"]
