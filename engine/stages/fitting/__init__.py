"""Shapes fitted to measured points, and parts aligned by their datums: robust first, then least
squares, with covariance.
"""
