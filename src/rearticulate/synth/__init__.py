"""Articulated objects with exact answers: analytic ones, any URDF, and perturbed copies of both."""
