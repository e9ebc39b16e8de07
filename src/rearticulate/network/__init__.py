"""The correspondence network of the paper, what it is trained on, and its training. Needs the extra `paper`."""
