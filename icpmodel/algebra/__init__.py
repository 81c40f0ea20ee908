"""Splittings, operators, sweeps, active-set equations and subproblems: what methods are made of."""
