# The types with which Cython compiles packed_rows.py. The docstrings are in that file.
import cython

@cython.final
cdef class PackedRows:
    cdef readonly int count, length
    cdef readonly int[::1] starts, items
