# The types with which Cython compiles timed_relaxation.py. The docstrings are in that file.
import cython

from cellwright.engine.kernels.packed_rows cimport PackedRows
from cellwright.engine.stages.temporal.key_heap cimport KeyHeap
from cellwright.engine.stages.temporal.timeline cimport Timeline

cdef long long UNREACHED, MAX_COST

@cython.final
cdef class TimedRelaxation:
    cdef readonly int all_facts, facts, actions, operators, first_test, changes, fitting, helping, length
    cdef int waiting
    cdef readonly bint reachable
    cdef readonly long long estimate
    cdef public double slope
    cdef PackedRows open_adds, relaxed_needs, early_adds, late_adds, users, nudges, timed_adds, no_needs
    cdef public PackedRows goals
    cdef long long[::1] spans, timed_at, costs, reached, repeats, pure, spent, ready
    cdef public long long[::1] weights
    cdef int[::1] end_of, tests, missing, supporter, marked, is_goal, stack, used
    cdef readonly int[::1] fits, helpful, relaxed
    cdef double[::1] nudge_by, deficit
    cdef KeyHeap queue

    cpdef long long evaluate(self, Timeline line)

    @cython.locals(fact=int, operator=int)
    cdef void _clear(self)

    @cython.locals(fact=int, node=int, place=int, action=int, test=int, value=double, index=int)
    cdef void _begin(self, Timeline line)

    @cython.locals(place=int, change=int)
    cdef void _begin_later(self, Timeline line)

    cdef void _hold_true(self, int fact, long long cost, long long time)

    @cython.locals(key="long long")
    cdef void _reach(self, int fact, long long cost, long long time, int operator)

    @cython.locals(missing=int, place=int)
    cdef int _count_goals(self)

    @cython.locals(fact=int, key="long long", missing=int)
    cdef void _explore(self, Timeline line)

    @cython.locals(pure="long long", place=int, operator=int)
    cdef void _use(self, int fact, Timeline line)

    @cython.locals(cost="long long", time="long long", end="long long", action=int, place=int, fact=int, by=double, repeats="long long", more="long long", before="long long")
    cdef void _fire(self, int operator, Timeline line)

    @cython.locals(place=int, fact=int, total="long long", operator=int)
    cdef long long _extract(self, Timeline line)

    cdef void _want(self, int fact)

    @cython.locals(place=int)
    cdef void _select(self, int operator)
