"""The witness: a physics engine plays a finished motion program, and says what touched and where everything ended.

It shares no collision code with the planner. `model` writes the cell for it, `playing` runs it (MuJoCo, an extra).
"""
