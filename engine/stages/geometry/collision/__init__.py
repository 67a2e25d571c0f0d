"""Backends that compute distances and collisions."""
