"""Where everything is, and the scene that is made of it."""
