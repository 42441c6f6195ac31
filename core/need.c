/* The fit. Measured: the largest sum of heap blocks of each stage (bw_memory.peak, run from file to file) of 10 tet meshes and 4 hex meshes of 800
 * to 40 000 tets, each with up to four sets of options: all results; coarsest, effort 2, subdivided; exploration at scale 2; base
 * complex, fully reduced, 50 000 hexes. 276 stages. tests/pipeline/test_need.c holds it. `used` is what the state takes in memory, itself a sum over its counts.
 *
 *     stage          estimate                                                       estimate / measured: least, median, most
 *     trace          2.5 used, of base complexes 4 used                             1.04   1.3   2.6
 *     build          1.25 used                                                      1.02   1.1   1.2
 *     reduce         1.8 used; + 600 a cell of another complex beside it            1.09   1.7   14
 *     quantize       1.2 used + 4 MiB + 72 a hex of a target                        1.2    2.3   9
 *     reparametrize  11.5 used, with its fourth root beyond 4 MiB                   1.1    1.5   2.4
 *     extract        2 used + 1200 a hex, most of it for smoothing it                 1.06   1.6   4.4
 *     encode         1.9 used + 160 a hex                                           1.1    1.5   2.5
 *
 * To each 1 MiB for what does not depend on the mesh. Factors of larger meshes were looked at on a generated one whose state takes 30 MB (13.9 used).
 *
 * It is meant to be too high rather than too low: what searches for other complexes (effort 2 and up, exploration) may make one of 8 times the
 * cells, and rarely does. What no count tells beforehand is how many cells a base complex cuts; for that the stage's own limit is there. */
#include "need.h"

#include <math.h>

enum { CELL_BYTES = 600, ALTERNATIVE = 8 /* times the cells, as in try_base_complex */, HEX_BYTES = 1200, HEX_OUT_BYTES = 160, TARGET_BYTES = 72 };

/* Bytes of the complex that a search may make beside the state's own. */
static uint64_t other_complex(const bw_options *o, const bw_state *s) {
    bool beside = o->reduce != BW_REDUCE_NONE && o->effort >= 2 && o->complex == BW_COMPLEX_MC;
    if (!beside && o->explore == BW_EXPLORE_NONE) return 0;
    uint64_t cells = ALTERNATIVE * (uint64_t)s->cells.cell_count, most = s->mesh.tet_count + o->max_cells;
    return CELL_BYTES * (cells < most ? cells : most);
}

/* How many hexes there will be at most: those that the quantization promises, subdivided. */
static uint64_t planned_hexes(const bw_options *o, const bw_state *s) {
    uint64_t sub = (uint64_t)o->subdivide, each = sub * sub * sub, hexes = s->report.quantization.hexes; /* 1000^3 at most */
    return hexes < o->max_hexes / each ? hexes * each : o->max_hexes;
}

enum { SMALL = 1 << 20 }; /* what no count of a tiny mesh tells */

static uint64_t times(size_t used, uint64_t percent) { return SMALL + (uint64_t)used / 100 * percent; }

/* Factors of a mesh in space fill in: more than linear in its size. */
static uint64_t map_bytes(size_t used) {
    double times_small = (double)used / (4 << 20);
    return times(used, (uint64_t)(times_small > 1 ? 1150 * sqrt(sqrt(times_small)) : 1150));
}

uint64_t bw_need(const bw_options *o, bw_stage stage, const bw_state *s, size_t used) {
    uint64_t target = o->target_hexes < o->max_hexes ? o->target_hexes : o->max_hexes;
    switch (stage) {
    case BW_STAGE_TRACE: return times(used, o->complex == BW_COMPLEX_BC ? 400 : 250);
    case BW_STAGE_BUILD: return times(used, 125);
    case BW_STAGE_REDUCE: return times(used, 180) + other_complex(o, s);
    case BW_STAGE_QUANTIZE: return o->quantize == BW_QUANTIZE_NONE ? times(used, 125) : times(used, 120) + (4 << 20) + TARGET_BYTES * target;
    case BW_STAGE_REPARAMETRIZE: return s->length ? map_bytes(used) : times(used, 125);
    case BW_STAGE_EXTRACT: return times(used, 200) + (s->length ? HEX_BYTES * planned_hexes(o, s) : 0);
    case BW_STAGE_ENCODE: return times(used, 190) + HEX_OUT_BYTES * (uint64_t)s->hex.hex_count;
    case BW_STAGE_SANITIZE:
    case BW_STAGE_COUNT: break;
    }
    return 0; /* sanitize reads the input, not a state */
}
