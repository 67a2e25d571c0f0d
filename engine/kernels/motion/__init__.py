"""Loops that look for ways through the space of configurations, compiled ahead by Cython; what
touches, `geometry` tells.

They read no clock and draw no random numbers: their work is bounded by counts, and the samples are
Halton's.
"""
