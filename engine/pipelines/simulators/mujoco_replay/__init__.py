"""Replay in MuJoCo (an extra): a motion program played by physics, independent of the planner.

It shares no collision code with the planner. `model` writes the cell for it, `playing` runs it
(MuJoCo, an extra).
"""
