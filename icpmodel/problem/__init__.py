"""The data of an ICP: A, q, f and ψ, and the facts about A and ψ."""
