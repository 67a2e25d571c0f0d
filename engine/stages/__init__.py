"""The stages: each answers one question, and none knows another."""
