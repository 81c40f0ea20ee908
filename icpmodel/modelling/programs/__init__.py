"""Quadratic programs, affine variational inequalities and least squares as complementarity problems."""
