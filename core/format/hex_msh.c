/* Gmsh 4.1, ASCII. Entities and physical groups: a volume per block, a surface per surface of the boundary, a curve per kind of irregular edge, a point per
 * vertex held in place. All nodes are listed under one volume, in the order of the mesh; element tags go on from hexes to quads, edges and points. */
#include <math.h>

#include "hex/groups.h"
#include "format/hex_write.h"
#include "format/output.h"

enum { MSH_CURVES = 2 * 256 }; /* kinds of edges: inside or not, valence (255: and more) */
enum { MSH_POINT = 15, MSH_LINE = 1, MSH_QUAD = 3, MSH_HEX = 5 };

typedef struct {
    const bw_hex_mesh *mesh;
    const bw_hex_skin *skin;
    bw_hex_groups blocks, surfaces;
    size_t points, curves, curve_size[MSH_CURVES];
    bw_output out;
} msh_file;

/* A box, around nothing at first. */
typedef struct {
    double low[3], high[3];
} box;

static const box nothing = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};

static void extend(box *b, const bw_hex_mesh *mesh, bw_hvertex v) {
    for (int k = 0; k < 3; k++) {
        b->low[k] = fmin(b->low[k], mesh->position[v][k]);
        b->high[k] = fmax(b->high[k], mesh->position[v][k]);
    }
}

static size_t kind_of(const bw_hex_edge *edge) {
    return (edge->boundary ? 256u : 0u) + (size_t)(edge->valence < 255 ? edge->valence : 255);
}

static int64_t block_tag(const bw_hex_groups *blocks, size_t g) {
    return blocks->key[g] != BW_NONE ? blocks->key[g] + 1 : g ? blocks->key[g - 1] + 2 : 1;
}

static void put_words(bw_output *out, const int64_t *value, int count) {
    for (int i = 0; i < count; i++) {
        if (i) bw_put_bytes(out, " ", 1);
        bw_put_integer(out, value[i]);
    }
    bw_put_bytes(out, "\n", 1);
}

/* ---- names and entities -------------------------------------------------------------------------------------------- */

static void put_name(bw_output *out, int dimension, int64_t tag, const char *name, int64_t number, const char *after) {
    bw_put_integer(out, dimension), bw_put_bytes(out, " ", 1);
    bw_put_integer(out, tag), bw_put_text(out, " \"");
    bw_put_text(out, name);
    if (number >= 0) bw_put_bytes(out, " ", 1), bw_put_integer(out, number);
    bw_put_text(out, after), bw_put_text(out, "\"\n");
}

static void put_names(msh_file *f) {
    bw_output *out = &f->out;
    bw_put_text(out, "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PhysicalNames\n");
    bw_put_integer(out, (int64_t)((f->points > 0) + f->curves + f->surfaces.count + f->blocks.count)), bw_put_bytes(out, "\n", 1);
    if (f->points) put_name(out, 0, 1, "points", -1, "");
    for (size_t k = 0; k < MSH_CURVES; k++)
        if (f->curve_size[k]) put_name(out, 1, (int64_t)k + 1, k < 256 ? "inner edges of" : "boundary edges of", (int64_t)(k % 256), " hexes");
    for (size_t g = 0; g < f->surfaces.count; g++) put_name(out, 2, f->surfaces.key[g] + 1, "surface", f->surfaces.key[g], "");
    for (size_t g = 0; g < f->blocks.count; g++)
        put_name(out, 3, block_tag(&f->blocks, g), f->blocks.key[g] == BW_NONE ? "no block" : "block", f->blocks.key[g], "");
    bw_put_text(out, "$EndPhysicalNames\n");
}

/* tag, box, its one physical group, no boundary entities listed */
static void put_entity(bw_output *out, int64_t tag, const box *b) {
    bw_put_integer(out, tag);
    for (int i = 0; i < 6; i++) bw_put_bytes(out, " ", 1), bw_put_number(out, i < 3 ? b->low[i] : b->high[i - 3]);
    bw_put_text(out, " 1 ");
    bw_put_integer(out, tag), bw_put_text(out, " 0\n");
}

static void put_curve_entities(msh_file *f) {
    for (size_t k = 0; k < MSH_CURVES; k++) {
        if (!f->curve_size[k]) continue;
        box b = nothing;
        for (size_t e = 0; e < f->skin->edge_count; e++)
            for (int i = 0; i < 2 && kind_of(&f->skin->edge[e]) == k; i++) extend(&b, f->mesh, f->skin->edge[e].vertex[i]);
        put_entity(&f->out, (int64_t)k + 1, &b);
    }
}

static void put_entities(msh_file *f) {
    bw_output *out = &f->out;
    const bw_hex_mesh *mesh = f->mesh;
    bw_put_text(out, "$Entities\n");
    put_words(out, (int64_t[]){(int64_t)f->points, (int64_t)f->curves, (int64_t)f->surfaces.count, (int64_t)f->blocks.count}, 4);
    for (size_t v = 0; v < mesh->vertex_count; v++) {
        if (mesh->held[v] != BW_HELD_POINT) continue;
        bw_put_integer(out, (int64_t)v + 1);
        for (int k = 0; k < 3; k++) bw_put_bytes(out, " ", 1), bw_put_number(out, mesh->position[v][k]);
        bw_put_text(out, " 1 1\n");
    }
    put_curve_entities(f);
    for (size_t g = 0; g < f->surfaces.count; g++) {
        box b = nothing;
        for (size_t i = f->surfaces.begin[g]; i < f->surfaces.begin[g + 1]; i++)
            for (int c = 0; c < 4; c++) extend(&b, mesh, bw_hex_quad_vertex(mesh, &f->skin->quad[f->surfaces.item[i]], c));
        put_entity(out, f->surfaces.key[g] + 1, &b);
    }
    for (size_t g = 0; g < f->blocks.count; g++) {
        box b = nothing;
        for (size_t i = f->blocks.begin[g]; i < f->blocks.begin[g + 1]; i++)
            for (int c = 0; c < 8; c++) extend(&b, mesh, mesh->hex[f->blocks.item[i]][c]);
        put_entity(out, block_tag(&f->blocks, g), &b);
    }
    bw_put_text(out, "$EndEntities\n");
}

/* ---- nodes and elements -------------------------------------------------------------------------------------------- */

static void put_nodes(msh_file *f) {
    bw_output *out = &f->out;
    int64_t n = (int64_t)f->mesh->vertex_count;
    bw_put_text(out, "$Nodes\n");
    put_words(out, (int64_t[]){1, n, 1, n}, 4);
    put_words(out, (int64_t[]){3, block_tag(&f->blocks, 0), 0, n}, 4);
    for (int64_t v = 1; v <= n; v++) bw_put_integer(out, v), bw_put_bytes(out, "\n", 1);
    for (size_t v = 0; v < f->mesh->vertex_count; v++)
        for (int k = 0; k < 3; k++) bw_put_number(out, f->mesh->position[v][k]), bw_put_bytes(out, k < 2 ? " " : "\n", 1);
    bw_put_text(out, "$EndNodes\n");
}

static void put_node(bw_output *out, bw_hvertex v) {
    bw_put_bytes(out, " ", 1);
    bw_put_integer(out, (int64_t)v + 1);
}

static void put_hexes(msh_file *f) {
    for (size_t g = 0; g < f->blocks.count; g++) {
        size_t from = f->blocks.begin[g], to = f->blocks.begin[g + 1];
        put_words(&f->out, (int64_t[]){3, block_tag(&f->blocks, g), MSH_HEX, (int64_t)(to - from)}, 4);
        for (size_t i = from; i < to; i++) {
            size_t h = f->blocks.item[i];
            bw_put_integer(&f->out, (int64_t)h + 1);
            for (int c = 0; c < 8; c++) put_node(&f->out, f->mesh->hex[h][bw_hex_ring[c]]);
            bw_put_bytes(&f->out, "\n", 1);
        }
    }
}

static void put_quads(msh_file *f, int64_t tag) {
    for (size_t g = 0; g < f->surfaces.count; g++) {
        size_t from = f->surfaces.begin[g], to = f->surfaces.begin[g + 1];
        put_words(&f->out, (int64_t[]){2, f->surfaces.key[g] + 1, MSH_QUAD, (int64_t)(to - from)}, 4);
        for (size_t i = from; i < to; i++) {
            bw_put_integer(&f->out, tag + (int64_t)f->surfaces.item[i]);
            for (int c = 0; c < 4; c++) put_node(&f->out, bw_hex_quad_vertex(f->mesh, &f->skin->quad[f->surfaces.item[i]], c));
            bw_put_bytes(&f->out, "\n", 1);
        }
    }
}

static void put_edges(msh_file *f, int64_t tag) {
    for (size_t k = 0; k < MSH_CURVES; k++) {
        if (!f->curve_size[k]) continue;
        put_words(&f->out, (int64_t[]){1, (int64_t)k + 1, MSH_LINE, (int64_t)f->curve_size[k]}, 4);
        for (size_t e = 0; e < f->skin->edge_count; e++) {
            if (kind_of(&f->skin->edge[e]) != k) continue;
            bw_put_integer(&f->out, tag + (int64_t)e);
            for (int i = 0; i < 2; i++) put_node(&f->out, f->skin->edge[e].vertex[i]);
            bw_put_bytes(&f->out, "\n", 1);
        }
    }
}

static void put_elements(msh_file *f) {
    int64_t hexes = (int64_t)f->mesh->hex_count, quads = (int64_t)f->skin->quad_count, edges = (int64_t)f->skin->edge_count,
            total = hexes + quads + edges + (int64_t)f->points, tag = hexes + quads + edges;
    bw_put_text(&f->out, "$Elements\n");
    put_words(&f->out, (int64_t[]){(int64_t)(f->points + f->curves + f->surfaces.count + f->blocks.count), total, 1, total}, 4);
    for (size_t v = 0; v < f->mesh->vertex_count; v++) {
        if (f->mesh->held[v] != BW_HELD_POINT) continue;
        put_words(&f->out, (int64_t[]){0, (int64_t)v + 1, MSH_POINT, 1}, 4);
        put_words(&f->out, (int64_t[]){++tag, (int64_t)v + 1}, 2);
    }
    put_edges(f, hexes + quads + 1);
    put_quads(f, hexes + 1);
    put_hexes(f);
    bw_put_text(&f->out, "$EndElements\n");
}

static void count(msh_file *f) {
    for (size_t v = 0; v < f->mesh->vertex_count; v++) f->points += f->mesh->held[v] == BW_HELD_POINT;
    for (size_t e = 0; e < f->skin->edge_count; e++) f->curves += f->curve_size[kind_of(&f->skin->edge[e])]++ == 0;
}

bw_status bw_hex_write_msh(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_skin *skin, const char *path, uint64_t *bytes) {
    msh_file f = {.mesh = mesh, .skin = skin};
    bw_status status = bw_hex_groups_of_blocks(ctx, mesh, &f.blocks);
    if (status == BW_OK) status = bw_hex_groups_of_surfaces(ctx, skin, &f.surfaces);
    if (status == BW_OK) {
        bw_output_open(ctx, &f.out, path);
        count(&f);
        put_names(&f);
        put_entities(&f);
        put_nodes(&f);
        put_elements(&f);
        status = bw_output_close(&f.out, bytes);
    }
    bw_hex_groups_clear(ctx, &f.blocks);
    bw_hex_groups_clear(ctx, &f.surfaces);
    return status;
}
