"""How well an identified axis foretells, and what its residuals and bands tell."""
