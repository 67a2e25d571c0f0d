"""Sequencing: the order of visits at least travel cost."""
