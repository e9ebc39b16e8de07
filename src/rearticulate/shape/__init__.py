"""Solid bodies from points: what an export needs and a fit does not have."""
