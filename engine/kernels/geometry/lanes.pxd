# Types with which Cython compiles lanes.py. Its meaning is written there, and in lanes.h.
import cython
from cellwright.engine.kernels.geometry cimport layout
from cellwright.engine.kernels.geometry.layout cimport Pairs, Pieces
from cellwright.engine.kernels.geometry.mechanism cimport Mechanism

cdef extern from "engine/kernels/geometry/lanes.h":
    ctypedef struct lanes_scene:
        Py_ssize_t joints, pieces, groups
        const long long *parent
        const unsigned char *slides
        const float *origins
        const long long *carrier
        const float *own
        const float *slack
        const double *reach
        const long long *rows
        const long long *pairs
        const long long *after
        float *poses
        float *middle
        float *axes
        int *placed
        int *turned
        const double *start
        const double *way
        const double *where
        const float *share
        const double *away
        const float *whole
        unsigned int *doubt
        int wide
    int lanes_wide() nogil
    Py_ssize_t lanes_sift(
        lanes_scene *l, Py_ssize_t first, unsigned int open, float margin, int all, unsigned int *hit, unsigned int *doubted
    ) nogil

@cython.final
cdef class Narrow:
    cdef readonly Mechanism mechanism
    cdef readonly Pieces pieces
    cdef readonly Pairs pairs
    cdef const float[:, ::1] origins, bounds
    cdef const float[::1] slack
    cdef readonly object middle, axes, most, placed, poses

@cython.final
cdef class Lanes:
    cdef Narrow narrow
    cdef lanes_scene scene
    cdef Py_ssize_t groups
    cdef double[::1] start, way, where, away, most
    cdef float[::1] share, whole
    cdef unsigned int[::1] doubt
    cdef unsigned int hit, doubted
    cdef bint proving, small
    cdef float[:, :, ::1] poses, middle, axes
    cdef int[:, ::1] placed
    cdef const double[:, ::1] reach

    @cython.locals(x=Py_ssize_t)
    cdef void along(
        self, const double[:, ::1] first, Py_ssize_t i, const double[:, ::1] second, Py_ssize_t j
    ) noexcept nogil
    @cython.locals(g=Py_ssize_t)
    cdef Py_ssize_t sift(self, Py_ssize_t first, unsigned int lanes, double margin, bint every) noexcept nogil

cdef Py_ssize_t _sifted(Lanes room, Py_ssize_t first, unsigned int lanes, double margin, bint every) noexcept nogil
cdef void _bind(Lanes room, Narrow narrow) except *
