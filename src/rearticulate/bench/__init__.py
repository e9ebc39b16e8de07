"""Benchmarks: sequences with ground truth, fitted and scored, and the tables made of them."""
