"""Arrays, rounding, equilibration, factorisations, multigrid, threads, compiled loops: nothing of it knows of ICPs."""
