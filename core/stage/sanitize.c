#include "stage/sanitize.h"

#include <gmp.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "mesh/sectors.h"
#include "solve/echelon.h"
#include "stage/sanitize_repair.h"

enum { USUAL_BITS = 44, MAX_BITS = 46 }; /* of the largest parameter on the grid */

typedef struct {
    bw_context *ctx;
    const bw_sanitize_options *options;
    bw_tet_mesh *mesh;
    bw_grid_map *map;
    bw_sanitize_report *report;
    bw_hinges hinges;
    bw_seams seams;
    bw_cutset cut;
    bw_core_system system;
    int64_t *solution;
    int64_t (*rounded)[4][3]; /* the input on the grid; borrowed from map->value until step 4 */
    bw_defects defects;       /* of the rounded input */
    bw_seams first_seams;     /* as read off the map with its defects, if they are repaired */
    uint8_t *unsure;          /* [tet] likewise: tets that share a vertex with a defective one */
} job;

/* ---- the grid ---- */

/* Number of bits behind the binary point that x needs; x is finite and not 0. */
static int bits_behind(double x) {
    int exponent;
    int64_t mantissa = (int64_t)ldexp(frexp(x, &exponent), 53);
    return 53 - exponent - __builtin_ctzll((unsigned long long)mantissa);
}

/* The usual exponent puts the largest parameter between 2^43 and 2^44. If all parameters are multiples of a
 * finer power of two that the grid still holds, that one is taken, so that values which are exact already
 * stay what they are. */
static bw_status choose_exponent(job *j) {
    double largest = 0;
    int exponent, needed = INT32_MIN;
    const double *p = &j->mesh->parameter[0][0][0];
    for (size_t i = 0; i < 12 * j->mesh->tet_count; i++) {
        if (p[i] == 0) continue;
        largest = fmax(largest, fabs(p[i]));
        int bits = bits_behind(p[i]);
        if (bits > needed) needed = bits;
    }
    frexp(largest, &exponent);
    j->map->exponent = USUAL_BITS - exponent;
    if (needed > j->map->exponent && ldexp(largest, needed) <= (double)BW_GRID_MAX) j->map->exponent = needed;
    j->report->grid_exponent = j->map->exponent;
    if (abs(exponent) > 900)
        return bw_fail(j->ctx, BW_E_RANGE, "parameters up to %g are outside what doubles can be scaled to",
                       largest);
    return BW_OK;
}

static bw_status round_values(job *j) {
    size_t n = 12 * j->mesh->tet_count;
    j->map->value = bw_alloc(j->ctx, j->mesh->tet_count, sizeof *j->map->value);
    if (!j->map->value) return j->ctx->error.status;
    const double *p = &j->mesh->parameter[0][0][0];
    int64_t *v = &j->map->value[0][0][0];
    double scale = ldexp(1, j->map->exponent); /* products with it are exact */
    for (size_t i = 0; i < n; i++) v[i] = llrint(p[i] * scale);
    return BW_OK;
}

static double displacement(const job *j) {
    const double *p = &j->mesh->parameter[0][0][0];
    const int64_t *v = &j->map->value[0][0][0];
    double most = 0, scale = ldexp(1, j->map->exponent);
    for (size_t i = 0; i < 12 * j->mesh->tet_count; i++) most = fmax(most, fabs((double)v[i] - p[i] * scale));
    return ldexp(most, -j->map->exponent);
}

/* ---- orientation ---- */

static void swap_corners(job *j) {
    for (size_t t = 0; t < j->mesh->tet_count; t++) {
        bw_vertex v = j->mesh->tet[t][2];
        j->mesh->tet[t][2] = j->mesh->tet[t][3];
        j->mesh->tet[t][3] = v;
        for (int k = 0; k < 3; k++) {
            double p = j->mesh->parameter[t][2][k];
            j->mesh->parameter[t][2][k] = j->mesh->parameter[t][3][k];
            j->mesh->parameter[t][3][k] = p;
            int64_t x = j->map->value[t][2][k];
            j->map->value[t][2][k] = j->map->value[t][3][k];
            j->map->value[t][3][k] = x;
        }
    }
    j->mesh->mirrored = 1;
}

/* Exact sign of a tet's volume in the parameters as read. */
static int true_sign(const double p[4][3]) {
    mpq_t d[3][3], sum, product, x;
    mpq_inits(sum, product, x, NULL);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) {
            mpq_init(d[i][k]);
            mpq_set_d(d[i][k], p[i + 1][k]);
            mpq_set_d(x, p[0][k]);
            mpq_sub(d[i][k], d[i][k], x);
        }
    for (int k = 0; k < 3; k++) {
        int l = (k + 1) % 3, m = (k + 2) % 3;
        mpq_mul(product, d[1][l], d[2][m]);
        mpq_mul(x, d[1][m], d[2][l]);
        mpq_sub(product, product, x);
        mpq_mul(product, product, d[0][k]);
        mpq_add(sum, sum, product);
    }
    int sign = mpq_sgn(sum);
    for (int i = 0; i < 9; i++) mpq_clear(d[i / 3][i % 3]);
    mpq_clears(sum, product, x, NULL);
    return sign;
}

/* Decides whether the file lists mirrored tets: the sign of the larger number of them. */
static bool is_mirrored(const job *j) {
    size_t negative = 0, positive = 0;
    for (size_t t = 0; t < j->mesh->tet_count; t++) {
        int sign = bw_grid_tet_sign((const int64_t(*)[3])j->map->value[t]);
        negative += sign<0, positive += sign> 0;
    }
    return negative > positive;
}

/* ---- defective tets ---- */

static const int64_t (*values(const job *j))[4][3] { return (const int64_t(*)[4][3])j->map->value; }

static bool truly_bad(const job *j, size_t region) {
    for (size_t i = j->defects.first[region]; i < j->defects.first[region + 1]; i++)
        if (true_sign((const double(*)[3])j->mesh->parameter[j->defects.tet[i]]) <= 0) return true;
    return false;
}

/* Refuses regions of tets that are not positive, except those to be spared ([region]; NULL: none); where all of them are so
 * only on the grid, it is too coarse for them. */
static bw_status refuse(job *j, const uint8_t *spare, const char *why) {
    size_t inverted = 0, regions = 0, tets = 0;
    for (size_t r = 0; r < j->defects.count; r++) inverted += !(spare && spare[r]) && truly_bad(j, r);
    for (size_t r = 0; r < j->defects.count; r++) {
        if ((spare && spare[r]) || (inverted && !truly_bad(j, r))) continue;
        bw_defects_blame(j->ctx, &j->defects, j->mesh, r);
        tets += j->defects.first[r + 1] - j->defects.first[r], regions++;
    }
    if (!inverted)
        return bw_fail(j->ctx, BW_E_RANGE,
                       "%zu tets are too small for the exact grid, which the largest parameter sets to 2^%d%s%s", tets,
                       -j->map->exponent, *why ? ", and cannot be repaired: " : "", why);
    return bw_fail(j->ctx, BW_E_INVERTED,
                   "%zu tet%s in %zu region%s inverted or degenerate in the parametrization%s%s; the first is tet %lld", tets,
                   tets == 1 ? "" : "s", regions, tets == 1 ? " is" : regions == 1 ? " are" : "s are",
                   *why ? " and cannot be repaired: " : "", why, (long long)j->ctx->error.elements[0].id);
}

static void report_repair(job *j, const bw_defects *defects, const bw_repair_report *done) {
    bw_sanitize_report *r = j->report;
    for (size_t i = 0; i < defects->count && r->region_count + i < BW_REGIONS_KEPT; i++)
        bw_defects_place(defects, j->mesh, i, &r->regions[r->region_count + i]);
    r->repaired = true;
    r->region_count += defects->count;
    r->defective_tets += bw_defects_tets(defects);
    r->vertices_moved += done->vertices_moved;
    if (done->rings > r->rings) r->rings = done->rings;
    r->repair_displacement_max = fmax(r->repair_displacement_max, ldexp((double)done->displacement, -j->map->exponent));
}

/* Spares the regions all of whose tets were repaired; the verdict on the first other tet is the reason to refuse. */
static bw_repair_verdict spare_repaired(const bw_defects *defects, const bw_repair_verdict *verdict, uint8_t *spare) {
    bw_repair_verdict first = BW_REPAIR_DONE;
    for (size_t r = 0; r < defects->count; r++) {
        spare[r] = 1;
        for (size_t i = defects->first[r]; i < defects->first[r + 1]; i++) {
            if (verdict[i] == BW_REPAIR_DONE) continue;
            if (first == BW_REPAIR_DONE) first = verdict[i];
            spare[r] = 0;
        }
    }
    return first;
}

/* For an error other than the defects themselves, but for which they may be the reason: it names the regions too. */
static bw_status blame_regions(job *j) {
    bw_status status = j->ctx->error.status;
    bool local = status == BW_E_INVERTED || status == BW_E_NOT_SEAMLESS || status == BW_E_NOT_ALIGNED || status == BW_E_SINGULAR;
    for (size_t r = 0; local && r < j->defects.count; r++) {
        bw_region place;
        bw_defects_place(&j->defects, j->mesh, r, &place);
        bw_fail_region(j->ctx, &place);
    }
    return status;
}

/* A vertex that is out of place spoils all tets around it, also those that happen to be positive: they may turn around their
 * edges once too often. */
static bw_status mark_unsure(job *j) {
    uint8_t *near = bw_alloc(j->ctx, j->mesh->vertex_count, 1);
    j->unsure = bw_alloc(j->ctx, j->mesh->tet_count, 1);
    for (size_t i = 0; near && j->unsure && i < 4 * bw_defects_tets(&j->defects); i++)
        near[j->mesh->tet[j->defects.tet[i / 4]][i % 4]] = 1;
    for (size_t i = 0; near && j->unsure && i < 4 * j->mesh->tet_count; i++) j->unsure[i / 4] |= near[j->mesh->tet[i / 4][i % 4]];
    bw_free(j->ctx, near);
    return j->ctx->error.status;
}

/* Repairs the defects of the rounded input or refuses those that it cannot repair. */
static bw_status repair(job *j) {
    bw_context *ctx = j->ctx;
    bw_star_input in = {j->mesh, &j->hinges, &j->first_seams, values(j), NULL, j->options->tolerance};
    bw_repair_report done;
    size_t count = bw_defects_tets(&j->defects);
    bw_repair_verdict first, *verdict = bw_alloc(ctx, count, sizeof *verdict);
    uint8_t *spare = bw_alloc(ctx, j->defects.count, 1);
    if (ctx->error.status || mark_unsure(j)) goto out;
    in.unsure = j->unsure;
    if (bw_hinges_init(ctx, &j->hinges, j->mesh)) {
        blame_regions(j); /* tets are listed the other way round than their neighbours */
        goto out;
    }
    if (bw_seams_init(ctx, &j->first_seams, j->mesh, &j->hinges, values(j), j->unsure, j->options->tolerance) ||
        bw_repair(ctx, &in, &j->defects, j->map->value, verdict, &done))
        goto out;
    first = spare_repaired(&j->defects, verdict, spare);
    if (first != BW_REPAIR_DONE)
        refuse(j, spare, bw_repair_verdict_text(first));
    else
        report_repair(j, &j->defects, &done);
out:
    bw_free(ctx, verdict);
    bw_free(ctx, spare);
    return ctx->error.status;
}

static bw_status mend(job *j) {
    if (bw_defects_init(j->ctx, &j->defects, j->mesh, values(j))) return j->ctx->error.status;
    if (!j->defects.count) return BW_OK;
    return j->options->repair ? repair(j) : refuse(j, NULL, "");
}

/* Spares the regions that have no tet at a doubtful hinge. */
static void spare_certain(const job *j, const uint8_t *doubtful, uint8_t *spare) {
    memset(spare, 1, j->defects.count);
    for (size_t r = 0; r < j->defects.count; r++)
        for (size_t i = j->defects.first[r]; i < j->defects.first[r + 1]; i++)
            for (int e = 0; e < 6; e++) {
                bw_edge edge = j->mesh->tet_edge[j->defects.tet[i]][e];
                for (bw_hinge h = j->hinges.first[edge]; h < j->hinges.first[edge + 1]; h++)
                    if (doubtful[h]) spare[r] = 0;
            }
    if (!memchr(spare, 0, j->defects.count)) memset(spare, 0, j->defects.count);
}

/* Refuses repairs after which the map may turn around edges otherwise than meant. */
static bw_status check_turns(job *j) {
    bw_star_input before = {j->mesh, &j->hinges, &j->first_seams, values(j), j->unsure, j->options->tolerance};
    size_t count = 0;
    if (!j->report->repaired) return BW_OK;
    uint8_t *doubtful = bw_alloc(j->ctx, j->hinges.count, 1), *spare = bw_alloc(j->ctx, j->defects.count, 1);
    if (doubtful && spare && !bw_repair_check_turns(j->ctx, &before, &j->seams, doubtful, &count) && count) {
        spare_certain(j, doubtful, spare);
        refuse(j, spare, "it is not clear how often the map turns around their edges");
    }
    bw_free(j->ctx, doubtful);
    bw_free(j->ctx, spare);
    return j->ctx->error.status;
}

/* The exact values are off the input's by its errors; thin tets may not survive that. Transitions are known by now. What
 * remains defective is refused by the verification that follows. */
static bw_status mend_exact(job *j) {
    bw_defects late;
    bw_repair_report done;
    bw_star_input in = {j->mesh, &j->hinges, &j->seams, values(j), NULL, j->options->tolerance};
    if (!j->options->repair || bw_defects_init(j->ctx, &late, j->mesh, values(j)) || !late.count)
        return j->ctx->error.status;
    bw_repair_verdict *verdict = bw_alloc(j->ctx, bw_defects_tets(&late), sizeof *verdict);
    if (verdict && !bw_repair(j->ctx, &in, &late, j->map->value, verdict, &done)) report_repair(j, &late, &done);
    bw_free(j->ctx, verdict);
    bw_defects_clear(j->ctx, &late);
    return j->ctx->error.status;
}

/* After a repair the verified map has to turn around every edge as often as was found to be meant. */
static bw_status compare_turns(job *j) {
    size_t bad = 0;
    for (size_t e = 0; j->report->repaired && e < j->mesh->edge_count; e++) {
        bw_hinge h = j->hinges.first[e];
        if (j->hinges.first[e + 1] - h > 1 || j->map->quarters[e] == j->seams.quarters[h]) continue;
        double centre[3];
        bw_edge_centre(j->mesh, (bw_edge)e, centre);
        bw_fail_element(j->ctx, "edge", (int64_t)e, centre);
        bad++;
    }
    return bad ? bw_fail(j->ctx, BW_E_INVERTED, "the repaired map turns around %zu edges otherwise than it should", bad)
               : BW_OK;
}

/* ---- the steps ---- */

static bw_status load_grid(job *j) {
    if (!j->mesh->tet_count) return bw_fail(j->ctx, BW_E_EMPTY, "the input has no tets");
    if (bw_tet_mesh_order(j->ctx, j->mesh) || choose_exponent(j) || round_values(j)) return j->ctx->error.status;
    if (is_mirrored(j)) swap_corners(j);
    return bw_tet_mesh_connect(j->ctx, j->mesh);
}

static bw_status understand(job *j) {
    const int64_t(*value)[4][3] = values(j);
    if (!j->hinges.first && bw_hinges_init(j->ctx, &j->hinges, j->mesh)) return j->ctx->error.status;
    bw_status status = bw_seams_init(j->ctx, &j->seams, j->mesh, &j->hinges, value, NULL, j->options->tolerance);
    j->report->residual_seamless_max = j->seams.seamless;
    j->report->residual_alignment_max = j->seams.alignment;
    if (status) return status;
    status = bw_cutset_init(j->ctx, &j->cut, j->mesh, &j->hinges, &j->seams, value);
    j->report->cut_facets = j->cut.cut_facets;
    j->report->cut_edges = j->cut.cut_edges;
    j->report->branches = j->cut.branches;
    j->report->nodes = j->cut.nodes;
    j->report->cut_sheets = j->cut.cut_sheets;
    j->report->align_sheets = j->cut.align_sheets;
    return status;
}

/* Translates every chart so that on the average its values stay where the input has them: errors of the
 * translations found between charts do not add up. Translations are free. */
static bw_status settle_charts(job *j) {
    double(*sum)[3] = bw_alloc(j->ctx, j->cut.charts, sizeof *sum);
    int64_t *count = bw_alloc(j->ctx, j->cut.charts, sizeof *count);
    for (size_t t = 0; sum && count && t < j->mesh->tet_count; t++, count[j->cut.chart[t - 1]] += 4)
        for (int i = 0; i < 12; i++)
            sum[j->cut.chart[t]][i % 3] +=
                (double)(j->map->value[t][i / 3][i % 3] - j->rounded[t][i / 3][i % 3]);
    for (size_t t = 0; sum && count && t < j->mesh->tet_count; t++)
        for (int i = 0; i < 12; i++)
            j->map->value[t][i / 3][i % 3] -=
                llround(sum[j->cut.chart[t]][i % 3] / (double)count[j->cut.chart[t]]);
    bw_free(j->ctx, sum);
    bw_free(j->ctx, count);
    return j->ctx->error.status;
}

/* Solves the core system and replaces all values by the ones that follow. */
static bw_status make_exact(job *j) {
    bw_context *ctx = j->ctx;
    j->rounded = bw_alloc(ctx, j->mesh->tet_count, sizeof *j->rounded);
    if (!j->rounded) return ctx->error.status;
    memcpy(j->rounded, j->map->value, j->mesh->tet_count * sizeof *j->rounded);
    bw_sector_input in = {j->mesh, &j->hinges, &j->seams, &j->cut, (const int64_t(*)[4][3])j->rounded};
    if (bw_sectors_system(ctx, &in, &j->system)) return ctx->error.status;
    bw_equations equations = {j->system.row_count, j->system.column_count, j->system.start, j->system.column,
                              j->system.coefficient};
    bw_echelon_report solved = {0};
    bw_progress(ctx, 0.4);
    j->solution = bw_alloc(ctx, equations.columns, sizeof *j->solution);
    if (!j->solution) return ctx->error.status;
    int64_t coarsest = (int64_t)1 << 24; /* 2^-20 of the largest parameter */
    if (bw_echelon_solve(ctx, &equations, j->system.estimate, coarsest, 2 * BW_COMBED_MAX, j->solution,
                         &solved))
        return ctx->error.status;
    j->report->system_rows = equations.rows;
    j->report->system_columns = equations.columns;
    j->report->system_rank = solved.rank;
    j->report->free_variables = equations.columns - solved.rank;
    j->report->divisor_max = solved.divisor;
    bw_progress(ctx, 0.6);
    if (bw_sectors_place(ctx, &in, j->solution, j->map->value)) return ctx->error.status;
    return settle_charts(j);
}

static void count_singular(job *j) {
    for (size_t e = 0; e < j->mesh->edge_count; e++) {
        if (!(j->map->edge_flags[e] & BW_EDGE_SINGULAR)) continue;
        if (j->map->edge_flags[e] & BW_EDGE_BOUNDARY)
            j->report->singular_boundary++;
        else
            j->report->singular_interior++;
    }
}

/* Step 5 alone: the values are on the grid already. */
static bw_status take_exact(job *j) {
    j->report->already_exact = true;
    j->report->grid_exponent = j->map->exponent;
    if (bw_tet_mesh_connect(j->ctx, j->mesh) || bw_poll(j->ctx)) return j->ctx->error.status;
    bw_progress(j->ctx, 0.8);
    if (bw_grid_map_derive(j->ctx, j->mesh, j->map)) return j->ctx->error.status;
    count_singular(j);
    bw_progress(j->ctx, 1);
    return BW_OK;
}

/* Steps 2 to 5. */
static bw_status run(job *j) {
    if (j->map->value) return take_exact(j);
    if (load_grid(j) || bw_poll(j->ctx)) return j->ctx->error.status;
    bw_progress(j->ctx, 0.1);
    if (mend(j)) return j->ctx->error.status;
    bw_progress(j->ctx, 0.2);
    if (understand(j)) return j->report->repaired ? blame_regions(j) : j->ctx->error.status;
    if (check_turns(j) || bw_poll(j->ctx)) return j->ctx->error.status;
    j->report->already_exact = j->seams.exact && !j->report->repaired;
    if (!j->seams.exact && (make_exact(j) || mend_exact(j))) return j->ctx->error.status;
    j->report->displacement_max = displacement(j);
    bw_progress(j->ctx, 0.8);
    if (bw_grid_map_derive(j->ctx, j->mesh, j->map) || compare_turns(j)) return j->ctx->error.status;
    count_singular(j);
    bw_free(j->ctx, j->mesh->parameter);
    j->mesh->parameter = NULL;
    bw_progress(j->ctx, 1);
    return BW_OK;
}

bw_status bw_sanitize(bw_context *ctx, const bw_sanitize_options *options, bw_tet_mesh *mesh, bw_grid_map *map,
                      bw_sanitize_report *report) {
    job j = {.ctx = ctx, .options = options, .mesh = mesh, .map = map, .report = report};
    *report = (bw_sanitize_report){0};
    bw_status status = run(&j);
    bw_hinges_clear(ctx, &j.hinges);
    bw_seams_clear(ctx, &j.seams);
    bw_seams_clear(ctx, &j.first_seams);
    bw_defects_clear(ctx, &j.defects);
    bw_free(ctx, j.unsure);
    bw_cutset_clear(ctx, &j.cut);
    bw_core_system_clear(ctx, &j.system);
    bw_free(ctx, j.rounded);
    bw_free(ctx, j.solution);
    return status;
}
