"""Search over beliefs, compiled if there is a C compiler. Tests compare everything here with plain
recursion.

Values are weighted with the probability of reaching a state, so the parts of a sum add up without
division.
"""
