/* The loops of lanes.h for vectors of LANE_WIDTH numbers. It is included once for each width, and every name gets the width. */
#include "engine/kernels/geometry/lanes_vectors.h"

/* The values of joint j in all lanes, angles within half a turn. */
static inline void lane_values(const lanes_scene *l, ptrdiff_t j, float values[LANES]) {
    const double whole = 6755399441055744.0, start = l->start[j], way = l->way[j], slides = l->slides[j];
    for (int n = 0; n < LANES; n++) {
        double x = start + l->where[n] * way, turns = slides ? 0.0 : (x * 0.15915494309189535 + whole) - whole;
        values[n] = (float)((x - turns * 6.28318530717958623) - turns * 2.4492935982947064e-16);
    }
}

/* Add up what a row of the parent's rotation gives to a row of the child's: one entry of the origin times one column. */
static inline void lane_add(const float *up, float *out, float by, int more) {
    for (int r = 0; r < 3; r++)
        for (int q = 0; q < LANES; q += LANE_WIDTH) {
            lane_floats x = lane_load(up + 3 * r * LANES + q) * lane_all(by);
            lane_store(out + 3 * r * LANES + q, more ? lane_load(out + 3 * r * LANES + q) + x : x);
        }
}

/* Turn a carrier about its own z by angles. */
static inline void lane_spin(float *pose, const float *angles) {
    for (int q = 0; q < LANES; q += LANE_WIDTH) {
        lane_floats s, c;
        lane_turn(lane_load(angles + q), &s, &c);
        for (int r = 0; r < 9; r += 3) {
            lane_floats x = lane_load(pose + r * LANES + q), y = lane_load(pose + (r + 1) * LANES + q);
            lane_store(pose + r * LANES + q, c * x + s * y);
            lane_store(pose + (r + 1) * LANES + q, c * y - s * x);
        }
    }
}

/* Put the origin of a carrier where its parent and its slide have it. */
static inline void lane_shift(const float *up, const float *origin, const float *slid, float *pose) {
    for (int r = 0; r < 3; r++)
        for (int q = 0; q < LANES; q += LANE_WIDTH) {
            lane_floats sum = lane_load(up + (9 + r) * LANES + q);
            for (int m = 0; m < 3; m++)
                sum = sum + lane_load(up + (3 * r + m) * LANES + q) * lane_all(origin[m]);
            if (slid)
                sum = sum + lane_load(pose + (3 * r + 2) * LANES + q) * lane_load(slid + q);
            lane_store(pose + (9 + r) * LANES + q, sum);
        }
}

/* Put all carriers where they are in the sixteen configurations. */
static inline void lane_carry(lanes_scene *l) {
    for (ptrdiff_t j = 0; j < l->joints; j++) {
        float values[LANES];
        const float *t = l->origins + LANE_ORIGIN * j, *up = l->poses + l->parent[j] * 12 * LANES;
        float *pose = l->poses + (j + 1) * 12 * LANES;
        lane_values(l, j, values);
        for (int e = 0; e < 3; e++) {
            int more = 0;
            for (int m = 0; m < 3; m++)
                if (t[3 * m + e] != 0.0f)
                    lane_add(up + m * LANES, pose + e * LANES, t[3 * m + e], more++);
        }
        lane_shift(up, t + 9, l->slides[j] ? values : NULL, pose);
        if (!l->slides[j])
            lane_spin(pose, values);
    }
    l->round++;
}

/* Three entries of the bounds of a piece, turned as its carrier is, and moved if `move`. */
static inline void lane_place(lanes_scene *l, ptrdiff_t i, int entry, int move, float *out) {
    const float *pose = l->poses + l->carrier[i] * 12 * LANES, *own = l->own + LANE_BOUNDS * i + entry;
    const lane_floats x = lane_all(own[0]), y = lane_all(own[1]), z = lane_all(own[2]);
    for (int r = 0; r < 3; r++)
        for (int q = 0; q < LANES; q += LANE_WIDTH) {
            lane_floats sum = lane_load(pose + 3 * r * LANES + q) * x + lane_load(pose + (3 * r + 1) * LANES + q) * y;
            sum = sum + lane_load(pose + (3 * r + 2) * LANES + q) * z;
            lane_store(out + r * LANES + q, move ? sum + lane_load(pose + (9 + r) * LANES + q) : sum);
        }
}

static inline const float *lane_middle(lanes_scene *l, ptrdiff_t i) {
    float *middle = l->middle + 3 * LANES * i;
    if (l->placed[i] < l->round) {
        l->placed[i] = l->round;
        lane_place(l, i, 0, 1, middle);
    }
    return middle;
}

static inline const float *lane_axes(lanes_scene *l, ptrdiff_t i) {
    float *axes = l->axes + 9 * LANES * i;
    if (l->turned[i] < l->round) {
        l->turned[i] = l->round;
        for (int axis = 0; axis < 3; axis++)
            lane_place(l, i, 4 + 3 * axis, 0, axes + 3 * axis * LANES);
    }
    return axes;
}

/* How far two pieces may come nearer on half the line; a joint that moves both alike counts for neither. */
static float lane_motion(const lanes_scene *l, ptrdiff_t i, ptrdiff_t j) {
    if (l->carrier[i] == 0 || l->carrier[j] == 0)
        return l->whole[i] + l->whole[j];
    double total = 0.0;
    for (ptrdiff_t x = 0; x < l->joints; x++) {
        double one = l->reach[x * l->pieces + i], other = l->reach[x * l->pieces + j];
        if (one == 0.0 || other == 0.0)
            total += l->away[x] * (one + other);
    }
    return (float)total;
}

/* Which lanes of a vector have a ball within `out` of the block of `own`, and which within `in`; the middle of the ball is given from
 * that of the block. */
static inline lane_whole lane_beside(
    const float *axes, const float *own, const lane_floats d[3], lane_floats out, lane_floats in, lane_whole *sure
) {
    lane_floats total = lane_all(0.0f);
    for (int a = 0; a < 3; a++) {
        const float *axis = axes + 3 * a * LANES;
        lane_floats along = lane_load(axis) * d[0] + lane_load(axis + LANES) * d[1] + lane_load(axis + 2 * LANES) * d[2];
        along = (lane_floats)((lane_whole)along & lane_same(0x7fffffff)) - lane_all(own[13 + a]);
        along = (lane_floats)((lane_whole)along & ~(along < lane_all(0.0f)));
        total = total + along * along;
    }
    *sure = (in > lane_all(0.0f)) & (total <= in * in);
    return ~(total > out * out);
}

/* The same two questions as below, for the vector of lanes from `q` on whose balls are near each other. */
static unsigned lane_closely(lanes_scene *l, ptrdiff_t i, ptrdiff_t j, int q, lane_floats by, unsigned *sure) {
    const float *a = l->own + LANE_BOUNDS * i, *b = l->own + LANE_BOUNDS * j, slack = l->slack[i] + l->slack[j];
    const float *one = l->middle + 3 * LANES * i + q, *other = l->middle + 3 * LANES * j + q;
    const lane_floats most = by * lane_all(1.0f + LANE_BY) + lane_all(slack), least = by * lane_all(1.0f - LANE_BY) - lane_all(slack);
    lane_floats d[3], back[3];
    lane_whole near = lane_same(-1), touching = lane_same(0);
    for (int x = 0; x < 3; x++) {
        d[x] = lane_load(one + x * LANES) - lane_load(other + x * LANES);
        back[x] = -d[x];
    }
    if (a[17] == 0.0f && b[17] == 0.0f) {
        lane_floats gap = d[0] * d[0] + d[1] * d[1] + d[2] * d[2], in = least + lane_all(a[3] + b[3]);
        touching = (in > lane_all(0.0f)) & (gap <= in * in);
    }
    if (b[17] != 0.0f) {
        lane_floats add = lane_all(a[3] + b[16]);
        near = lane_beside(lane_axes(l, j) + q, b, d, most + add, least + add, &touching);
    }
    if (a[17] != 0.0f && lane_marks(near)) {
        lane_floats add = lane_all(b[3] + a[16]);
        near = near & lane_beside(lane_axes(l, i) + q, a, back, most + add, least + add, &touching);
    }
    *sure = a[17] + b[17] <= 1.0f ? lane_marks(touching & near) : 0;
    return lane_marks(near);
}

/* Which of the open lanes have two pieces near each other by their bounds, and which of them surely touch. */
static inline unsigned lane_near(lanes_scene *l, ptrdiff_t i, ptrdiff_t j, unsigned open, float margin, unsigned *sure) {
    const float *one = lane_middle(l, i), *other = lane_middle(l, j);
    const float balls = l->own[LANE_BOUNDS * i + 3] + l->own[LANE_BOUNDS * j + 3] + l->slack[i] + l->slack[j];
    const float motion = l->reach ? lane_motion(l, i, j) : 0.0f;
    lane_floats by[LANES / LANE_WIDTH], out = lane_all(margin * (1.0f + LANE_BY) + balls);
    lane_whole near[LANES / LANE_WIDTH], any = lane_same(0);
    unsigned found = 0, touching = 0;
    for (int q = 0; q < LANES / LANE_WIDTH; q++) {
        lane_floats x = lane_load(one + LANE_WIDTH * q) - lane_load(other + LANE_WIDTH * q);
        lane_floats y = lane_load(one + LANES + LANE_WIDTH * q) - lane_load(other + LANES + LANE_WIDTH * q);
        lane_floats z = lane_load(one + 2 * LANES + LANE_WIDTH * q) - lane_load(other + 2 * LANES + LANE_WIDTH * q);
        by[q] = lane_all(margin);
        if (l->reach) {
            by[q] = by[q] + lane_all(motion) * lane_load(l->share + LANE_WIDTH * q);
            out = by[q] * lane_all(1.0f + LANE_BY) + lane_all(balls);
        }
        near[q] = ~(x * x + y * y + z * z > out * out);
        any = any | near[q];
    }
    *sure = 0;
    if (!lane_marks(any))
        return 0;
    for (int q = 0; q < LANES; q += LANE_WIDTH) {
        unsigned left = lane_marks(near[q / LANE_WIDTH]) & open >> q;
        if (left) {
            found |= (lane_closely(l, i, j, q, by[q / LANE_WIDTH], &touching) & left) << q;
            *sure |= (touching & left) << q;
        }
    }
    return found;
}

/* Which open lanes a group leaves in doubt; those that surely touch are added to `hit`. At the first of them it stops if `early`. */
static unsigned lane_group(lanes_scene *l, ptrdiff_t g, unsigned open, float margin, int early, unsigned *hit) {
    const long long *row = l->rows + 4 * g;
    long long m = row[2], checked = -1;
    unsigned sure, doubt = 0, around = lane_near(l, row[0], row[1], open, margin, &sure), of_first = 0;
    while (around && m < row[3]) {
        ptrdiff_t i = l->pairs[2 * m], j = l->pairs[2 * m + 1];
        if (i != checked) {
            if (i != row[0])
                of_first = lane_near(l, i, row[1], around, margin, &sure);
            else
                of_first = around;
            checked = i;
        }
        if (!of_first) {
            m = l->after[m];
            continue;
        }
        unsigned near = j == row[1] ? of_first : lane_near(l, i, j, of_first, margin, &sure);
        doubt |= near;
        if (sure) {
            *hit |= sure;
            around &= ~sure;
            of_first &= ~sure;
            if (early)
                break;
        }
        m++;
    }
    return doubt & ~*hit;
}

/* Whether a lane of `open` surely touches: the group that says so, or -1. With `all` set every group is looked at, else it stops
 * there. `hit` gets the lanes that surely touch, and `doubt` of each group those that it leaves undecided. */
static inline ptrdiff_t lane_sift(lanes_scene *l, ptrdiff_t first, unsigned open, float margin, int all, unsigned *hit, unsigned *doubted) {
    ptrdiff_t found = -1;
    *hit = *doubted = 0;
    memset(l->doubt, 0, sizeof(unsigned) * (size_t)l->groups);
    lane_carry(l);
    for (ptrdiff_t n = -1; n < l->groups && open; n++) {
        ptrdiff_t g = n < 0 ? first : n;
        if (g >= l->groups || n == first)
            continue;
        l->doubt[g] = lane_group(l, g, open, margin, !all, hit);
        *doubted |= l->doubt[g];
        if (open & *hit) {
            found = g;
            open &= ~*hit;
            if (!all)
                return found;
        }
    }
    return found;
}
