/* The options of a job, the same words for `run` and `submit`. Their values are judged in one place each way:
 * by bw_options_from_json() in place, by the daemon for a submitted job. */
#ifndef BW_CLI_JOBOPTIONS_H
#define BW_CLI_JOBOPTIONS_H

#include <jansson.h>
#include <stdint.h>

#include "args.h"

typedef struct {
    const char *kind, *complex, *reduce, *self_adjacent, *until; /* NULL: not given */
    const char *effort;          /* a digit; NULL: not given */
    const char *explore, *explore_cost, *explore_expand; /* NULL: not given */
    const char *explore_weights; /* numbers between commas; NULL: not given */
    int64_t beam, seed, explore_work; /* 0: not given */
    double explore_time;         /* 0: not given */
    double tolerance;            /* 0: not given */
    int64_t max_cells, max_map_work, subdivide, max_hexes, bwh_bits; /* 0: not given */
    const char *quantize, *route, *smooth; /* NULL: not given */
    double scale, time_limit;    /* 0: not given */
    bool coarsest, fewest_hexes, rounding;
    int64_t target_hexes;        /* 0: not given */
    const char *scales;          /* numbers between commas; NULL: not given */
    const char *hex_formats;     /* names between commas, or "none"; NULL: not given */
    bool vtk, tmesh, repair;
    const char *parameters;      /* a file, not one of the options in JSON; NULL: not given */
} cli_job_options;

/* Rows of an option table; `settings` has a member cli_job_options job. */
/* clang-format off */
#define CLI_JOB_OPTIONS(settings)                                                                            \
    {"kind", 0, CLI_CHOICE, offsetof(settings, job.kind), "auto|tet|hex",                                    \
     "what the input has to be: tets with a map, hexes, or either (default auto)", 0, 0},                     \
    {"complex", 0, CLI_CHOICE, offsetof(settings, job.complex), "mc|bc|serial",                                    \
     "mc: motorcycle complex (default); bc: base complex; serial: mc with walls burnt one by one", 0, 0},     \
    {"reduce", 0, CLI_CHOICE, offsetof(settings, job.reduce), "none|keep-singular|full",                     \
     "walls taken away: none, all but those at singular arcs (default), or any", 0, 0},                      \
    {"effort", 0, CLI_CHOICE, offsetof(settings, job.effort), "0|1|2|3",                                     \
     "how long to search for fewer blocks (default 1)", 0, 0},                                               \
    {"explore", 0, CLI_CHOICE, offsetof(settings, job.explore), "none|auto|enumerate|swap|enumerate+swap|anneal|exact",                      \
     "search for the walls of the base complex to keep (default none)", 0, 0},                               \
    {"explore-cost", 0, CLI_CHOICE, offsetof(settings, job.explore_cost), "blocks|bits|bits-by-block|cubes|weighted",                      \
     "what it makes little: blocks (default), bits per vertex of hexes, blocks unlike cubes, a sum", 0, 0},  \
    {"explore-weights", 0, CLI_TEXT, offsetof(settings, job.explore_weights), "W,W,W,W",                     \
     "for weighted: of blocks, bits, bits-by-block, cubes", 0, 0},                                           \
    {"explore-expand", 0, CLI_CHOICE, offsetof(settings, job.explore_expand), "random|cheapest",              \
     "states that enumerate takes where there are more than the beam (default random)", 0, 0},               \
    {"beam", 0, CLI_INTEGER, offsetof(settings, job.beam), "N",                                              \
     "states of a level that enumerate expands (default 500)", 1, 1000000},                                  \
    {"seed", 0, CLI_INTEGER, offsetof(settings, job.seed), "N",                                              \
     "of what exploration leaves to chance (default 1)", 1, 1000000000},                                     \
    {"explore-work", 0, CLI_INTEGER, offsetof(settings, job.explore_work), "N",                              \
     "most evaluations of an exploration (default 200000)", 1, 1000000000},                                  \
    {"explore-time", 0, CLI_NUMBER, offsetof(settings, job.explore_time), "SECONDS",                         \
     "most seconds of it; then the best found counts (default 60)", 1e-9, 3600},                             \
    {"self-adjacent", 0, CLI_CHOICE, offsetof(settings, job.self_adjacent), "allow|split",                   \
     "blocks that touch themselves: allow (default), or cut them in two", 0, 0},                             \
    {"repair", 0, CLI_FLAG, offsetof(settings, job.repair), NULL,                                            \
     "re-solve the map where a few tets are inverted or degenerate, if the fix is certain", 0, 0},           \
    {"quantize", 0, CLI_CHOICE, offsetof(settings, job.quantize), "none|positive|nonnegative|any",           \
     "integer lengths of arcs: none (default), all at least 1, zeros too, negative ones too", 0, 0},         \
    {"scale", 0, CLI_NUMBER, offsetof(settings, job.scale), "S",                                             \
     "their size: S times the length in the map (default 1)", 1e-9, 1e4},                                    \
    {"coarsest", 0, CLI_FLAG, offsetof(settings, job.coarsest), NULL,                                        \
     "their size: as small as can be", 0, 0},                                                                \
    {"fewest-hexes", 0, CLI_FLAG, offsetof(settings, job.fewest_hexes), NULL,                                \
     "their size: as few hexes as there can be", 0, 0},                                                      \
    {"target-hexes", 0, CLI_INTEGER, offsetof(settings, job.target_hexes), "N",                              \
     "their size: as near to N hexes as can be", 1, 1e9},                                                    \
    {"scales", 0, CLI_TEXT, offsetof(settings, job.scales), "S,S,...",                                       \
     "more sizes, for the table of the report (0: the coarsest)", 0, 0},                                     \
    {"rounding", 0, CLI_FLAG, offsetof(settings, job.rounding), NULL,                                        \
     "also try the classical rounding, and report its conflicts", 0, 0},                                     \
    {"time-limit", 0, CLI_NUMBER, offsetof(settings, job.time_limit), "SECONDS",                             \
     "for the search of one quantization (default 10)", 1e-9, 3600},                                         \
    {"route", 0, CLI_CHOICE, offsetof(settings, job.route), "auto|quality|guaranteed",                       \
     "how hexes are made: quality, by a map of low distortion; guaranteed, block by block; auto, by what works (default)", 0, 0}, \
    {"max-map-work", 0, CLI_INTEGER, offsetof(settings, job.max_map_work), "N",                              \
     "work limit: steps of optimization for a map, else another route or size (default 400)", 1, 1000000},   \
    {"subdivide", 0, CLI_INTEGER, offsetof(settings, job.subdivide), "N",                                    \
     "cut every hex of the quantization into N x N x N (default 1)", 1, 1000},                               \
    {"max-hexes", 0, CLI_INTEGER, offsetof(settings, job.max_hexes), "N",                                    \
     "work limit: hexes of the mesh (default 10000000)", 1, 350000000},                                      \
    {"smooth", 0, CLI_CHOICE, offsetof(settings, job.smooth), "on|off",                                      \
     "move vertices of the hex mesh, on the surface, to better shapes (default on)", 0, 0},                  \
    {"hex-formats", 0, CLI_TEXT, offsetof(settings, job.hex_formats), "F,F,...",                             \
     "of the hex mesh, of hexes in with their blocks: mesh,vtk,vtu,msh,ovm,inp,cgns,bwh or none (default mesh,vtu,bwh)", 0, 0},             \
    {"bwh-bits", 0, CLI_INTEGER, offsetof(settings, job.bwh_bits), "N",                                      \
     "bits of a coordinate in hexmesh.bwh, 1..24 (default: lossless)", 1, 24},                               \
    {"vtk", 0, CLI_FLAG, offsetof(settings, job.vtk), NULL,                                                  \
     "also write the complex for VTK and ParaView (complex.vtm)", 0, 0},                                     \
    {"tmesh", 0, CLI_FLAG, offsetof(settings, job.tmesh), NULL,                                              \
     "also write a T-mesh for solid T-splines (tmesh.json, tmesh.vtu)", 0, 0},                               \
    {"until", 0, CLI_CHOICE, offsetof(settings, job.until), "sanitize|trace|build|reduce|quantize|reparametrize|extract|encode",   \
     "stop after this stage (default encode)", 0, 0},                                                        \
    {"tolerance", 0, CLI_NUMBER, offsetof(settings, job.tolerance), "X",                                     \
     "largest accepted defect of the map, relative to the edge it is on (default 1e-4)", 1e-15, 1},          \
    {"max-cells", 0, CLI_INTEGER, offsetof(settings, job.max_cells), "N",                                    \
     "work limit: cells that cuts may add to the tets of the input (default 4000000)", 1, 2e9},                 \
    {"parameters", 0, CLI_TEXT, offsetof(settings, job.parameters), "FILE",                                  \
     "parameters of a Medit mesh (12 numbers per tet)", 0, 0}
/* clang-format on */

/* The options that were given, as the JSON object that jobs carry. Owned by the caller; NULL if out of memory, or if they do not fit together: then
 * *problem says why (else it is left alone). */
json_t *cli_job_options_json(const cli_job_options *options, const char **problem);

#endif
