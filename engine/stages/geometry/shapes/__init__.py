"""Convex pieces, meshes and hulls."""
