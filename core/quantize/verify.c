#include "quantize/verify.h"

#include <stdio.h>
#include <string.h>

#include "quantize/verify_parts.h"

#define LENGTHS_MOST ((__int128)1 << 60) /* no sum of lengths overflows then */

const char *bw_fault_name(bw_fault fault) {
    static const char *const names[] = {"valid", "rectangle", "extent", "link", "region", "volume", "coincidence", "topology", "undecided"};
    return names[fault];
}

void bw_verify_fault(bw_verifier *v, bw_fault fault, const char *kind, int64_t id, int64_t other, const char *message) {
    bw_verdict *d = v->verdict;
    if (d->fault != BW_VALID) return;
    d->fault = fault, d->id = id, d->other = other;
    snprintf(d->kind, sizeof d->kind, "%s", kind);
    snprintf(d->message, sizeof d->message, "%s", message);
}

void bw_verify_close(bw_verifier *v) {
    void *blocks[] = {v->across, v->box, v->extent, v->place_begin, v->place, v->rib_begin, v->rib, v->surface,
                      v->arc_surface, v->arc_surfaces, v->arc_link, v->arc_at, v->arc_sense, v->link, v->node_critical,
                      v->node_octants, v->node_quadrants, v->slid, v->contact};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(v->ctx, blocks[i]);
    memset(v, 0, sizeof *v);
}

static bool is_positive(const bw_complex *complex, const int64_t *length) {
    for (size_t a = 0; a < complex->arc_count; a++)
        if (length[a] <= 0) return false;
    return true;
}

bw_status bw_verify_open(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, const int64_t *length, bw_verdict *out, bw_verifier *v) {
    *v = (bw_verifier){.ctx = ctx, .cells = cells, .x = complex, .length = length, .verdict = out, .positive = is_positive(complex, length)};
    *out = (bw_verdict){.fault = BW_VALID, .id = -1, .other = -1};
    __int128 all = 0;
    for (size_t a = 0; a < complex->arc_count; a++) all += length[a] < 0 ? -(__int128)length[a] : length[a];
    if (all > LENGTHS_MOST) return bw_fail(ctx, BW_E_RANGE, "the lengths of arcs are too large");
    bw_status status = bw_verify_place(v);
    if (bw_verify_going(v, status)) status = bw_verify_strata(v);
    if (bw_verify_going(v, status)) status = bw_verify_contacts(v);
    return status;
}

bw_status bw_verify(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, const int64_t *length, bw_verdict *out) {
    bw_verifier v;
    bw_status status = bw_verify_open(ctx, cells, complex, length, out, &v);
    if (bw_verify_going(&v, status)) status = bw_verify_contraction(&v);
    if (bw_verify_going(&v, status) && v.too_fine && !v.positive)
        bw_verify_fault(&v, BW_UNDECIDED, "", -1, -1, "too many planes spiral through the blocks");
    bw_verify_close(&v);
    return status;
}
