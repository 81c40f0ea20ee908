"""CVXPY: complementarity problems in its terms, and icpmodel as its solver for quadratic programs."""
