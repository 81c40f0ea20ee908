"""How studies are drawn."""
