"""Rigid parts that move freely, and the part of every point: the relaxed model and all that makes and mends it."""
