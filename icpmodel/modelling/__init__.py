"""Modelling languages: problems written in CVXPY or Pyomo are read, solved and written back."""
