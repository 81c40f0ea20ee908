"""The derivative of the answer in A, q and ψ: forward, adjoint, and one-sided where it does not exist."""

from .derivative import Derivative, OneSided
from .gradient import Gradient

__all__ = ["Derivative", "Gradient", "OneSided"]
