"""How studies and benchmarks are drawn."""
