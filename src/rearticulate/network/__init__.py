"""The correspondence network of the paper as it is used: features and matches of points, in NumPy alone."""
