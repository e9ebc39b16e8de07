"""The direct solver, one stage a file. Everything here works in point spacings: see `frames`."""
