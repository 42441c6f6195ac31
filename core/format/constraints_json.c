#include "format/constraints_json.h"

#include "format/output.h"

typedef struct {
    bw_output out;
    const bw_cells *cells;
    const bw_complex *complex;
} writer;

static void put_place(writer *w, const char *key, bw_node node, bw_tet tet) {
    const bw_tet_mesh *m = w->cells->mesh;
    double weight[4];
    bw_differential_weights(w->cells, w->complex, node, tet, weight);
    bw_put_text(&w->out, "\"");
    bw_put_text(&w->out, key);
    bw_put_text(&w->out, "\": {\"node\": ");
    bw_put_integer(&w->out, node);
    for (int pass = 0; pass < 2; pass++) {
        bool first = true;
        bw_put_text(&w->out, pass ? "], \"weights\": [" : ", \"vertices\": [");
        for (int c = 0; c < 4; c++) {
            if (weight[c] == 0) continue;
            if (!first) bw_put_text(&w->out, ", ");
            if (pass) bw_put_number(&w->out, weight[c]);
            else bw_put_integer(&w->out, m->tet[tet][c]);
            first = false;
        }
    }
    bw_put_text(&w->out, "]}");
}

static void put_difference(writer *w, const bw_differential *d, size_t i) {
    const bw_difference *n = &d->difference[i];
    const bw_tet *tet = d->tet + d->tet_begin[i];
    size_t tets = d->tet_begin[i + 1] - d->tet_begin[i];
    bw_put_text(&w->out, "{");
    put_place(w, "from", n->from, tet[0]);
    bw_put_text(&w->out, ", ");
    put_place(w, "to", n->to, tet[tets - 1]);
    bw_put_text(&w->out, ", \"vector\": [");
    for (int k = 0; k < 3; k++) {
        if (k) bw_put_text(&w->out, ", ");
        bw_put_integer(&w->out, n->vector[k]);
    }
    bw_put_text(&w->out, "], \"axes\": [");
    bool first = true;
    for (int k = 0; k < 3; k++) {
        if (!(n->axes >> k & 1)) continue;
        if (!first) bw_put_text(&w->out, ", ");
        bw_put_integer(&w->out, k);
        first = false;
    }
    bw_put_text(&w->out, "], \"tets\": [");
    for (size_t k = 0; k < tets; k++) {
        if (k) bw_put_text(&w->out, ", ");
        bw_put_integer(&w->out, w->cells->mesh->tet_id[tet[k]]);
    }
    bw_put_text(&w->out, "]}");
}

bw_status bw_constraints_write(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, const bw_differential *d, const char *path,
                               uint64_t *bytes) {
    writer w = {.cells = cells, .complex = complex};
    bw_status status = bw_output_open(ctx, &w.out, path);
    bw_put_text(&w.out, "{\n\"format\": \"blockwright-constraints\",\n\"version\": ");
    bw_put_integer(&w.out, BW_CONSTRAINTS_VERSION);
    bw_put_text(&w.out, ",\n\"roots\": [\n");
    for (size_t i = 0; i < d->root_count; i++) {
        bw_put_text(&w.out, i ? ",\n{" : "{");
        put_place(&w, "place", d->root[i], d->root_tet[i]);
        bw_put_text(&w.out, ", \"tet\": ");
        bw_put_integer(&w.out, cells->mesh->tet_id[d->root_tet[i]]);
        bw_put_text(&w.out, "}");
    }
    bw_put_text(&w.out, "\n],\n\"differences\": [\n");
    for (size_t i = 0; i < d->count; i++) {
        if (i) bw_put_text(&w.out, ",\n");
        put_difference(&w, d, i);
        if (i % 1024 == 0 && status == BW_OK) status = bw_poll(ctx);
    }
    bw_put_text(&w.out, "\n]\n}\n");
    bw_status closed = bw_output_close(&w.out, bytes);
    return status == BW_OK ? closed : status;
}
