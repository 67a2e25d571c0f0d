"""Learns a MACROP from a plan: explains why the plan works, and generalises it."""
