"""The geometric world, which says where everything is, and the collision scene made from it."""
