"""Who computes distances and collisions."""
