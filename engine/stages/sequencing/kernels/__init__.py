"""Compiled loops of the sequencer: moves on tours, minimum 1-trees, and shortest paths over poses.

Plain Python, which Cython compiles with the types in the `.pxd` files; without a compiler it runs as it stands, slowly.
Compiled loops look at no index: types and shapes are checked where arrays are taken in.
"""
