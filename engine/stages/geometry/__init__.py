"""The geometric ground: frames and world model, arms, parts, collision and the region tree. Plans no motion.

Numba is imported only when a compiled kernel is first called.
"""
