"""Operators with variables. What a step does in a state is evaluated without grounding the task."""
