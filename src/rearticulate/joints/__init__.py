"""Trees of joints: tests of relative motion, adjustment to all points, and how well each joint is known."""
