"""Operators with variables, evaluated without grounding: what a step does in a state."""
