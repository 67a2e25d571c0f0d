"""Lifted operators: what a step with variables does in a state, without grounding the task."""
