"""The stages: each answers one question of planning or sensing, and none imports another."""
