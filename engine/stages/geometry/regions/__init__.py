"""The region tree."""
