# The types with which Cython compiles partition.py. That file says what they mean.
import cython
from cellwright.engine.kernels.cancellation cimport Poll
from cellwright.engine.stages.diagnosis.kernels.memo cimport Keys, Memo
from cellwright.engine.stages.diagnosis.kernels.ranking cimport Ranking

cdef double inf

@cython.final
cdef class Partition:
    cdef readonly Py_ssize_t actions, outcomes, sets, causes
    cdef Py_ssize_t conclusions, groups
    cdef const double[:, ::1] masses, costs
    cdef const unsigned long long[:, :, ::1] masks
    cdef const long long[:, ::1] following
    cdef const unsigned char[:, ::1] ends
    cdef const double[::1] cheapest, cures
    cdef const unsigned long long[:, ::1] goals, exempt

@cython.final
cdef class Room:
    cdef Py_ssize_t last
    cdef Ranking ranking
    cdef readonly Keys keys
    cdef Keys blocks, part
    cdef readonly Poll poll

    @cython.locals(some="unsigned long long", part="unsigned long long", last=Py_ssize_t, word=Py_ssize_t)
    cdef bint follow(self, Partition problem, Py_ssize_t level, Py_ssize_t action, Py_ssize_t outcome) noexcept

@cython.locals(total=double, word=Py_ssize_t, byte=Py_ssize_t, causes="unsigned long long")
cdef double mass(Partition problem, Keys keys, Py_ssize_t row) noexcept

@cython.locals(total=double, word=Py_ssize_t, byte=Py_ssize_t, causes="unsigned long long")
cdef double shared(Partition problem, Keys keys, Py_ssize_t row, Py_ssize_t action, Py_ssize_t outcome) noexcept

@cython.locals(goal=Py_ssize_t, word=Py_ssize_t, beyond="unsigned long long")
cdef bint is_final(Partition problem, Keys keys, Py_ssize_t row) noexcept

@cython.locals(outcome=Py_ssize_t, word=Py_ssize_t, beyond="unsigned long long")
cdef bint tells(Partition problem, Keys keys, Py_ssize_t row, Py_ssize_t action) noexcept

@cython.locals(squares=double, outcome=Py_ssize_t, part=double)
cdef double _unlike(Partition problem, Keys keys, Py_ssize_t row, Py_ssize_t action, double total) noexcept

@cython.locals(weight=double, group=Py_ssize_t, word=Py_ssize_t)
cdef double _needed(Partition problem, Room room, Py_ssize_t row, Py_ssize_t action) noexcept

@cython.locals(found=bint, word=Py_ssize_t, causes="unsigned long long")
cdef bint several(Partition problem, Keys keys, Py_ssize_t row) noexcept

@cython.locals(some="unsigned long long", other="unsigned long long", part="unsigned long long", word=Py_ssize_t)
cdef bint _split(
    Partition problem, Room room, Py_ssize_t index, Py_ssize_t action, Py_ssize_t outcome, Py_ssize_t count
) noexcept

@cython.locals(weight=double, first=Py_ssize_t, index=Py_ssize_t, outcome=Py_ssize_t)
cdef (Py_ssize_t, double) _refine(Partition problem, Room room, Py_ssize_t action, Py_ssize_t count) noexcept

@cython.locals(word=Py_ssize_t)
cdef void _move(Partition problem, Room room, Py_ssize_t origin, Py_ssize_t place) noexcept

@cython.locals(
    total=double, ranking=Ranking, count=Py_ssize_t, action=Py_ssize_t, weight=double, rate=double, parts=Py_ssize_t,
    cost=double, index=Py_ssize_t, word=Py_ssize_t
)
cdef double bound(Partition problem, Room room, Py_ssize_t row) noexcept

@cython.locals(cost=double, cause=Py_ssize_t)
cdef double _cure_cost(Partition problem, Keys keys, Py_ssize_t row) noexcept

@cython.locals(at="long long", final=bint)
cdef double lower(Partition problem, Memo table, Room room, Py_ssize_t level) noexcept

@cython.locals(value=double, outcome=Py_ssize_t)
cpdef double estimate(Partition problem, Memo table, Room room, Py_ssize_t level, Py_ssize_t action) noexcept

@cython.locals(count=Py_ssize_t, action=Py_ssize_t, value=double)
cdef Py_ssize_t ranked(Partition problem, Memo table, Room room, Py_ssize_t level) noexcept

@cython.locals(value=double, outcome=Py_ssize_t, going=bint, guess=double)
cdef double begun(
    Partition problem, Memo table, Room room, Py_ssize_t level, Py_ssize_t action, double best
) noexcept

@cython.locals(known=double, count=Py_ssize_t, best=double, floor=double, rank=Py_ssize_t, value=double)
cpdef double solve(Partition problem, Memo table, Room room, Py_ssize_t level, double limit) noexcept
