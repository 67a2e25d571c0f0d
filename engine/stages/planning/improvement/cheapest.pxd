# Types with which Cython compiles cheapest.py. Its meaning is written there.
import cython

cdef int SHRINKS

@cython.final
cdef class Cheapest:
    cdef int words, eager, bound, room, operators, choices, size
    cdef readonly int count, expanded, level
    cdef long long waiting
    cdef int[::1] costs, cost, parent, by, later, earlier, first, table
    cdef unsigned int[::1] needs, adds, drops, goals, states, fresh

    @cython.locals(word=int)
    cpdef void begin(self, const unsigned int[::1] initial)

    @cython.locals(state=int)
    cpdef int run(self, int expansions)

    @cython.locals(operator=int, cost=int, word=int, place=int, old="unsigned int")
    cdef void _expand(self, int state) noexcept

    @cython.locals(word=int)
    cdef bint _applies(self, int operator, int state) noexcept

    @cython.locals(choice=int, word=int)
    cdef bint _is_goal(self, int state) noexcept

    @cython.locals(operator=int, last=int, word=int, place=int)
    cdef void _settle(self) noexcept

    @cython.locals(slot="long long", same=int, state=int, word=int)
    cdef int _meet(self, int cost, int parent, int by) noexcept

    @cython.locals(
        hashed="unsigned long long", odd="unsigned long long", bits="unsigned long long", slot="long long", state=int, word=int
    )
    cdef long long _slot(self) noexcept

    @cython.locals(other=int)
    cdef void _link(self, int state, int cost) noexcept

    @cython.locals(before=int, behind=int)
    cdef void _unlink(self, int state, int cost) noexcept

    @cython.locals(found=list)
    cpdef list path(self, int state)
