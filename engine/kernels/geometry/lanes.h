/* Sixteen configurations on one straight line side by side, in single precision.
 *
 * What is told apart here is apart, and what is told to touch touches: everything is compared with a slack that is greater
 * than all rounding (lanes.py says how much). What lies between stays in doubt, and is looked at in double precision. So the
 * answers do not depend on how many numbers a processor adds at once. Vectors of four are what GCC and Clang offer on every
 * processor. Where there are vectors of eight (AVX2), they are taken: each lane is computed in the same way in both. Another
 * compiler leaves everything in doubt.
 */
#ifndef CELLWRIGHT_LANES_H
#define CELLWRIGHT_LANES_H

#include <stddef.h>
#include <string.h>

enum { LANES = 16, LANE_ORIGIN = 12, LANE_BOUNDS = 18 };

typedef struct {
    ptrdiff_t joints, pieces, groups;
    const long long *parent;       /* (k,) */
    const unsigned char *slides;   /* (k,) */
    const float *origins;          /* (k, 12): rotation and origin on the parent; the axis is then z */
    const long long *carrier;      /* (n,) */
    const float *own;              /* (n, 18): bounds in the carriers */
    const float *slack;            /* (n,) */
    const double *reach;           /* (k, n), or none */
    const long long *rows, *pairs, *after;
    float *poses;                  /* (k + 1, 12, 16) */
    float *middle, *axes;          /* (n, 3, 16), (n, 9, 16): bounds in the world; those of what stands never change */
    int *placed, *turned;          /* (n,): in which round they were put there */
    const double *start, *way;     /* (k,): the line */
    const double *where;           /* (16,): places on it, from 0 to 1 */
    const float *share;            /* (16,): how much of half the line each stretch has on both sides of its middle */
    const double *away;            /* (k,): motion of a joint over half the line */
    const float *whole;            /* (n,): motion of a piece over half the line */
    unsigned *doubt;               /* (g,): which lanes each group leaves in doubt */
    int round;
    int wide;                      /* whether vectors of eight are taken */
} lanes_scene;

#if defined(__GNUC__)
#define LANE_BY 3.0517578125e-05f /* a share of distances asked for, more than rounding takes from them: 2^-15 */

#if defined(__SSE2__)
#include <emmintrin.h>
#endif
#define LANE_WIDTH 4
#include "engine/kernels/geometry/lanes_loops.h"

#if defined(__x86_64__)
#include <cpuid.h>
#include <immintrin.h>
#if defined(__clang__)
#pragma clang attribute push(__attribute__((target("avx2"))), apply_to = function)
#else
#pragma GCC push_options
#pragma GCC target("avx2")
#endif
#undef LANE_WIDTH
#define LANE_WIDTH 8
#include "engine/kernels/geometry/lanes_loops.h"
#if defined(__clang__)
#pragma clang attribute pop
#else
#pragma GCC pop_options
#endif

/* Whether this processor has vectors of eight, and the operating system keeps them. */
static inline int lanes_wide(void) {
    unsigned a, b, c, d, low, high;
    if (!__get_cpuid(1, &a, &b, &c, &d) || !(c & bit_OSXSAVE) || !(c & bit_AVX))
        return 0;
    __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    return (low & 6) == 6 && __get_cpuid_count(7, 0, &a, &b, &c, &d) && (b & bit_AVX2) != 0;
}
#else
static inline int lanes_wide(void) { return 0; }
#define lane_sift_8 lane_sift_4
#endif

/* Whether a lane of `open` surely touches: the group that says so, or -1. With `all` set every group is looked at, else it stops
 * there. `hit` gets the lanes that surely touch, and `doubt` of each group those that it leaves undecided. */
static inline ptrdiff_t lanes_sift(lanes_scene *l, ptrdiff_t first, unsigned open, float margin, int all, unsigned *hit, unsigned *doubted) {
    return l->wide ? lane_sift_8(l, first, open, margin, all, hit, doubted) : lane_sift_4(l, first, open, margin, all, hit, doubted);
}

#else

static inline int lanes_wide(void) { return 0; }

static inline ptrdiff_t lanes_sift(lanes_scene *l, ptrdiff_t first, unsigned open, float margin, int all, unsigned *hit, unsigned *doubted) {
    (void)first, (void)margin, (void)all;
    for (ptrdiff_t g = 0; g < l->groups; g++)
        l->doubt[g] = open;
    *doubted = open, *hit = 0;
    return -1;
}

#endif
#endif
