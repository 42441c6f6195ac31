/* The choices a user has that several layers have to name. */
#ifndef BW_BASE_KINDS_H
#define BW_BASE_KINDS_H

/* What an input is to be made of. */
typedef enum {
    BW_KIND_AUTO, /* whatever it lists */
    BW_KIND_TET,  /* tets with a map */
    BW_KIND_HEX   /* hexes */
} bw_input_kind;

typedef enum {
    BW_COMPLEX_MC,    /* motorcycle complex (MC 4) */
    BW_COMPLEX_BC,    /* base complex: walls do not stop at walls (MC 2) */
    BW_COMPLEX_SERIAL /* motorcycle complex whose walls burn one after another, those left out that can be (MC 4.2, last remark) */
} bw_complex_kind;

typedef enum {
    BW_REDUCE_NONE,          /* the complex as traced */
    BW_REDUCE_KEEP_SINGULAR, /* walls at singular arcs stay: regular-irreducible (MC+; from the base complex: part of BC-) */
    BW_REDUCE_FULL           /* irreducible (MC; from the base complex: BC-) */
} bw_reduce_mode;

typedef enum {
    BW_SELF_ADJACENT_ALLOW, /* a block may touch itself */
    BW_SELF_ADJACENT_SPLIT  /* where it does across opposite sides it is cut in two */
} bw_self_adjacent;

/* How the complexes of the base complex are explored (explore/explore.h). */
typedef enum {
    BW_EXPLORE_NONE,
    BW_EXPLORE_AUTO,           /* exact for small components, enumerate for others, swap, anneal */
    BW_EXPLORE_ENUMERATE,      /* top down with a beam (X 3.3) */
    BW_EXPLORE_SWAP,           /* from a random order (X 3.4) */
    BW_EXPLORE_ENUMERATE_SWAP, /* from the best of the enumeration */
    BW_EXPLORE_ANNEAL,         /* swap, then cuts and joins of boxes */
    BW_EXPLORE_EXACT           /* all orders, or all but those a bound excludes */
} bw_explore_method;

typedef enum {
    BW_EXPLORE_BLOCKS,        /* number of blocks (X: E_n) */
    BW_EXPLORE_BITS,          /* bits per vertex at 12 bits, entropies of the whole mesh (E_g); of hexahedra only, as the next */
    BW_EXPLORE_BITS_BY_BLOCK, /* with entropies of each block */
    BW_EXPLORE_CUBES,         /* longest side by shortest, over all blocks (X 4.5) */
    BW_EXPLORE_WEIGHTED       /* a weighted sum of these, in this order */
} bw_explore_cost;

typedef enum {
    BW_EXPLORE_EXPAND_RANDOM,  /* states of a level chosen by chance */
    BW_EXPLORE_EXPAND_CHEAPEST /* those that promise the least cost */
} bw_explore_expand;

typedef enum {
    BW_QUANTIZE_NONE,        /* no integer lengths */
    BW_QUANTIZE_POSITIVE,    /* all at least 1: valid whatever the complex */
    BW_QUANTIZE_NONNEGATIVE, /* zeros too, where that is valid (Q 5) */
    BW_QUANTIZE_ANY          /* negative ones too, in blocks of non-negative extents */
} bw_quantize_range;

/* Files that a hex mesh is written as: hexmesh.<name> (format/hex_write.h has their names). */
typedef enum {
    BW_HEX_FORMAT_MESH, /* Medit */
    BW_HEX_FORMAT_VTK,
    BW_HEX_FORMAT_VTU,
    BW_HEX_FORMAT_MSH,  /* Gmsh 4.1 */
    BW_HEX_FORMAT_OVM,  /* OpenVolumeMesh */
    BW_HEX_FORMAT_INP,  /* Abaqus */
    BW_HEX_FORMAT_CGNS,
    BW_HEX_FORMAT_BWH,  /* the compact form */
    BW_HEX_FORMAT_COUNT
} bw_hex_format;

typedef enum {
    BW_ROUTE_AUTO,      /* quality, and what answers if it fails */
    BW_ROUTE_QUALITY,   /* an integer-grid map of low distortion, or none (Q 6) */
    BW_ROUTE_GUARANTEED /* block by block, for positive lengths: no inversion by construction (MC 7.1) */
} bw_igm_route;

#endif
