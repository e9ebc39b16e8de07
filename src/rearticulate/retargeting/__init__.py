"""Inverse kinematics of a finished model from a few points."""
