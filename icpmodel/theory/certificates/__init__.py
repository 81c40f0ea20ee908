"""Is the solution the only one, and how far from it is z? Proofs of uniqueness, and the bounds they give."""
