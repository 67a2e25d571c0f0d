# The types with which Cython compiles pairing.py. That file says what they mean.
import cython
cimport libc.math as math
from cellwright.engine.stages.diagnosis.kernels.belief cimport Beliefs, Trail, digit_of, floor_of

cdef double CHANCE, TINY
cdef Py_ssize_t DEPTH

@cython.final
cdef class PairProblems:
    cdef readonly object values, choices
    cdef readonly Py_ssize_t count, actions, outcomes, points
    cdef const double[::1] _ratios
    cdef const long long[:, :, ::1] _moves
    cdef const double[:, :, ::1] _parts, _kept
    cdef const long long[:, ::1] _useful
    cdef double[:, ::1] _values
    cdef long long[:, ::1] _choices
    cdef double[::1] _best, _now, _next

    @cython.locals(price="const double[:, :, ::1]", loss="const double[:, :, ::1]", count=Py_ssize_t, pair=Py_ssize_t)
    cpdef solve(self, object prices, object losses, long long sweeps, double close)

@cython.locals(place=Py_ssize_t, action="long long")
cdef double sweep(
    PairProblems pairs, Py_ssize_t pair, const double[:, :, ::1] prices, const double[:, :, ::1] losses,
    Py_ssize_t conclusions
) noexcept

@cython.locals(point=Py_ssize_t, number=Py_ssize_t, worth=double)
cdef void weigh_conclusions(
    PairProblems pairs, Py_ssize_t pair, const double[:, :, ::1] losses, Py_ssize_t conclusions
) noexcept

@cython.locals(
    points=Py_ssize_t, point=Py_ssize_t, outcome=Py_ssize_t, kept=double, at=Py_ssize_t, low=double, high=double
)
cdef void weigh_action(PairProblems pairs, Py_ssize_t pair, Py_ssize_t action, double one, double two) noexcept

@cython.locals(points=Py_ssize_t, largest=double, point=Py_ssize_t, change=double)
cdef double settle(PairProblems pairs, Py_ssize_t pair) noexcept

@cython.locals(points=Py_ssize_t, first=double, growth=double, ratio=double, point=Py_ssize_t)
cdef void extend(PairProblems pairs, Py_ssize_t pair) noexcept

@cython.locals(points=Py_ssize_t, point=Py_ssize_t, place=double, part=double, _=Py_ssize_t)
cdef void follow_choices(
    PairProblems pairs, Py_ssize_t pair, double one, double two, double[:, :, ::1] acts
) noexcept

@cython.locals(
    points=Py_ssize_t, going=double, point=Py_ssize_t, mass=double, choice="long long", outcome=Py_ssize_t, kept=double,
    at="long long"
)
cdef double follow_step(
    PairProblems pairs, Py_ssize_t pair, double one, double two, double[:, :, ::1] acts
) noexcept

@cython.locals(growth=double)
cdef double arrive(PairProblems pairs, long long at, double part, double kept) noexcept

@cython.final
cdef class PairBounds:
    cdef readonly Py_ssize_t count, last, repairs
    cdef double octave, step
    cdef const double[::1] ratios, total, sole
    cdef const double[:, ::1] values, excess
    cdef const long long[:, ::1] cures
    cdef double[::1] places

@cython.locals(least=double, place=Py_ssize_t, action="long long", chance=double, cost=double, after=double)
cdef double cost_alone(
    PairBounds bounds, Beliefs problem, Trail trail, Py_ssize_t level, Py_ssize_t cause
) noexcept

@cython.locals(total=double, place=Py_ssize_t, cause=Py_ssize_t, alone=double, action=Py_ssize_t)
cdef double charged(PairBounds bounds, Beliefs problem, Trail trail, Py_ssize_t level) noexcept

@cython.locals(
    least=double, total=double, count=Py_ssize_t, place=Py_ssize_t, cause=Py_ssize_t, later=Py_ssize_t, two=Py_ssize_t,
    earlier=Py_ssize_t, one=Py_ssize_t, pair=Py_ssize_t, at=double
)
cpdef double floor_in_pairs(PairBounds bounds, Beliefs problem, Trail trail, Py_ssize_t level) noexcept

@cython.locals(point=Py_ssize_t, high=double, value=double)
cdef double pair_value(PairBounds bounds, Py_ssize_t pair, double at, double one, double two) noexcept
