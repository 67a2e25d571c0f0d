# The types with which Cython compiles partition.py. That file says what they mean.
import cython
from engine.stages.diagnosis.kernels.memo cimport Memo
from engine.stages.diagnosis.kernels.ranking cimport Ranking

cdef double inf

@cython.final
cdef class Partition:
    cdef readonly Py_ssize_t actions, outcomes
    cdef Py_ssize_t conclusions, groups
    cdef const double[:, ::1] masses, costs
    cdef const long long[:, ::1] masks, following
    cdef const unsigned char[:, ::1] ends
    cdef const double[::1] cheapest, cures
    cdef const long long[::1] goals, exempt

@cython.final
cdef class Room:
    cdef Py_ssize_t last
    cdef Ranking ranking
    cdef long long[::1] blocks

@cython.locals(total=double, byte=Py_ssize_t)
cdef double mass(Partition problem, long long causes) noexcept

@cython.locals(goal=Py_ssize_t)
cdef bint is_final(Partition problem, long long causes) noexcept

@cython.locals(outcome=Py_ssize_t)
cdef bint tells(Partition problem, Py_ssize_t action, long long causes) noexcept

@cython.locals(squares=double, outcome=Py_ssize_t, part=double)
cdef double _unlike(Partition problem, Py_ssize_t action, long long causes, double total) noexcept

@cython.locals(weight=double, group=Py_ssize_t, part="long long")
cdef double _needed(Partition problem, Py_ssize_t action, long long causes, double total) noexcept

@cython.locals(
    weight=double, last=Py_ssize_t, index=Py_ssize_t, block="long long", left="long long", outcome=Py_ssize_t,
    part="long long"
)
cdef (Py_ssize_t, double) _refine(Partition problem, Room room, Py_ssize_t action, Py_ssize_t count) noexcept

@cython.locals(
    total=double, ranking=Ranking, count=Py_ssize_t, action=Py_ssize_t, weight=double, rate=double, parts=Py_ssize_t,
    cost=double, index=Py_ssize_t
)
cdef double bound(Partition problem, Room room, long long causes) noexcept

@cython.locals(cost=double, cause=Py_ssize_t)
cdef double _cure_cost(Partition problem, long long causes) noexcept

@cython.locals(at="long long", final=bint)
cdef double lower(Partition problem, Memo table, Room room, long long causes, long long situation) noexcept

@cython.locals(value=double, after="long long", outcome=Py_ssize_t, part="long long")
cpdef double estimate(
    Partition problem, Memo table, Room room, Py_ssize_t action, long long causes, long long situation
) noexcept

@cython.locals(count=Py_ssize_t, action=Py_ssize_t, value=double)
cdef Py_ssize_t ranked(
    Partition problem, Memo table, Room room, Py_ssize_t level, long long causes, long long situation
) noexcept

@cython.locals(
    known=double, count=Py_ssize_t, best=double, floor=double, rank=Py_ssize_t, action=Py_ssize_t, value=double,
    after="long long", outcome=Py_ssize_t, part="long long", guess=double
)
cpdef double solve(
    Partition problem, Memo table, Room room, Py_ssize_t level, long long causes, long long situation, double limit
) noexcept
