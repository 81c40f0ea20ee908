"""Modelling languages and files: problems written in CVXPY or Pyomo are read, solved and written back."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)  # CVXPY and Pyomo are loaded when they are named
