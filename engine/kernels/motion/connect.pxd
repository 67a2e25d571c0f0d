# Types with which Cython compiles connect.py. Its meaning is written there.
import cython
from libc cimport math
from cellwright.engine.kernels.geometry cimport edges
from cellwright.engine.kernels.geometry.edges cimport Edges
from cellwright.engine.kernels.motion cimport halton
from cellwright.engine.kernels.motion.halton cimport Halton

cdef double INFINITE

@cython.final
cdef class Trees:
    cdef readonly object nodes, parents
    cdef readonly Py_ssize_t count, capacity
    cdef double[:, :, ::1] _nodes
    cdef double[:, ::1] _first, _second, target
    cdef double[::1] low, high
    cdef long long[:, ::1] _parents
    cdef Py_ssize_t[2] size
    cdef Py_ssize_t[2] met
    cdef readonly double reach
    cdef Halton halton

@cython.locals(sound=bint, x=Py_ssize_t, side=Py_ssize_t, n=Py_ssize_t)
cdef bint _finite(Trees t) noexcept nogil
cpdef bint connect(Trees t, Edges e, long long budget) except *
@cython.locals(goal=Py_ssize_t, free=int)
cdef int _straight(Trees t, Edges e, long long budget) except -1 nogil
@cython.locals(side=Py_ssize_t, near=Py_ssize_t, met=int)
cdef int _grow(Trees t, Edges e, long long budget) except -1 nogil
@cython.locals(other=Py_ssize_t, near=Py_ssize_t, moved=int)
cdef int _met(Trees t, Edges e, Py_ssize_t side) except -1 nogil
cdef void _sample(Trees t) noexcept nogil
@cython.locals(best=double, total=double, away=double, found=Py_ssize_t, n=Py_ssize_t, x=Py_ssize_t)
cdef Py_ssize_t _nearest(Trees t, Py_ssize_t side) noexcept nogil
@cython.locals(away=double, share=double, n=Py_ssize_t, x=Py_ssize_t, reached=bint, free=int)
cdef int _advance(Trees t, Edges e, Py_ssize_t side, Py_ssize_t near) except -1 nogil
