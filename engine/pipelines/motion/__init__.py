"""Motions of arms in a cell: what a person names becomes configurations, and the planners join them."""
