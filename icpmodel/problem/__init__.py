"""The data of an ICP: A, q and ψ, and what can be found out about A and ψ."""
