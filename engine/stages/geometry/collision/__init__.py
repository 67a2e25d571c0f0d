"""Collision: backends that compute distances, and the planning scene made from them."""
