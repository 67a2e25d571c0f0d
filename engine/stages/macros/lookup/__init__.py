"""Lookup of a MACROP that solves a problem, and the plan that it gives there."""
