"""Splittings, operators, sweeps, active-set equations and subproblems: the building blocks of the methods."""
