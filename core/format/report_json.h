/* The report of a job: what every stage found, in one plain struct, and its JSON form
 * (api/schemas/report.schema.json).
 *
 * Each stage fills its own section and sets its `has_` flag; a section whose stage did not run is absent from
 * the JSON. A partial report travels from worker to worker as the same JSON text, inside the state file.
 *
 * To add a field: one member here, one line in the table of report_json.c, one property in the schema.
 * A field that changes its meaning or goes away raises BW_REPORT_VERSION.
 */
#ifndef BW_FORMAT_REPORT_JSON_H
#define BW_FORMAT_REPORT_JSON_H

#include "complex/complex.h"
#include "explore/explore.h"
#include "format/hex_bwh.h"
#include "hex/predict.h"
#include "hex/quality.h"

enum { BW_REPORT_VERSION = 1, BW_REPORT_STAGES = 16, BW_REPORT_RESULTS = 32, BW_REPORT_SWEEP = 64 };

typedef struct {
    double min, median, max;
} bw_report_range;

typedef struct {
    char name[24];
    double seconds;      /* wall time */
    uint64_t peak_bytes; /* largest sum of the job's heap blocks while the stage ran */
} bw_report_stage;

typedef struct {
    char name[40]; /* file name in the result folder; a report with a longer one is refused when it is read */
    uint64_t bytes;
} bw_report_result;

/* What classical rounding makes of the same map (quantize/rounding.h). */
typedef struct {
    double scale, objective;
    uint64_t integers, hexes; /* rounded one after another; 0 if it is not valid */
    bool valid;
    uint64_t conflicts, negative_blocks, links, separations, loops; /* validity constraints that it breaks, of each kind */
    bool coarsest_valid;      /* there is a scale at which it is valid, and the coarsest found by bisection is: */
    double coarsest_scale;
    uint64_t coarsest_hexes;
    double seconds;
} bw_report_rounding;

/* The integer lengths that were found. Objective: sum over arcs of (length - scale * input length)^2. */
typedef struct {
    char range[16];  /* asked for: "positive", "nonnegative", "any" */
    char fallback[16]; /* the narrower range that the lengths are from, for the check refused those of wider ones or they were too large for it; or "none" */
    char goal[16];   /* "lengths", or "hexes": then objective, bound and heuristic are numbers of hexes */
    char status[16]; /* "optimal": nothing that satisfies the constraints (Q 5.3) is better; "gap": it may be better by `gap`; "heuristic": not searched */
    double scale;    /* 0: the coarsest */
    double objective, bound, gap; /* bound: nothing that satisfies them is below it; gap: relative */
    double heuristic;             /* objective that the search started from */
    double distortion;            /* root mean square error of lengths relative to scale * input length; 0 at scale 0 */
    uint64_t target_hexes;        /* 0: a scale was asked for */
    bool target_met;              /* hexes are within 5 % of it */
    uint64_t hexes, zero_arcs, negative_arcs;
    uint64_t arcs, classes, free_integers; /* classes: arcs that are always equally long count once */
    uint64_t rounds, constraints, nodes;   /* rounds: times that validity was found broken; constraints: learnt from that; nodes: of the search */
    double seconds, seconds_setup, seconds_separation, seconds_solver, seconds_check;
    bool verified; /* this result and those of the sweep are valid by contraction too (quantize/verify.h) */
    bw_report_rounding rounding;
} bw_report_quantization;

/* The base complex of a hex mesh (hex/base_complex.h). */
typedef struct {
    uint64_t hexes, blocks, irregular_edges;
} bw_report_base;

/* One row of the table over sizes. */
typedef struct {
    double scale, objective, bound, distortion;
    uint64_t hexes, zero_arcs, negative_arcs;
    char status[16], fallback[16];
    double seconds;
} bw_report_sweep;

typedef struct {
    bool has_input, has_sanitize, has_trace, has_complex, has_exploration, has_quantization, has_quality;
    bool has_reduced; /* complex.reduced */
    bool has_repaired; /* sanitize.repaired */
    bool has_rounding; /* quantization.rounding */
    bool has_reparametrize, has_extract;
    bool has_hex_quality;
    bool has_tspline;
    bool has_base_complex;
    bool has_base_before, has_base_planned, has_base_after; /* base_complex.before, .planned, .after */
    bool has_smoothing; /* hex_quality.smoothing */
    bool has_compression, has_written; /* compression.written */

    struct {
        char file[256]; /* name without its folder; may be empty */
        uint64_t bytes;
        char kind[4];  /* "tet" or "hex": what the file lists. Of hexes, tets are those that they are split into */
        uint64_t hexes;
        uint64_t vertices, tets, facets, edges, boundary_facets;
        uint64_t singular_edges, singular_edges_interior, singular_edges_boundary; /* known once sanitized */
        uint64_t feature_vertices, feature_edges, feature_facets;
        bool mirrored; /* tets are listed negative; traced.hexex keeps that. Hexes: left-handed, and nothing keeps that */
    } input;

    struct {
        bool already_exact;           /* nothing had to move */
        double displacement_max;      /* parameter units, over all corners and axes */
        double residual_seamless_max; /* relative defect of the input, as the tolerance is */
        double residual_alignment_max;
        uint64_t cut_facets, cut_edges, branches, nodes, cut_sheets, align_sheets;
        uint64_t system_rows, system_columns, system_rank, free_variables;
        int64_t grid_exponent; /* parameter = integer * 2^-grid_exponent from here on */
        struct { /* tets that were inverted or degenerate, made positive by moving vertices in parameter space */
            uint64_t regions, tets, vertices_moved;
            uint64_t rings;          /* edges from a defective tet to the farthest vertex that was free to move */
            double displacement_max; /* parameter units */
            bw_region places[BW_REGIONS_KEPT]; /* the first of the regions */
        } repaired;
    } sanitize;

    struct {
        uint64_t vertices, edges, polygons, cells; /* of the cut complex; leaves only */
        uint64_t cut_cells;                        /* those of them in tets that were cut */
        uint64_t wall_polygons;                    /* inside; boundary polygons are counted apart */
        uint64_t boundary_polygons;
    } trace;

    struct {
        char kind[8]; /* "mc", "bc" or "serial" */
        struct {      /* as traced, before any reduction */
            uint64_t nodes, arcs, patches, blocks, t_arcs, torus_splits;
            uint64_t singular_nodes, singular_arcs, boundary_patches, self_adjacent_patches;
        } raw;
        struct { /* after wall retraction */
            char mode[16]; /* "keep-singular" or "full" */
            char from[8];  /* the complex that was reduced: "mc", "bc" or "serial" */
            uint64_t nodes, arcs, patches, blocks, t_arcs;
            uint64_t singular_nodes, singular_arcs, boundary_patches, self_adjacent_patches;
            uint64_t effort, orders_tried, patches_removed;
            uint64_t blocks_farthest_first; /* blocks that the paper's order alone leaves */
        } reduced;
    } complex;

    struct { /* which walls of the base complex to keep (stage reduce) */
        char method[16], cost[16], weights[120], expand[12];
        uint64_t beam, seed, work;
        uint64_t lines, sheets, links, crossings, crossings_open, components, variable_patches;
        double start, serial, best; /* cost: at first, of the best complex by serial insertion alone, of the best */
        uint64_t start_blocks, serial_blocks, best_blocks;
        uint64_t evaluations, improved_at; /* the evaluation that was the last to find a better one */
        char cut[8];                       /* "no", "time", "memory" or "finish": what ended the search before its work was done */
        bool proven;                       /* `serial` is the optimum of serial insertion */
        double seconds;
        size_t component_count; /* listed: those with most sheets */
        bw_explore_component component[BW_EXPLORE_LISTED];
    } exploration;

    bw_report_quantization quantization;
    size_t sweep_count; /* quantization.sweep */
    bw_report_sweep sweep[BW_REPORT_SWEEP];

    struct { /* the integer-grid map; tets inverted after each step, of the last quantization tried */
        char route[16];       /* "quality", "guaranteed" */
        char requantized[16]; /* "none", or the lengths taken instead of those asked for: "larger", "positive" */
        char reason[400];     /* why not the route and lengths asked for; empty if they were taken */
        uint64_t hexes_asked, hexes; /* of the first quantization and of that in use */
        uint64_t inverted_fit, inverted_stiffened, inverted_untangled, inverted;
        uint64_t stiffenings, iterations, restarts, refinements, splits, tets;
        double work;  /* steps that all maps tried took (igm/parametrize.h) */
        bool limited; /* the last one was given up at the limit of work */
        double distortion_mean, distortion_max; /* 1 at best; 0 without a map */
        double seconds, seconds_frame, seconds_fit, seconds_untangle, seconds_verify;
    } reparametrize;

    struct { /* the hex mesh */
        char from[8];      /* "map": read off an integer-grid map; "blocks": filled in block by block; "input": the hexes of the input, labelled */
        uint64_t hexes, vertices;
        uint64_t promised; /* hexes by the quantization; as many, in each block, or the job fails */
        uint64_t subdivide, subdivide_asked; /* hexes along the edge of a unit of the quantization; more than asked for where a mesh needs them to be simple */
        double seconds, seconds_label, seconds_check;
    } extract;

    struct { /* of the hex mesh (hex/quality.h), and how it got there (hex/smooth.h); lengths in the input's unit */
        bw_hex_quality mesh;
        bw_block worst_block[BW_HEX_WORST]; /* of mesh.worst */
        int32_t worst_ijk[BW_HEX_WORST][3];
        double volume_difference;                           /* relative to the input's */
        double to_input, from_input, to_curves;             /* largest distances found */
        double hausdorff, hausdorff_relative;               /* of surfaces, both directions; relative to the diagonal of the input's box */
        double seconds;
        struct {
            uint64_t nonpositive_before, rounds, iterations;
            double min_before, mean_before; /* scaled Jacobians */
            double moved_max, moved_mean, off_surface_max, off_surface_mean;
            uint64_t vertices_off_surface;
            double seconds;
        } smoothing;
    } hex_quality;

    struct { /* what the hex mesh costs to code by its blocks (hex/predict.h), and what it takes in hexmesh.bwh; bits are per vertex of the mesh */
        uint64_t blocks, vertices, vertices_coded, coordinates_wrong;
        uint64_t bits;                           /* of a coordinate, for the estimates */
        double estimate_pooled, estimate_blocks; /* E_g, with entropies of the whole mesh and of each block */
        double cube_ratio, cube_ratio_lengths;   /* longest side by shortest, summed over blocks: in hexes, and in lengths */
        struct {
            uint64_t bits;                             /* of a coordinate; 0: lossless */
            double error_max;                          /* of a coordinate: half a step of the lattice, in the input's unit */
            uint64_t bytes, bytes_header, bytes_shape, bytes_places; /* shape: blocks and connectivity; places: coordinates */
            double bits_per_vertex, bits_per_vertex_places;
        } written;
    } compression;

    struct {
        bw_report_range block_extent; /* parameter units, over all three extents of all blocks */
        bw_report_range block_aspect; /* longest extent over shortest, per block */
        bw_report_range block_volume; /* in the input's space, per block */
        double volume;                /* of the model, in the input's space */
        uint64_t traced_vertices, traced_tets, traced_walls; /* of traced.hexex */
        char integer_grid_omitted[240]; /* why a hex mesh from blocks has no integer_grid.hexex; empty if there is one, or no hex mesh */
    } quality;

    struct { /* base complexes of hex meshes (hex/base_complex.h), features left out */
        bw_report_base before, planned, after; /* of an input of hexahedra; of the mesh that the quantization promises, uncut; of the one that was made */
    } base_complex;

    struct { /* the T-mesh for solid T-splines (tspline/tmesh.h) */
        char knots[8]; /* unit of its knots: "hexes", or "map" */
        uint64_t blocks, cells, added_cells, refined_blocks, vertices, t_joints;
        uint64_t extraordinary_arcs;
        double seconds;
    } tspline;

    size_t stage_count;
    bw_report_stage stage[BW_REPORT_STAGES];
    size_t result_count;
    bw_report_result result[BW_REPORT_RESULTS];
    bw_error error; /* status BW_OK: the job succeeded as far as it was asked to go */
} bw_report;

void bw_report_init(bw_report *report);
/* Adds a stage or a result; what exceeds the room is dropped. Names are cut to fit. A result of the same name
 * is replaced. */
void bw_report_add_stage(bw_report *report, const char *name, double seconds, uint64_t peak_bytes);
void bw_report_add_result(bw_report *report, const char *name, uint64_t bytes);

/* Sections that follow from the data alone. Input: file, bytes, hexes and singular edges are left to whoever knows
 * them, hexes beforehand. O(n). */
void bw_report_fill_input(bw_report *report, const bw_tet_mesh *mesh);
void bw_report_fill_singular(bw_report *report, const bw_tet_mesh *mesh,
                             const bw_grid_map *map); /* into input */
void bw_report_fill_trace(bw_report *report, const bw_cells *cells);
void bw_report_fill_walls(bw_report *report, const bw_cells *cells); /* of it only what reduction changes */
void bw_report_fill_complex(bw_report *report, const bw_complex *complex, const char *kind);
void bw_report_fill_hex_quality(bw_report *report, const bw_hex_mesh *hex, const bw_hex_quality *quality, const bw_hex_distance *distance);
void bw_report_fill_reduced(bw_report *report, const bw_complex *complex, const char *mode); /* the counts of complex.reduced */
void bw_report_fill_compression(bw_report *report, const bw_predict_report *predicted, int bits);
void bw_report_fill_written(bw_report *report, const bw_bwh_sizes *sizes, int bits, size_t vertices); /* into compression */

/* JSON text, newline at the end; free() it. NULL if out of memory. */
char *bw_report_to_json(const bw_report *report);
/* Reads what bw_report_to_json wrote. BW_E_VERSION if it is anything else; unknown members are ignored. */
bw_status bw_report_from_json(bw_context *ctx, const char *json, size_t length, bw_report *report);
/* Writes the report to a file. Works with an error recorded in ctx too. BW_E_IO. */
bw_status bw_report_write(bw_context *ctx, const bw_report *report, const char *path);
/* An error as a JSON object {status, class, message, element_count, elements: [{kind, id, position?}]};
 * free() it. */
char *bw_report_error_json(const bw_error *error);

#endif
