"""Proven bounds on hit rates: what no controller can exceed, whatever it does (docs/bounds.md)."""
