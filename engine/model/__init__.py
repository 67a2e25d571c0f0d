"""Values that the engine's stages pass to each other: ground tasks, shops, motions, outcomes.

All are immutable.
"""
