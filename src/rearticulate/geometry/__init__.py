"""Rigid motions, screws, kinematic trees, neighbours. Knows nothing of fitting."""
