"""Backward chaining: from the goals over sets of open conditions."""
