/* Blockwright's core: from a tet mesh with a seamless parametrization, or a hexahedral mesh, to a complex of cuboid blocks.
 *
 * The only header that programs outside core include. A job is a row of stages; each reads the state that the one
 * before it left and either grows or changes it (sanitize, trace, build, reduce, quantize, extract) or writes results (encode):
 *
 *     input file --sanitize--> state --trace--> state --build--> state --encode--> result files
 *
 * bw_run() passes the state on in memory; bw_stage_run() runs one stage from file to file, as workers do. Both call the
 * same stage functions, so their results are the same bytes.
 */
#ifndef BLOCKWRIGHT_H
#define BLOCKWRIGHT_H

#include "base/context.h"
#include "base/kinds.h"

typedef enum {
    BW_STAGE_SANITIZE, /* loads the input file first */
    BW_STAGE_TRACE,
    BW_STAGE_BUILD,
    BW_STAGE_REDUCE,
    BW_STAGE_QUANTIZE, /* passes the state on if no quantization is asked for */
    BW_STAGE_REPARAMETRIZE, /* passes the state on if it has no quantization */
    BW_STAGE_EXTRACT,  /* passes the state on if it has no lengths */
    BW_STAGE_ENCODE,
    BW_STAGE_COUNT
} bw_stage;

enum { BW_OPTION_SCALES = 64, BW_OPTION_WEIGHTS = 4 };

typedef struct {
    bw_input_kind kind;  /* an input of the other kind is BW_E_KIND */
    bw_complex_kind complex;
    bw_reduce_mode reduce;
    bw_self_adjacent self_adjacent;
    int effort;          /* 0..3: how long reduce searches for fewer blocks; 0 is the paper's order only */
    bw_explore_method explore; /* reduce starts from the base complex with the walls that this leaves */
    bw_explore_cost explore_cost;
    double explore_weights[BW_OPTION_WEIGHTS]; /* for BW_EXPLORE_WEIGHTED: of blocks, bits, bits by block, cubes */
    bw_explore_expand explore_expand;
    int beam;              /* 1..1000000: states of a level of the enumeration that are expanded */
    uint64_t seed;         /* of all that is left to chance there */
    uint64_t explore_work; /* most evaluations */
    double explore_time;   /* most seconds; 0: no limit. A search cut by it is the only one that may come out different again */
    bw_quantize_range quantize;
    double scale;          /* size of the quantization: arcs as long as scale times their length in the map; 0: the coarsest */
    bool fewest_hexes;     /* instead of scale: as few hexes as there can be */
    bool rounding;         /* also try the classical rounding at that size, and report its conflicts (Q 7); a part of quantize */
    uint64_t target_hexes; /* not 0: instead of scale, the one that comes nearest to this number of hexes */
    double time_limit;     /* seconds for the search of one quantization */
    size_t scale_count;    /* more sizes, for a table in the report */
    double scales[BW_OPTION_SCALES];
    bw_stage until;      /* last stage to run */
    double tolerance;    /* largest accepted defect of seamlessness and alignment, relative to the edge it occurs on */
    bool repair;         /* sanitize may move vertices in parameter space where tets are inverted or degenerate */
    bw_igm_route route;    /* how reparametrize makes the map */
    int max_map_work;      /* work limit of a map, in steps of optimization; one that needs more is given up for another route or size */
    int subdivide;         /* hexes along the edge of a unit of the quantization: 1..1000 */
    uint64_t max_hexes;    /* work limit of extract; a quantization that promises more is refused before its map is made (BW_E_LIMIT) */
    bool smooth;           /* extract also moves the vertices of the hex mesh, on the surface, to better shapes */
    unsigned hex_formats;  /* bit 1 << bw_hex_format: encode writes the hex mesh, if there is one, as that */
    int bwh_bits;          /* bits of a coordinate in hexmesh.bwh, over the box of the mesh: 1..24; 0: lossless */
    bool vtk;            /* encode also writes the complex as a multi-block VTK data set */
    bool tmesh;          /* encode also writes the T-mesh: the complex refined around its extraordinary arcs for solid T-splines */
    const char *parameters; /* side file with the parameters of a Medit mesh; NULL: none. A path, borrowed; no JSON option */
    uint64_t max_cells;  /* work limit of trace and build: cells that cuts add to the tets (BW_E_LIMIT beyond) */
} bw_options;

void bw_options_defaults(bw_options *options);
/* Reads options from a JSON object, e.g. {"complex": "bc"}; unknown names and wrong types are BW_E_USAGE. Members that
 * are absent keep their value. `json` is not NUL-terminated. */
bw_status bw_options_from_json(bw_context *ctx, bw_options *options, const char *json, size_t length);

const char *bw_stage_name(bw_stage stage);                  /* "sanitize" */
bw_status bw_stage_from_name(const char *name, bw_stage *stage); /* BW_E_USAGE if there is none */
/* Version of a stage's algorithm and of its output file: part of the name under which outputs are cached. */
int bw_stage_version(bw_stage stage);

/* Runs all stages up to options->until; results go to the folder `out` (made if missing). On failure report.json is still
 * written there, with the failure. */
bw_status bw_run(bw_context *ctx, const bw_options *options, const char *input, const char *out);
/* Runs one stage. `input`: the job's input file for sanitize, else the state file of the stage before. `output`: the
 * state file to write, or for encode the folder for the result files. */
bw_status bw_stage_run(bw_context *ctx, const bw_options *options, bw_stage stage, const char *input,
                       const char *output);
/* The error in ctx as a JSON object {status, class, message, element_count, elements}; free() it. NULL if out of memory. */
char *bw_error_json(const bw_context *ctx);

const char *bw_version(void);

#endif
