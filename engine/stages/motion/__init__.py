"""Motion planning between configurations of arms: paths, proofs, times, and why there is none.

The stage knows scenes only through `cellwright.engine.ports.MotionScene`.
"""
