"""Shapes of parts: convex pieces, meshes, hulls and solids with facets."""
