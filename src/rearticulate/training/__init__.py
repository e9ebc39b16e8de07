"""Training of the correspondence network: the network in PyTorch, its subjects, pairs and loss. Needs extras."""
