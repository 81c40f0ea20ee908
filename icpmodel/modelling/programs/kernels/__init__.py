"""Compiled loops of the programs room."""
