"""Inspections: measurement points, the tools and tours for them, and verdicts on measured
values.
"""
