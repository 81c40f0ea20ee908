"""Compiled loops of the solve room."""
