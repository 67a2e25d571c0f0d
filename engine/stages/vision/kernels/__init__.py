"""Compiled loops over the pixels of depth images."""
