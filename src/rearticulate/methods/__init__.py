"""The methods a fit can be made by, each half of it by name: see `registry`."""
