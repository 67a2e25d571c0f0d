/* Vectors of LANE_WIDTH numbers, and their sine and cosine. It is included once for each width, and every name gets the width. */
#ifndef LANE_NAMED
#define LANE_PASTED(name, width) name##_##width
#define LANE_WITH(name, width) LANE_PASTED(name, width)
#define LANE_NAMED(name) LANE_WITH(name, LANE_WIDTH)
#define lane_floats LANE_NAMED(lane_floats)
#define lane_stored LANE_NAMED(lane_stored)
#define lane_whole LANE_NAMED(lane_whole)
#define lane_load LANE_NAMED(lane_load)
#define lane_store LANE_NAMED(lane_store)
#define lane_all LANE_NAMED(lane_all)
#define lane_same LANE_NAMED(lane_same)
#define lane_chosen LANE_NAMED(lane_chosen)
#define lane_marks LANE_NAMED(lane_marks)
#define lane_turn LANE_NAMED(lane_turn)
#define lane_values LANE_NAMED(lane_values)
#define lane_add LANE_NAMED(lane_add)
#define lane_spin LANE_NAMED(lane_spin)
#define lane_shift LANE_NAMED(lane_shift)
#define lane_carry LANE_NAMED(lane_carry)
#define lane_place LANE_NAMED(lane_place)
#define lane_middle LANE_NAMED(lane_middle)
#define lane_axes LANE_NAMED(lane_axes)
#define lane_motion LANE_NAMED(lane_motion)
#define lane_beside LANE_NAMED(lane_beside)
#define lane_closely LANE_NAMED(lane_closely)
#define lane_near LANE_NAMED(lane_near)
#define lane_group LANE_NAMED(lane_group)
#define lane_sift LANE_NAMED(lane_sift)
#endif

typedef float lane_floats __attribute__((vector_size(4 * LANE_WIDTH)));
typedef float lane_stored __attribute__((vector_size(4 * LANE_WIDTH), aligned(4), may_alias));
typedef int lane_whole __attribute__((vector_size(4 * LANE_WIDTH)));

static inline lane_floats lane_load(const float *from) { return *(const lane_stored *)from; }
static inline void lane_store(float *to, lane_floats x) { *(lane_stored *)to = x; }
static inline lane_floats lane_all(float x) { return x - (lane_floats){0.0f}; }
static inline lane_whole lane_same(int x) { return x - (lane_whole){0}; }

static inline lane_floats lane_chosen(lane_whole which, lane_floats yes, lane_floats no) {
    return (lane_floats)(((lane_whole)yes & which) | ((lane_whole)no & ~which));
}

static inline unsigned lane_marks(lane_whole which) {
#if LANE_WIDTH == 8
    return (unsigned)_mm256_movemask_ps((__m256)which);
#elif defined(__SSE2__)
    return (unsigned)_mm_movemask_ps((__m128)which);
#else
    return (which[0] & 1u) | (which[1] & 2u) | (which[2] & 4u) | (which[3] & 8u);
#endif
}

/* Sine and cosine of angles within a turn (Cody & Waite 1980, polynomials of Cephes). */
static inline void lane_turn(lane_floats x, lane_floats *sine, lane_floats *cosine) {
    const lane_floats whole = lane_all(12582912.0f); /* 1.5 * 2^23: adding it rounds */
    lane_floats shifted = x * lane_all(0.636619772367581f) + whole, n = shifted - whole;
    lane_floats r = x - n * lane_all(1.5703125f);
    r = r - n * lane_all(4.837512969970703e-4f);
    r = r - n * lane_all(7.54978995489188e-8f);
    lane_floats z = r * r;
    lane_floats s = (lane_all(-1.9515295891e-4f) * z + lane_all(8.3321608736e-3f)) * z;
    s = (s + lane_all(-1.6666654611e-1f)) * z * r + r;
    lane_floats c = (lane_all(2.443315711809948e-5f) * z + lane_all(-1.388731625493765e-3f)) * z;
    c = (c + lane_all(4.166664568298827e-2f)) * z * z - lane_all(0.5f) * z + lane_all(1.0f);
    lane_whole quarter = (lane_whole)shifted, odd = -(quarter & lane_same(1));
    lane_whole minus_s = (quarter & lane_same(2)) << 30, minus_c = ((quarter + lane_same(1)) & lane_same(2)) << 30;
    *sine = (lane_floats)((lane_whole)lane_chosen(odd, c, s) ^ minus_s);
    *cosine = (lane_floats)((lane_whole)lane_chosen(odd, s, c) ^ minus_c);
}
