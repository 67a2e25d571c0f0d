# The types with which Cython compiles kernels.py. The docstrings are in that file.
import cython

from cellwright.engine.kernels.packed_rows cimport PackedRows

cdef long long UNREACHED, MOST

@cython.final
cdef class Queue:
    cdef int size
    cdef int[::1] heap
    cdef long long[::1] keys

    @cython.locals(place=int, parent=int)
    cdef void push(self, int atom, long long key) noexcept

    @cython.locals(place=int, child=int, key="long long", atom=int)
    cdef void pop(self) noexcept

@cython.final
cdef class RelaxedPlans:
    cdef int atoms, operators, listed, _found, _helpful, _length
    cdef long long[::1] costs, reached, spent
    cdef int[::1] goals, wanted, supporter, missing, marked, stack, _applicable, _preferred, _relaxed
    cdef PackedRows need, add, users
    cdef Queue queue

    @cython.locals(index=int)
    cpdef long long evaluate(self, const unsigned char[::1] state)

    @cython.locals(index=int)
    cpdef void charge(self, int first, const int[::1] of, const long long[::1] costs) noexcept

    @cython.locals(atom=int, operator=int)
    cdef void _begin(self, const unsigned char[::1] state) noexcept

    @cython.locals(atom=int, operator=int, place=int, open_goals=int, cost="long long")
    cdef void _reach(self) noexcept

    @cython.locals(atom=int, place=int, cost="long long")
    cdef void _ready(self, int operator) noexcept

    @cython.locals(total="long long", size=int, index=int, operator=int, place=int)
    cdef long long _extract(self) noexcept

@cython.final
cdef class LandmarkCount:
    cdef int count, goal_count
    cdef int[::1] goals, again
    cdef PackedRows atoms, before, just_before

    @cython.locals(landmark=int, place=int, earlier=int, after="unsigned char[::1]")
    cpdef bytes accept(self, const unsigned char[::1] accepted, const unsigned char[::1] state)

    @cython.locals(landmark=int, index=int, place=int, open_=int, again=int)
    cpdef int left(self, const unsigned char[::1] accepted, const unsigned char[::1] state)

    @cython.locals(place=int, atom=int)
    cdef bint _is_true(self, int landmark, const unsigned char[::1] state) noexcept
