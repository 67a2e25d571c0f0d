"""Paths for arms between configurations: found, shortened, proved, and the reason where there is none.

The stage knows scenes only through `cellwright.engine.ports.MotionGround`.
"""
