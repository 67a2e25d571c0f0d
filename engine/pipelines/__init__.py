"""Pipelines: each joins stages into the way from one kind of question to its answer."""
