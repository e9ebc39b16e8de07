"""Errors of a fit against ground truth. Nothing else in the package reads ground truth."""
