"""Compiled loops of the sequencer: moves on tours, minimum 1-trees, and shortest paths over poses.

The modules are plain Python, which Cython compiles with the types in the `.pxd` files. Without a
compiler they run as they are, slowly. Compiled loops check no index: types and shapes are checked
before them.
"""
