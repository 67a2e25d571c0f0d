# The types with which Cython compiles bracket.py. That file says what they mean.
import cython
from cellwright.engine.stages.diagnosis.kernels.belief cimport (
    Beliefs, Trail, is_done, situation_of, stop, tells
)
from cellwright.engine.stages.diagnosis.kernels.memo cimport Keys
from cellwright.engine.stages.diagnosis.kernels.pairing cimport PairBounds, floor_in_pairs

cdef unsigned long long MASK, SPREAD, MIX
cdef double inf, NARROW
cdef long long NONE, USELESS, STOP

@cython.final
cdef class Brackets:
    cdef Beliefs problem
    cdef public PairBounds pairs
    cdef readonly long long length, room, states, expanded
    cdef readonly bint full
    cdef Keys keys
    cdef long long[::1] index, tried
    cdef readonly double[::1] low, high
    cdef double[::1] mass, left
    cdef const long long[::1] repairs
    cdef readonly long long[::1] choice, first, children
    cdef readonly Py_ssize_t width

    @cython.locals(last="long long", mixed="unsigned long long", at="long long", word=Py_ssize_t)
    cdef long long slot(self, Keys keys, Py_ssize_t row) noexcept

    @cython.locals(word=Py_ssize_t)
    cdef bint _holds(self, long long state, Keys keys, Py_ssize_t row) noexcept

    @cython.locals(state="long long", word=Py_ssize_t)
    cdef long long numbered(self, long long at, Keys keys, Py_ssize_t row) noexcept

    cdef bint lacks_room(self) noexcept

    @cython.locals(larger=Brackets, state="long long", place="long long")
    cpdef Brackets grown(self, long long length, long long room)

@cython.locals(
    problem=Beliefs, best=Py_ssize_t, most=double, number=Py_ssize_t, situation=Py_ssize_t, action=Py_ssize_t, cured=double,
    place=Py_ssize_t, cause=Py_ssize_t, worth=double
)
cdef Py_ssize_t _repairing(Brackets table, Trail trail, Py_ssize_t level) noexcept

@cython.locals(
    problem=Beliefs, mass=double, situation=Py_ssize_t, place=Py_ssize_t, cause=Py_ssize_t
)
cdef double _repaired(Brackets table, Trail trail, Py_ssize_t level, Py_ssize_t action) noexcept

@cython.locals(
    problem=Beliefs, best=double, conclusion=Py_ssize_t, loss=double, place=Py_ssize_t, cause=Py_ssize_t
)
cdef double stop_left(Brackets table, Trail trail, Py_ssize_t level) noexcept

@cython.locals(
    problem=Beliefs, place=Py_ssize_t, cause=Py_ssize_t, number=Py_ssize_t, action=Py_ssize_t, best=double, spent=double,
    first=Py_ssize_t, begin=Py_ssize_t, ending=double
)
cdef double ceiling_of(Brackets table, Trail trail, Py_ssize_t level, long long state) noexcept

@cython.locals(at="long long", state="long long")
cdef long long number_of(Brackets table, Trail trail, Py_ssize_t level) noexcept

@cython.locals(
    problem=Beliefs, first="long long", action=Py_ssize_t, place="long long", outcome=Py_ssize_t, child="long long"
)
cdef void expand(Brackets table, Trail trail, Py_ssize_t level, long long state) noexcept

@cython.locals(
    problem=Beliefs, stopping=double, situation=Py_ssize_t, least="long long", low=double, high=double,
    choice="long long", action=Py_ssize_t, place="long long", under=double, over=double, outcome=Py_ssize_t,
    child="long long"
)
cdef long long back_up(Brackets table, Trail trail, Py_ssize_t level, long long state) noexcept

@cython.locals(best=Py_ssize_t, gap=double, place="long long", outcome=Py_ssize_t, child="long long")
cdef Py_ssize_t _widest(Brackets table, long long state, Py_ssize_t action) noexcept

@cython.locals(problem=Beliefs, fresh=bint, action="long long", outcome=Py_ssize_t, child="long long")
cdef void dive(Brackets table, Trail trail, Py_ssize_t level, long long state, double gap) noexcept

@cython.locals(state="long long", last="long long")
cpdef long long search(Brackets table, Trail trail, double limit, long long expansions, double close) noexcept
