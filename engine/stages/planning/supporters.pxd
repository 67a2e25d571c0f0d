# The types with which Cython compiles supporters.py. The docstrings are in that file.
import cython

cdef long long UNREACHED, MOST

@cython.final
cdef class Supporters:
    cdef int atoms, operators, size
    cdef long long[::1] charges, reached, depths, spent, ends, queue
    cdef int[::1] needed, add_starts, add_items, user_starts, user_items, supporter, missing

    @cython.locals(entry="long long", cost="long long", atom=int)
    cpdef list spread(self, const unsigned char[::1] state, long long bound)

    @cython.locals(atom=int, operator=int)
    cdef void _begin(self, const unsigned char[::1] state, long long bound) noexcept

    @cython.locals(place=int, operator=int)
    cdef void _settle(self, int atom, long long cost, long long bound) noexcept

    @cython.locals(cost="long long", place=int, atom=int)
    cdef void _offer(self, int operator, long long bound) noexcept

    @cython.locals(place=int)
    cdef void _push(self, long long entry) noexcept

    @cython.locals(first="long long", last="long long", place=int, child=int)
    cdef long long _pop(self) noexcept
