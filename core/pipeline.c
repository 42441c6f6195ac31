/* The table of stages: runs them, times them, and keeps the report. See blockwright.h. */
#include <errno.h>
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "blockwright.h"
#include "format/hex_write.h"
#include "format/input.h"
#include "format/state.h"
#include "hex/trivial.h"
#include "need.h"
#include "stage/build.h"
#include "stage/encode.h"
#include "stage/explore.h"
#include "stage/extract.h"
#include "stage/extract_finish.h"
#include "stage/quantize.h"
#include "stage/reduce.h"
#include "stage/reparametrize.h"
#include "stage/sanitize.h"
#include "stage/trace.h"

/* The words of the options, by enumerator. */
static const char *const kind_names[] = {"auto", "tet", "hex"};
static const char *const complex_names[] = {"mc", "bc", "serial"};
static const char *const reduce_names[] = {"none", "keep-singular", "full"};
static const char *const explore_names[] = {"none", "auto", "enumerate", "swap", "enumerate+swap", "anneal", "exact"};
static const char *const explore_cost_names[] = {"blocks", "bits", "bits-by-block", "cubes", "weighted"};
static const char *const explore_expand_names[] = {"random", "cheapest"};
static const char *const self_adjacent_names[] = {"allow", "split"};

/* ---- the stages ---------------------------------------------------------------------------------------------------- */

typedef bw_status stage_run(bw_context *ctx, const bw_options *options, bw_state *state, const char *out);

static void report_sanitize(bw_report *report, const bw_sanitize_report *found) {
    report->has_sanitize = true;
    report->sanitize.already_exact = found->already_exact;
    report->sanitize.displacement_max = found->displacement_max;
    report->sanitize.residual_seamless_max = found->residual_seamless_max;
    report->sanitize.residual_alignment_max = found->residual_alignment_max;
    report->sanitize.cut_facets = found->cut_facets, report->sanitize.cut_edges = found->cut_edges;
    report->sanitize.branches = found->branches, report->sanitize.nodes = found->nodes;
    report->sanitize.cut_sheets = found->cut_sheets, report->sanitize.align_sheets = found->align_sheets;
    report->sanitize.system_rows = found->system_rows, report->sanitize.system_columns = found->system_columns;
    report->sanitize.system_rank = found->system_rank, report->sanitize.free_variables = found->free_variables;
    report->sanitize.grid_exponent = found->grid_exponent;
    report->has_repaired = found->repaired;
    report->sanitize.repaired.regions = found->region_count, report->sanitize.repaired.tets = found->defective_tets;
    report->sanitize.repaired.vertices_moved = found->vertices_moved;
    report->sanitize.repaired.rings = (uint64_t)found->rings;
    report->sanitize.repaired.displacement_max = found->repair_displacement_max;
    memcpy(report->sanitize.repaired.places, found->regions, sizeof found->regions);
}

/* Hexes become tets with an exact map. */
static bw_status take_hexes(bw_context *ctx, bw_state *state, bool *mirrored) {
    bw_trivial_report found;
    state->has_source = true;
    bw_status status = bw_trivial_map(ctx, &state->mesh, &state->map, &state->source, &state->source_vertex, &found);
    state->report.input.hexes = state->source.hex_count;
    if (found.centred) bw_log(ctx, "%zu hexes and %zu of their faces are split from their centres", found.centred, found.crossed);
    *mirrored = found.mirrored;
    return status;
}

static bw_status run_sanitize(bw_context *ctx, const bw_options *options, bw_state *state, const char *out) {
    (void)out;
    bw_sanitize_report found;
    bool hexes = state->mesh.hex_count > 0, mirrored = false;
    if (options->kind != BW_KIND_AUTO && (options->kind == BW_KIND_HEX) != hexes)
        return bw_fail(ctx, BW_E_KIND, "the input is a mesh of %s, and the job is for one of %s", hexes ? "hexes" : "tets", hexes ? "tets" : "hexes");
    if (hexes && take_hexes(ctx, state, &mirrored) != BW_OK) return ctx->error.status;
    bw_sanitize_options how = {options->tolerance, options->repair};
    bw_status status = bw_sanitize(ctx, &how, &state->mesh, &state->map, &found);
    if (state->mesh.facet_tet) bw_report_fill_input(&state->report, &state->mesh);
    state->report.input.mirrored |= mirrored;
    if (status != BW_OK) return status;
    bw_report_fill_singular(&state->report, &state->mesh, &state->map);
    report_sanitize(&state->report, &found);
    return BW_OK;
}

static bw_status run_trace(bw_context *ctx, const bw_options *options, bw_state *state, const char *out) {
    (void)out;
    state->has_cells = true;
    bw_status status = bw_cells_init(ctx, &state->cells, &state->mesh, &state->map);
    if (status == BW_OK) status = bw_trace(ctx, &state->cells, options->complex, options->max_cells);
    if (status == BW_OK) status = bw_cells_check(ctx, &state->cells);
    if (status == BW_OK) bw_report_fill_trace(&state->report, &state->cells);
    return status;
}

static bw_status run_build(bw_context *ctx, const bw_options *options, bw_state *state, const char *out) {
    (void)out;
    bw_build_options how = {options->max_cells, options->self_adjacent == BW_SELF_ADJACENT_SPLIT};
    bw_status status = bw_build_complex(ctx, &state->cells, &how, &state->complex);
    if (status != BW_OK) return status;
    state->has_complex = true;
    if (how.split_self_adjacent || state->complex.torus_splits) bw_report_fill_trace(&state->report, &state->cells); /* more walls and cells */
    bw_report_fill_complex(&state->report, &state->complex, complex_names[options->complex]);
    return BW_OK;
}

/* Another complex of the same map, reduced: cells and blocks side by side with the state's own. */
typedef struct {
    bw_cells cells;
    bw_complex complex;
    bw_reduce_report found;
} alternative;

static bw_status make_base_complex(bw_context *ctx, bw_state *state, const bw_build_options *how, bw_cells *cells, bw_complex *complex) {
    bw_status status = bw_cells_init(ctx, cells, &state->mesh, &state->map);
    if (status == BW_OK) status = bw_trace(ctx, cells, BW_COMPLEX_BC, how->max_cells);
    return status == BW_OK ? bw_build_complex(ctx, cells, how, complex) : status;
}

/* Reduction from the base complex (MC 4.2, remark) sometimes ends with fewer blocks than from the motorcycle complex. It may be far larger, so
 * it is given a few times the cells; if that is not enough there is no alternative, which is no failure of the job. */
static bw_status try_base_complex(bw_context *ctx, const bw_options *options, bw_state *state, const bw_reduce_options *how,
                                  alternative *other) {
    bw_context apart = *ctx; /* its own error; the same budget, handed back below */
    uint64_t limit = 8 * (uint64_t)state->cells.cell_count - state->mesh.tet_count; /* all that are not there before the first cut */
    if (limit > options->max_cells) limit = options->max_cells;
    bw_status status = make_base_complex(&apart, state, &(bw_build_options){limit, how->split_self_adjacent}, &other->cells, &other->complex);
    if (status == BW_OK) status = bw_reduce(&apart, &other->cells, &other->complex, how, &other->found);
    if (status == BW_OK) status = bw_cells_check(&apart, &other->cells);
    ctx->memory = apart.memory;
    if (status != BW_OK && status != BW_E_LIMIT && status != BW_E_MEMORY) ctx->error = apart.error;
    return status == BW_E_LIMIT || status == BW_E_MEMORY ? BW_E_LIMIT : status;
}

static bw_status take_if_better(bw_context *ctx, const bw_options *options, bw_state *state, const bw_reduce_options *how,
                                bw_reduce_report *found, bool *taken) {
    alternative *other = bw_alloc(ctx, 1, sizeof *other);
    if (!other) return ctx->error.status;
    bw_status status = try_base_complex(ctx, options, state, how, other);
    *taken = status == BW_OK && other->found.blocks < found->blocks;
    if (*taken) {
        bw_cells cells = state->cells;
        bw_complex complex = state->complex;
        state->cells = other->cells, state->complex = other->complex, *found = other->found;
        other->cells = cells, other->complex = complex;
    }
    bw_complex_clear(ctx, &other->complex);
    bw_cells_clear(ctx, &other->cells);
    bw_free(ctx, other);
    return status == BW_E_LIMIT ? BW_OK : status;
}

/* ---- exploration --------------------------------------------------------------------------------------------------- */

static bw_explore_choice choice_of(const bw_options *o) {
    bw_explore_choice c = {.method = o->explore, .beam = (size_t)o->beam, .expand = o->explore_expand, .seed = o->seed, .work = o->explore_work, .seconds = o->explore_time,
                           .retract = o->reduce != BW_REDUCE_NONE};
    for (int i = 0; i < BW_COST_TERMS; i++) c.weight[i] = o->explore_cost == BW_EXPLORE_WEIGHTED ? o->explore_weights[i] : (int)o->explore_cost == i;
    return c;
}

static void report_exploration(bw_report *report, const bw_options *o, const bw_explore_choice *c, const bw_explore_found *found) {
    static const char *const cuts[] = {"no", "time", "memory", "finish"};
    report->has_exploration = true;
    snprintf(report->exploration.method, sizeof report->exploration.method, "%s", explore_names[o->explore]);
    snprintf(report->exploration.cost, sizeof report->exploration.cost, "%s", explore_cost_names[o->explore_cost]);
    snprintf(report->exploration.expand, sizeof report->exploration.expand, "%s", explore_expand_names[o->explore_expand]);
    snprintf(report->exploration.cut, sizeof report->exploration.cut, "%s", cuts[found->cut]);
    bw_cost_print(c->weight, report->exploration.weights);
    report->exploration.beam = c->beam, report->exploration.seed = c->seed, report->exploration.work = c->work;
    report->exploration.lines = found->lines, report->exploration.sheets = found->sheets, report->exploration.links = found->links;
    report->exploration.crossings = found->crossings, report->exploration.crossings_open = found->crossings_open;
    report->exploration.components = found->components, report->exploration.variable_patches = found->variable_patches;
    report->exploration.start = found->start, report->exploration.serial = found->serial, report->exploration.best = found->best;
    report->exploration.start_blocks = found->start_blocks, report->exploration.serial_blocks = found->serial_blocks;
    report->exploration.best_blocks = found->best_blocks;
    report->exploration.evaluations = found->evaluations, report->exploration.improved_at = found->improved;
    report->exploration.proven = found->proven, report->exploration.seconds = found->seconds;
    report->exploration.component_count = found->listed;
    memcpy(report->exploration.component, found->component, sizeof found->component);
}

/* Explores the base complex, which takes the place of what was traced if that is another. */
static bw_status run_explore(bw_context *ctx, const bw_options *options, bw_state *state) {
    bw_explore_choice choice = choice_of(options);
    bw_explore_found found;
    bw_status status = BW_OK;
    if (options->complex != BW_COMPLEX_BC) {
        bw_complex_clear(ctx, &state->complex);
        bw_cells_clear(ctx, &state->cells);
        status = make_base_complex(ctx, state, &(bw_build_options){options->max_cells, false}, &state->cells, &state->complex);
    }
    if (status == BW_OK && state->has_source) status = bw_trivial_label(ctx, &state->cells, &state->complex, &state->source);
    if (status == BW_OK) status = bw_explore_complex(ctx, &state->cells, &state->complex, state->has_source ? &state->source : NULL, &choice, &found);
    if (status == BW_OK) report_exploration(&state->report, options, &choice, &found);
    return status;
}

/* ---- reduction ----------------------------------------------------------------------------------------------------- */

static bw_status run_reduce(bw_context *ctx, const bw_options *options, bw_state *state, const char *out) {
    (void)out;
    bw_reduce_options how = {options->reduce, options->self_adjacent == BW_SELF_ADJACENT_SPLIT, options->effort};
    bw_reduce_report found = {0};
    bool explored = options->explore != BW_EXPLORE_NONE, from_base = explored;
    bw_status status = explored ? run_explore(ctx, options, state) : BW_OK;
    if (explored && options->explore_cost != BW_EXPLORE_BLOCKS) how.mode = BW_REDUCE_NONE; /* fewer blocks may cost more; exploration took away what did not */
    if (status == BW_OK) status = bw_reduce(ctx, &state->cells, &state->complex, &how, &found);
    if (status != BW_OK || (options->reduce == BW_REDUCE_NONE && !explored)) return status;
    if (!explored && options->effort >= 2 && options->complex == BW_COMPLEX_MC) status = take_if_better(ctx, options, state, &how, &found, &from_base);
    if (status != BW_OK) return status;
    if (from_base) bw_report_fill_trace(&state->report, &state->cells);
    else bw_report_fill_walls(&state->report, &state->cells);
    bw_report_fill_reduced(&state->report, &state->complex, reduce_names[options->reduce]);
    snprintf(state->report.complex.reduced.from, sizeof state->report.complex.reduced.from, "%s",
             complex_names[from_base ? BW_COMPLEX_BC : options->complex]);
    state->report.complex.reduced.effort = (uint64_t)options->effort;
    state->report.complex.reduced.orders_tried = found.runs;
    state->report.complex.reduced.blocks_farthest_first = found.blocks_farthest_first;
    state->report.complex.reduced.patches_removed = found.patches_removed;
    return BW_OK;
}

_Static_assert((int)BW_OPTION_SCALES == (int)BW_SCALES_MAX, "the report has a row for each scale");
_Static_assert((int)BW_OPTION_WEIGHTS == (int)BW_COST_TERMS && (int)BW_EXPLORE_CUBES == (int)BW_COST_CUBES, "there is a weight for each cost");

static bw_status run_quantize(bw_context *ctx, const bw_options *options, bw_state *state, const char *out) {
    (void)out;
    if (options->quantize == BW_QUANTIZE_NONE) return BW_OK;
    bw_quantize_options how = {.range = options->quantize, .scale = options->scale, .fewest_hexes = options->fewest_hexes, .rounding = options->rounding,
                               .target_hexes = options->target_hexes,
                               .seconds = options->time_limit, .scale_count = options->scale_count};
    memcpy(how.scales, options->scales, sizeof how.scales);
    return bw_quantize(ctx, &state->cells, &state->complex, &how, &state->length, &state->report);
}

typedef struct {
    const bw_options *options;
    bw_state *state;
} requantizer;

/* The size that the job asked for, or one about a number of hexes, without the comparisons that the report already has. */
static bw_status requantize(bw_context *ctx, void *user, bool positive, uint64_t target_hexes, int64_t **length, bw_report *report) {
    const requantizer *r = user;
    const bw_options *o = r->options;
    bw_quantize_options how = {.range = positive ? BW_QUANTIZE_POSITIVE : o->quantize, .scale = o->scale, .fewest_hexes = o->fewest_hexes && !target_hexes,
                               .target_hexes = target_hexes ? target_hexes : o->target_hexes, .seconds = o->time_limit};
    size_t sweep_count = report->sweep_count;
    bw_report_rounding rounding = report->quantization.rounding;
    bw_status status = bw_quantize(ctx, &r->state->cells, &r->state->complex, &how, length, report);
    report->sweep_count = sweep_count, report->quantization.rounding = rounding;
    return status;
}

static bw_status run_reparametrize(bw_context *ctx, const bw_options *options, bw_state *state, const char *out) {
    (void)out;
    if (!state->length) return BW_OK;
    requantizer r = {options, state};
    bw_reparametrize_options how = {options->route, options->max_map_work, options->subdivide, options->max_hexes, requantize, &r};
    return bw_reparametrize(ctx, &state->cells, &state->complex, &how, &state->length, &state->igm, &state->has_igm, &state->report);
}

static bw_status run_extract(bw_context *ctx, const bw_options *options, bw_state *state, const char *out) {
    (void)out;
    if (state->has_source && bw_extract_labels(ctx, &state->cells, &state->complex, &state->source, &state->report)) return ctx->error.status;
    if (!state->length) return state->has_source ? bw_extract_finish(ctx, &state->mesh, state->map.edge_flags, false, &state->source, &state->report) : BW_OK;
    bw_extract_options how = {options->subdivide, options->max_hexes};
    const bw_tet_mesh *mesh = state->has_igm ? &state->igm.mesh : &state->mesh;
    const uint8_t *flags = state->has_igm ? state->igm.map.edge_flags : state->map.edge_flags;
    bw_extract_input in = {&state->cells, &state->complex, state->length, state->has_igm ? &state->igm : NULL};
    bw_status status = bw_extract(ctx, &in, &how, &state->hex, &state->report);
    if (status == BW_OK) status = bw_extract_finish(ctx, mesh, flags, options->smooth, &state->hex, &state->report);
    state->has_hex = status == BW_OK;
    return status;
}

static bw_status run_encode(bw_context *ctx, const bw_options *options, bw_state *state, const char *out) {
    bw_encode_options how = {options->vtk, options->tmesh, options->hex_formats, options->bwh_bits, state->has_igm ? &state->igm : NULL, state->has_source ? &state->source : NULL, state->source_vertex};
    const bw_hex_mesh *hex = state->has_hex ? &state->hex : NULL;
    return bw_encode(ctx, &state->mesh, &state->map, &state->cells, &state->complex, state->length, hex, &how, &state->report, out);
}

/* A version changes whenever a stage's result for the same input does, or its state file. */
static const struct {
    const char *name;
    int version;
    stage_run *run;
} stages[BW_STAGE_COUNT] = {
    [BW_STAGE_SANITIZE] = {"sanitize", 6, run_sanitize},
    [BW_STAGE_TRACE] = {"trace", 9, run_trace},
    [BW_STAGE_BUILD] = {"build", 10, run_build},
    [BW_STAGE_REDUCE] = {"reduce", 8, run_reduce},
    [BW_STAGE_QUANTIZE] = {"quantize", 10, run_quantize},
    [BW_STAGE_REPARAMETRIZE] = {"reparametrize", 4, run_reparametrize},
    [BW_STAGE_EXTRACT] = {"extract", 8, run_extract},
    [BW_STAGE_ENCODE] = {"encode", 15, run_encode},
};

const char *bw_version(void) { return BW_VERSION; }
const char *bw_stage_name(bw_stage stage) { return stages[stage].name; }
int bw_stage_version(bw_stage stage) { return stages[stage].version; }

bw_status bw_stage_from_name(const char *name, bw_stage *stage) {
    for (int s = 0; s < BW_STAGE_COUNT; s++)
        if (!strcmp(stages[s].name, name)) {
            *stage = (bw_stage)s;
            return BW_OK;
        }
    return BW_E_USAGE;
}

#define BW_SCALE_MAX 1e4 /* a model of 1000 parameter units has 10^7 hexes along it then */

/* ---- options ------------------------------------------------------------------------------------------------------- */

void bw_options_defaults(bw_options *options) {
    *options = (bw_options){.complex = BW_COMPLEX_MC, .reduce = BW_REDUCE_KEEP_SINGULAR, .effort = 1, .beam = 500, .seed = 1, .explore_work = 200000, .explore_time = 60, .until = BW_STAGE_ENCODE, .tolerance = 1e-4, .max_cells = 4000000,
                            .scale = 1, .time_limit = 10, .subdivide = 1, .smooth = true, .max_hexes = 10000000, .max_map_work = 400,
                            .hex_formats = 1u << BW_HEX_FORMAT_MESH | 1u << BW_HEX_FORMAT_VTU | 1u << BW_HEX_FORMAT_BWH};
}

/* Index of a word in a list of names; -1 if it is none of them. */
static int choice(const json_t *value, const char *const *names, int count) {
    const char *word = json_string_value(value);
    for (int i = 0; i < count && word; i++)
        if (!strcmp(word, names[i])) return i;
    return -1;
}

static bw_status set_scales(bw_context *ctx, bw_options *o, const json_t *value) {
    o->scale_count = 0;
    bool good = json_is_array(value) && json_array_size(value) <= BW_OPTION_SCALES;
    for (size_t i = 0; good && i < json_array_size(value); i++) {
        const json_t *item = json_array_get(value, i);
        double scale = json_number_value(item);
        good = json_is_number(item) && scale >= 0 && scale <= BW_SCALE_MAX;
        if (good) o->scales[o->scale_count++] = scale;
    }
    return good ? BW_OK : bw_fail(ctx, BW_E_USAGE, "option scales is a list of up to %d numbers from 0 to %g", BW_OPTION_SCALES, BW_SCALE_MAX);
}

static bw_status set_hex_formats(bw_context *ctx, bw_options *o, const json_t *value) {
    o->hex_formats = 0;
    bool good = json_is_array(value);
    for (size_t i = 0; good && i < json_array_size(value); i++) {
        const char *name = json_string_value(json_array_get(value, i));
        bw_hex_format format;
        good = name && bw_hex_format_from_name(name, &format) == BW_OK;
        if (good) o->hex_formats |= 1u << format;
    }
    return good ? BW_OK : bw_fail(ctx, BW_E_USAGE, "option hex_formats is a list of names out of mesh, vtk, vtu, msh, ovm, inp, cgns, bwh");
}

static bw_status set_weights(bw_context *ctx, bw_options *o, const json_t *value) {
    bool good = json_is_array(value) && json_array_size(value) <= BW_OPTION_WEIGHTS;
    memset(o->explore_weights, 0, sizeof o->explore_weights);
    for (size_t i = 0; good && i < json_array_size(value); i++) {
        o->explore_weights[i] = json_number_value(json_array_get(value, i));
        good = json_is_number(json_array_get(value, i)) && o->explore_weights[i] >= 0 && o->explore_weights[i] <= 1000;
    }
    return good ? BW_OK : bw_fail(ctx, BW_E_USAGE, "option explore_weights is a list of up to %d numbers from 0 to 1000", BW_OPTION_WEIGHTS);
}

static bw_status set_explore(bw_context *ctx, bw_options *o, const char *name, const json_t *value) {
    json_int_t number = json_integer_value(value);
    int i;
    if (!strcmp(name, "explore")) {
        if ((i = choice(value, explore_names, 7)) < 0)
            return bw_fail(ctx, BW_E_USAGE, "option explore is \"none\", \"auto\", \"enumerate\", \"swap\", \"enumerate+swap\", \"anneal\" or \"exact\"");
        o->explore = (bw_explore_method)i;
    } else if (!strcmp(name, "explore_cost")) {
        if ((i = choice(value, explore_cost_names, 5)) < 0)
            return bw_fail(ctx, BW_E_USAGE, "option explore_cost is \"blocks\", \"bits\", \"bits-by-block\", \"cubes\" or \"weighted\"");
        o->explore_cost = (bw_explore_cost)i;
    } else if (!strcmp(name, "explore_weights")) {
        return set_weights(ctx, o, value);
    } else if (!strcmp(name, "explore_expand")) {
        if ((i = choice(value, explore_expand_names, 2)) < 0) return bw_fail(ctx, BW_E_USAGE, "option explore_expand is \"random\" or \"cheapest\"");
        o->explore_expand = (bw_explore_expand)i;
    } else if (!strcmp(name, "beam")) {
        if (!json_is_integer(value) || number < 1 || number > 1000000) return bw_fail(ctx, BW_E_USAGE, "option beam is an integer from 1 to 1000000");
        o->beam = (int)number;
    } else if (!strcmp(name, "seed")) {
        if (!json_is_integer(value) || number < 1 || number > 1000000000) return bw_fail(ctx, BW_E_USAGE, "option seed is an integer from 1 to 1000000000");
        o->seed = (uint64_t)number;
    } else if (!strcmp(name, "explore_work")) {
        if (!json_is_integer(value) || number < 1 || number > 1000000000) return bw_fail(ctx, BW_E_USAGE, "option explore_work is an integer from 1 to 1000000000");
        o->explore_work = (uint64_t)number;
    } else {
        o->explore_time = json_number_value(value);
        if (!json_is_number(value) || !(o->explore_time >= 0 && o->explore_time <= 3600))
            return bw_fail(ctx, BW_E_USAGE, "option explore_time is a number of seconds from 0 to 3600");
    }
    return BW_OK;
}

static bool is_of_explore(const char *name) {
    static const char *const names[] = {"explore", "explore_cost", "explore_weights", "explore_expand", "explore_work", "explore_time", "beam", "seed"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        if (!strcmp(name, names[i])) return true;
    return false;
}

/* What two options together cannot mean. */
static bw_status check_options(bw_context *ctx, const bw_options *o) {
    double weights = 0;
    for (int i = 0; i < BW_OPTION_WEIGHTS; i++) weights += o->explore_weights[i];
    if (o->fewest_hexes && o->target_hexes) return bw_fail(ctx, BW_E_USAGE, "options fewest_hexes and target_hexes are two sizes, a job has one");
    if (o->explore == BW_EXPLORE_NONE) return BW_OK;
    if (o->self_adjacent == BW_SELF_ADJACENT_SPLIT) return bw_fail(ctx, BW_E_USAGE, "option explore makes blocks that may touch themselves, so self_adjacent cannot be \"split\"");
    if (o->explore_cost == BW_EXPLORE_WEIGHTED && weights < 1e-3) return bw_fail(ctx, BW_E_USAGE, "option explore_cost \"weighted\" wants explore_weights that add up to 0.001 at least");
    if (o->explore_cost != BW_EXPLORE_BLOCKS && o->reduce == BW_REDUCE_FULL)
        return bw_fail(ctx, BW_E_USAGE, "option reduce \"full\" is for fewest blocks, so explore_cost has to be \"blocks\" beside it");
    return BW_OK;
}

static bw_status set_quantize(bw_context *ctx, bw_options *o, const char *name, const json_t *value) {
    static const char *const words[] = {"none", "positive", "nonnegative", "any"};
    if (!strcmp(name, "quantize")) {
        int i = choice(value, words, 4);
        if (i < 0) return bw_fail(ctx, BW_E_USAGE, "option quantize is \"none\", \"positive\", \"nonnegative\" or \"any\"");
        o->quantize = (bw_quantize_range)i;
    } else if (!strcmp(name, "scale")) {
        o->scale = json_number_value(value);
        if (!json_is_number(value) || !(o->scale >= 0 && o->scale <= BW_SCALE_MAX))
            return bw_fail(ctx, BW_E_USAGE, "option scale is a number from 0 to %g", BW_SCALE_MAX);
    } else if (!strcmp(name, "target_hexes")) {
        if (!json_is_integer(value) || json_integer_value(value) < 0 || json_integer_value(value) > 1000000000)
            return bw_fail(ctx, BW_E_USAGE, "option target_hexes is an integer from 0 to 1000000000");
        o->target_hexes = (uint64_t)json_integer_value(value);
    } else if (!strcmp(name, "fewest_hexes")) {
        if (!json_is_boolean(value)) return bw_fail(ctx, BW_E_USAGE, "option fewest_hexes is true or false");
        o->fewest_hexes = json_is_true(value);
    } else if (!strcmp(name, "rounding")) {
        if (!json_is_boolean(value)) return bw_fail(ctx, BW_E_USAGE, "option rounding is true or false");
        o->rounding = json_is_true(value);
    } else if (!strcmp(name, "time_limit")) {
        o->time_limit = json_number_value(value);
        if (!json_is_number(value) || !(o->time_limit >= 0 && o->time_limit <= 3600))
            return bw_fail(ctx, BW_E_USAGE, "option time_limit is a number of seconds from 0 to 3600");
    } else if (!strcmp(name, "scales")) {
        return set_scales(ctx, o, value);
    } else {
        return bw_fail(ctx, BW_E_USAGE, "there is no option \"%s\"", name);
    }
    return BW_OK;
}

static bw_status set_option(bw_context *ctx, bw_options *o, const char *name, const json_t *value) {
    const char *word = json_string_value(value);
    int i;
    if (!strcmp(name, "kind")) {
        if ((i = choice(value, kind_names, 3)) < 0) return bw_fail(ctx, BW_E_USAGE, "option kind is \"auto\", \"tet\" or \"hex\"");
        o->kind = (bw_input_kind)i;
    } else if (!strcmp(name, "complex")) {
        if ((i = choice(value, complex_names, 3)) < 0)
            return bw_fail(ctx, BW_E_USAGE, "option complex is \"mc\", \"bc\" or \"serial\"");
        o->complex = (bw_complex_kind)i;
    } else if (!strcmp(name, "reduce")) {
        if ((i = choice(value, reduce_names, 3)) < 0)
            return bw_fail(ctx, BW_E_USAGE, "option reduce is \"none\", \"keep-singular\" or \"full\"");
        o->reduce = (bw_reduce_mode)i;
    } else if (!strcmp(name, "self_adjacent")) {
        if ((i = choice(value, self_adjacent_names, 2)) < 0)
            return bw_fail(ctx, BW_E_USAGE, "option self_adjacent is \"allow\" or \"split\"");
        o->self_adjacent = (bw_self_adjacent)i;
    } else if (!strcmp(name, "vtk") || !strcmp(name, "tmesh")) {
        static const char *const words[] = {"no", "yes"};
        if ((i = choice(value, words, 2)) < 0) return bw_fail(ctx, BW_E_USAGE, "option %s is \"no\" or \"yes\"", name);
        *(*name == 'v' ? &o->vtk : &o->tmesh) = i == 1;
    } else if (!strcmp(name, "repair")) {
        if (!json_is_boolean(value)) return bw_fail(ctx, BW_E_USAGE, "option repair is true or false");
        o->repair = json_is_true(value);
    } else if (!strcmp(name, "effort")) {
        if (!json_is_integer(value) || json_integer_value(value) < 0 || json_integer_value(value) > 3)
            return bw_fail(ctx, BW_E_USAGE, "option effort is an integer from 0 to 3");
        o->effort = (int)json_integer_value(value);
    } else if (!strcmp(name, "route")) {
        static const char *const words[] = {"auto", "quality", "guaranteed"};
        if ((i = choice(value, words, 3)) < 0) return bw_fail(ctx, BW_E_USAGE, "option route is \"auto\", \"quality\" or \"guaranteed\"");
        o->route = (bw_igm_route)i;
    } else if (!strcmp(name, "max_map_work")) {
        if (!json_is_integer(value) || json_integer_value(value) < 1 || json_integer_value(value) > 1000000)
            return bw_fail(ctx, BW_E_USAGE, "option max_map_work is an integer from 1 to 1000000");
        o->max_map_work = (int)json_integer_value(value);
    } else if (!strcmp(name, "subdivide")) {
        if (!json_is_integer(value) || json_integer_value(value) < 1 || json_integer_value(value) > 1000)
            return bw_fail(ctx, BW_E_USAGE, "option subdivide is an integer from 1 to 1000");
        o->subdivide = (int)json_integer_value(value);
    } else if (!strcmp(name, "max_hexes")) {
        if (!json_is_integer(value) || json_integer_value(value) < 1 || json_integer_value(value) > 350000000)
            return bw_fail(ctx, BW_E_USAGE, "option max_hexes is an integer from 1 to 350000000");
        o->max_hexes = (uint64_t)json_integer_value(value);
    } else if (!strcmp(name, "smooth")) {
        static const char *const words[] = {"off", "on"};
        if ((i = choice(value, words, 2)) < 0) return bw_fail(ctx, BW_E_USAGE, "option smooth is \"on\" or \"off\"");
        o->smooth = i == 1;
    } else if (!strcmp(name, "hex_formats")) {
        return set_hex_formats(ctx, o, value);
    } else if (!strcmp(name, "bwh_bits")) {
        if (!json_is_integer(value) || json_integer_value(value) < 0 || json_integer_value(value) > 24)
            return bw_fail(ctx, BW_E_USAGE, "option bwh_bits is an integer from 0 to 24");
        o->bwh_bits = (int)json_integer_value(value);
    } else if (!strcmp(name, "until")) {
        if (!word || bw_stage_from_name(word, &o->until) != BW_OK)
            return bw_fail(ctx, BW_E_USAGE, "option until is the name of a stage");
    } else if (!strcmp(name, "tolerance")) {
        o->tolerance = json_number_value(value);
        if (!json_is_number(value) || !(o->tolerance >= 0 && o->tolerance < 0.1))
            return bw_fail(ctx, BW_E_USAGE, "option tolerance is a number from 0 to below 0.1");
    } else if (!strcmp(name, "max_cells")) {
        if (!json_is_integer(value) || json_integer_value(value) < 1)
            return bw_fail(ctx, BW_E_USAGE, "option max_cells is a positive integer");
        o->max_cells = (uint64_t)json_integer_value(value);
    } else if (is_of_explore(name)) {
        return set_explore(ctx, o, name, value);
    } else {
        return set_quantize(ctx, o, name, value);
    }
    return BW_OK;
}

bw_status bw_options_from_json(bw_context *ctx, bw_options *options, const char *json, size_t length) {
    json_error_t error;
    json_t *root = json_loadb(json, length, JSON_REJECT_DUPLICATES, &error);
    bw_status status = BW_OK;
    if (!json_is_object(root)) {
        status = bw_fail(ctx, BW_E_USAGE, "options are a JSON object: %s", root ? "this is something else" : error.text);
    } else {
        const char *name;
        json_t *value;
        json_object_foreach(root, name, value) {
            if (status == BW_OK) status = set_option(ctx, options, name, value);
        }
        if (status == BW_OK) status = check_options(ctx, options);
    }
    json_decref(root);
    return status;
}

/* ---- running ------------------------------------------------------------------------------------------------------- */

static double begin_stage(bw_context *ctx, const char *name) {
    ctx->stage = name;
    ctx->memory.peak = ctx->memory.used;
    bw_progress(ctx, 0);
    return bw_seconds_now();
}

static void end_stage(bw_context *ctx, bw_report *report, double since) {
    bw_report_add_stage(report, ctx->stage, bw_seconds_now() - since, ctx->memory.peak);
    if (ctx->error.status == BW_OK) bw_progress(ctx, 1);
}

static bw_status load(bw_context *ctx, const bw_options *options, const char *input, bw_state *state) {
    double since = begin_stage(ctx, "load");
    struct stat info;
    const char *slash = strrchr(input, '/');
    if (strncmp(input, "/proc/", 6) && strncmp(input, "/dev/", 5)) /* a descriptor has no name worth keeping */
        snprintf(state->report.input.file, sizeof state->report.input.file, "%s", slash ? slash + 1 : input);
    if (stat(input, &info) == 0) state->report.input.bytes = (uint64_t)info.st_size;
    bw_status status = bw_input_read(ctx, input, options->parameters, &state->mesh);
    end_stage(ctx, &state->report, since);
    return status;
}

static bw_status run_stage(bw_context *ctx, const bw_options *options, bw_stage stage, bw_state *state, const char *out) {
    double since = begin_stage(ctx, stages[stage].name);
    bw_status status = bw_poll(ctx);
    if (status == BW_OK) status = stages[stage].run(ctx, options, state, out);
    end_stage(ctx, &state->report, since);
    return status;
}

static bw_status make_folder(bw_context *ctx, const char *path) {
    if (mkdir(path, 0777) == 0 || errno == EEXIST) return BW_OK;
    return bw_fail(ctx, BW_E_IO, "cannot make the folder %s: %s", path, strerror(errno));
}

/* The report is written last, and also when the job failed. */
static bw_status write_report(bw_context *ctx, bw_state *state, const char *out) {
    char path[4096];
    if (snprintf(path, sizeof path, "%s/report.json", out) >= (int)sizeof path)
        return bw_fail(ctx, BW_E_USAGE, "the name of the result folder is too long");
    state->report.error = ctx->error;
    return bw_report_write(ctx, &state->report, path);
}

bw_status bw_run(bw_context *ctx, const bw_options *options, const char *input, const char *out) {
    bw_state *state = calloc(1, sizeof *state);
    if (!state) return bw_fail(ctx, BW_E_MEMORY, "no memory for the job");
    bw_state_init(state);
    bw_status status = make_folder(ctx, out);
    if (status == BW_OK) {
        status = load(ctx, options, input, state);
        for (int s = 0; s <= (int)options->until && status == BW_OK; s++) status = run_stage(ctx, options, (bw_stage)s, state, out);
        bw_status written = write_report(ctx, state, out);
        if (status == BW_OK) status = written;
    }
    bw_state_clear(ctx, state);
    free(state);
    return status;
}

bw_status bw_stage_run(bw_context *ctx, const bw_options *options, bw_stage stage, const char *input, const char *output) {
    bw_state *state = calloc(1, sizeof *state);
    if (!state) return bw_fail(ctx, BW_E_MEMORY, "no memory for the job");
    bw_state_init(state);
    bw_status status;
    if (stage == BW_STAGE_SANITIZE) status = load(ctx, options, input, state);
    else status = bw_state_read(ctx, state, stages[stage - 1].name, stages[stage - 1].version, input);
    if (stage == BW_STAGE_ENCODE && status == BW_OK) status = make_folder(ctx, output);
    if (status == BW_OK) status = run_stage(ctx, options, stage, state, output);
    if (status == BW_OK) ctx->input_kind = state->report.input.hexes ? BW_KIND_HEX : BW_KIND_TET;
    if (stage == BW_STAGE_ENCODE) {
        bw_status written = write_report(ctx, state, output);
        if (status == BW_OK) status = written;
    } else if (status == BW_OK) {
        ctx->next_need = bw_need(options, (bw_stage)(stage + 1), state, ctx->memory.used);
        status = bw_state_write(ctx, state, stages[stage].name, stages[stage].version, output);
    }
    bw_state_clear(ctx, state);
    free(state);
    return status;
}

char *bw_error_json(const bw_context *ctx) { return bw_report_error_json(&ctx->error); }
