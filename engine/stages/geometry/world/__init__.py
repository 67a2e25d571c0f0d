"""The world model, which says where everything is, and the collision scene made from it."""
