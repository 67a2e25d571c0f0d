"""Tools for those who write domains."""
