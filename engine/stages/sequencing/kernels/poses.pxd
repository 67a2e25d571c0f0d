# The types with which Cython compiles poses.py. That file says what they mean.
import cython
from cellwright.engine.stages.sequencing.kernels.twister cimport Stream

cdef double BIG, NOISE
cdef int MOST

@cython.final
cdef class Poses:
    cdef const double[:, ::1] table
    cdef const int[::1] offset
    cdef int joints

    @cython.locals(most=double, joint=int)
    cdef double travel(self, int a, int b) noexcept

    cdef int width(self, int visit) noexcept

@cython.final
cdef class Layers:
    cdef Poses poses
    cdef int n, last, origin
    cdef const int[::1] order
    cdef int[::1] pose
    cdef double[::1] value, following
    cdef int[:, ::1] back

    @cython.locals(best=double, total=double, choices=int, choice=int, last=int, place=int)
    cpdef double best(self, bint closed) noexcept

    @cython.locals(home=int, start=int, count=int, pose=int, place=int, low=int, width=int, total=double, back=double)
    cdef double _pass(self, int fixed) noexcept

    @cython.locals(least=double, earlier=int, time=double)
    cdef double _from_before(self, int start, int count, int row) noexcept

@cython.final
cdef class Ruins:
    cdef Poses poses
    cdef Stream stream
    cdef int n, breadth, chosen
    cdef const int[:, ::1] near
    cdef readonly int[::1] after, pose, kept_after, kept_pose
    cdef int[::1] before, old_after, old_before, old_pose, removed
    cdef readonly double best

    @cython.locals(now=double, time=double, count=int)
    cpdef double run(self, long long rounds, double warmth, double cooling)

    @cython.locals(total=double, visit=int)
    cdef double _time(self) noexcept

    @cython.locals(visit=int)
    cdef void _remember(self) noexcept

    @cython.locals(visit=int)
    cdef void _return(self) noexcept

    @cython.locals(visit=int)
    cdef void _keep(self) noexcept

    @cython.locals(count=int, visit=int, seed=int, taken=int, along=bint, attempt=int, following=int, source=int)
    cdef int _ruin(self) noexcept

    @cython.locals(last=int, other=int, place=int, visit=int)
    cdef void _recreate(self, int count) noexcept

    @cython.locals(least=double, cut=double, factor=double, limit=double, place=int, row=int, rank=int, side=int, a=int, b=int, left=int, right=int)
    cdef void _insert(self, int visit) noexcept

    @cython.locals(row=int, time=double)
    cdef double _choose(self, int visit, int left, int right, double limit) noexcept

    @cython.locals(left=int, right=int, now=double)
    cdef void _polish(self, int visit) noexcept
