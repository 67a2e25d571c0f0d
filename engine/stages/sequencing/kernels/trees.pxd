# The types with which Cython compiles trees.py. That file says what they mean.
import cython
from cellwright.engine.stages.sequencing.kernels.distances cimport Distances

cdef double INFINITE

@cython.locals(n=int, city=int, size=int, place=int, other=int, chosen=int, total=double, own=double, weight=double, least=double, near="double[::1]", outside="int[::1]")
cpdef double full_tree(Distances distances, const double[::1] penalty, int[::1] parent) except? -1

@cython.locals(first=double, second=double, weight=double, city=int)
cdef double _own_edges(Distances distances, const double[::1] penalty, int[::1] parent) noexcept
