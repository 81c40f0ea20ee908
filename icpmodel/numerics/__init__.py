"""Arrays, rounding, equilibration, factorisations, multigrid, threads, compiled loops: none of them depends on ICPs."""
