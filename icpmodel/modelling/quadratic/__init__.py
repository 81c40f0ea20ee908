"""Convex quadratic programs as complementarity problems, whoever states them: the reduction, the solver, the proofs."""
