"""The figures of solutions and studies."""
