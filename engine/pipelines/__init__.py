"""What joins stages: the ways from a question to its answer."""
