"""Poses of a finished model from sparse observations."""
