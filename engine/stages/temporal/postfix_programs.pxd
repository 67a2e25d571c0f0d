# The types with which Cython compiles postfix_programs.py. The docstrings are in that file.
import cython

from cellwright.engine.kernels.packed_rows cimport PackedRows

@cython.final
cdef class PostfixPrograms:
    cdef PackedRows signs, values
    cdef double[::1] constants, stack

    @cython.locals(size=int, place=int, sign=int, index=int)
    cdef double value(self, int program, double[::1] numbers) noexcept

    @cython.locals(one=double, two=double)
    cdef void _calculate(self, int sign, int size) noexcept
