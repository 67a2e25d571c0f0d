# Types with which Cython compiles angles.py. Its meaning is written there.
import cython
from libc cimport math

ctypedef (double, double) Pair

cdef double LARGE, SHIFT, FIRST, SECOND, THIRD

@cython.locals(n=double, r=double, z=double, s=double, c=double, half=double, whole=double, odd=bint, back=bint)
cpdef Pair sine_cosine(double x) noexcept nogil
