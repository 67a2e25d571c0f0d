"""Geometry: frames and the world model, arms, parts, collision and the region tree.

It plans no motion.
"""
