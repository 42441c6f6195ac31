/* The cut: a surface of facets that leaves the mesh in pieces on which one combed chart serves all tets
 * (MC 6.2.1).
 *
 * Charts are combed along a spanning tree of the dual graph: with the intended rotations composed along the
 * tree, the transition of every tree facet is the identity, and the facets outside the tree are a cut. It is
 * shrunk without looking at any number: around a regular interior hinge transitions compose to the identity,
 * so if a single facet there is still cut, its transition, translation included, must be the identity, and it
 * is a cut facet no longer.
 *
 * What is left falls into
 *   cut sheets    cut facets joined across regular interior hinges with exactly two of them; one rotation and
 * one unknown translation each. Crossing a sheet forward means u -> rotation(u) + translation. align sheets
 * aligned facets joined across hinges without cut facets, if the same axis is constant on both: they share
 * the hinge's vertices and their chart, hence the constant. Sheets only serve to have few unknowns. Where one
 * could be larger, or is folded onto itself with the opposite direction, the equations at its vertices
 * (sectors.h) say so, and nothing relies on orientability or on the number of boundary loops.
 */
#ifndef BW_MESH_CUTSET_H
#define BW_MESH_CUTSET_H

#include "mesh/seams.h"

#define BW_COMBED_MAX ((int64_t)1 << 58)

typedef struct {
    bw_rotation *comb;   /* [tet] from its chart to the combed one */
    int64_t (*shift)[3]; /* [tet] combed = comb(value) + shift, grid units; any value is right, this one fits
                            the input */
    int32_t *chart;      /* [tet] tets whose charts the input meant to be one have one number */
    int8_t *side; /* [facet] 0: not cut; +1: forward leads from facet_tet[0] to facet_tet[1]; -1: back */
    int32_t *cut_sheet;    /* [facet] BW_NONE if not cut */
    int32_t *align_sheet;  /* [facet] BW_NONE if not aligned */
    int8_t *align_axis;    /* [facet] constant axis in the combed chart of facet_tet[0]; -1 if not aligned */
    bw_rotation *rotation; /* [cut sheet] between combed charts, forward */
    int32_t *cut_count;    /* [hinge] number of cut facets */
    size_t charts, cut_facets, cut_sheets, align_sheets;
    size_t cut_edges, branches, nodes; /* as defined in MC 6.2.1; for the report only */
} bw_cutset;

/* BW_E_RANGE if combed coordinates exceed BW_COMBED_MAX. O(tets). */
bw_status bw_cutset_init(bw_context *ctx, bw_cutset *cut, const bw_tet_mesh *mesh, const bw_hinges *hinges,
                         const bw_seams *seams, const int64_t (*value)[4][3]);
void bw_cutset_clear(bw_context *ctx, bw_cutset *cut);

/* Combed value of a corner. */
static inline void bw_cutset_combed(const bw_cutset *cut, bw_tet tet, const int64_t value[3],
                                    int64_t out[3]) {
    bw_rotate(cut->comb[tet], value, out);
    for (int k = 0; k < 3; k++) out[k] += cut->shift[tet][k];
}

#endif
