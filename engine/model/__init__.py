"""The values that the stages of the engine pass to each other, such as ground tasks and outcomes.

All are immutable.
"""
