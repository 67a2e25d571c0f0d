# The types with which Cython compiles chain.py. That file says what they mean.
import cython

ctypedef fused Cost:
    int
    long long

cdef long long NEVER
cdef double INFINITE

cdef long long _edge(const Cost[:, ::1] cost, int a, int b) noexcept

@cython.locals(n=int, some=int, index=int, city=int, chosen=int, a=int, after="int[::1]", place="int[::1]", ratio="double[::1]", made="int[::1]")
cpdef object insert_all(const int[::1] ring, const Cost[:, ::1] cost)

@cython.locals(n=int, cut=int, city=int, old=int, best=int, least="long long")
cdef void _place(int new, int[::1] after, int[::1] place, double[::1] ratio, const Cost[:, ::1] cost) noexcept

@cython.locals(way=double)
cdef double _ratio(int city, int a, const int[::1] after, const Cost[:, ::1] cost) noexcept

@cython.locals(chosen=int, city=int)
cdef int _least(const double[::1] ratio) noexcept

@cython.locals(b=int)
cdef long long _detour(int city, int a, const int[::1] after, const Cost[:, ::1] cost) noexcept

@cython.locals(chosen=int, a=int, least="long long", detour="long long")
cdef int _cheapest_place(int city, const int[::1] after, const Cost[:, ::1] cost) noexcept

@cython.locals(n=int, made=int, improved=bint, i=int, j=int, a=int, b=int, c=int, d=int)
cpdef int exchange_edges(int[::1] tour, const Cost[:, ::1] cost) except -1

cdef void _reverse(int[::1] tour, int first, int last) noexcept

@cython.locals(n=int, made=int, improved=bint, start=int, inner="int[::1]", value="long long[:, ::1]", origin="int[:, ::1]")
cpdef int peephole(int[::1] tour, const Cost[:, ::1] cost, int width) except -1

@cython.locals(n=int, width=int, full=int, old="long long", index=int, right=int, best=int, last=int, least="long long", closed="long long")
cdef bint _reorder(int[::1] tour, const Cost[:, ::1] cost, int start, int[::1] inner, long long[:, ::1] value, int[:, ::1] origin) noexcept

@cython.locals(width=int, subset=int, last=int, following=int, longer="long long", wider=int)
cdef void _subsets(const int[::1] inner, int left, const Cost[:, ::1] cost, long long[:, ::1] value, int[:, ::1] origin) noexcept
