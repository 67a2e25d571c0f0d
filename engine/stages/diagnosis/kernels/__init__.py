"""Search over beliefs, compiled where there is a C compiler. Tests hold everything here against plain recursion.

Values are weighted with the probability of coming to a state, so that the parts of a sum add up without division.
"""
