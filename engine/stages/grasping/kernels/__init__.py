"""Compiled loops over the holds of a part."""
