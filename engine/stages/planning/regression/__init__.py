"""Backward chaining: search from the goals backward over sets of open conditions."""
