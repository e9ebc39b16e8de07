"""The stages of the direct solver in their order: first parts, then joints."""
