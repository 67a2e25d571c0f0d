"""Grasping: grasps of a part, stable placements, regrasps, approach and insertion."""
