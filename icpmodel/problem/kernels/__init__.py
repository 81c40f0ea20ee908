"""Compiled loops over the data of a problem: its residual, and its obstacle."""
