"""What is certain: matrix classes, convergence theorems and predicted rates before a solve, error bounds after it."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
