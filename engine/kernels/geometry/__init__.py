"""Loops of geometry over arrays, compiled ahead by Cython with the types in the `.pxd` beside each;
they know nothing of cells.

Every module also runs as it stands, slowly, where nothing is compiled. Compiled loops check no
bounds: what they are given is checked once, where the classes of `layout` and `room` are made. They
leave the interpreter free while they run. Modules call each other by module (`gjk.support`),
because that is how Cython finds the compiled function.
"""
