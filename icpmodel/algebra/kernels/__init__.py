"""Compiled loops of the algebra: sweeps, pivots, and the pass over tridiagonal problems."""
