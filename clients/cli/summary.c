#include "summary.h"

#include <dirent.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>

#include "terminal.h"

typedef struct {
    const char *key, *one, *many; /* member of the report; words behind 1 and behind other numbers */
} counted;

static void count_line(const json_t *object, const counted *counts, size_t n) {
    const char *separator = "";
    for (size_t i = 0; i < n; i++) {
        const json_t *value = json_object_get(object, counts[i].key);
        if (!json_is_integer(value)) continue;
        printf("%s%" JSON_INTEGER_FORMAT " %s", separator, json_integer_value(value), json_integer_value(value) == 1 ? counts[i].one : counts[i].many);
        separator = ", ";
    }
    putchar('\n');
}

static void repair(const json_t *repaired) {
    static const counted counts[] = {{"regions", "region", "regions"},
                                     {"tets", "inverted or degenerate tet", "inverted or degenerate tets"},
                                     {"vertices_moved", "vertex moved", "vertices moved"}};
    if (!json_is_object(repaired)) return;
    printf("%-15s ", "repaired");
    count_line(repaired, counts, sizeof counts / sizeof *counts);
}

/* How the reduced complex came about. `kind` is that of the raw one. */
static void reduction(const json_t *reduced, const char *kind) {
    const char *mode = json_string_value(json_object_get(reduced, "mode"));
    const char *from = json_string_value(json_object_get(reduced, "from"));
    const json_t *first = json_object_get(reduced, "blocks_farthest_first");
    char text[32];
    if (!mode) return;
    printf("%-15s %s", "reduction", cli_safe(text, sizeof text, mode));
    if (from && kind && strcmp(from, kind)) printf(", from the base complex");
    printf(", effort %" JSON_INTEGER_FORMAT, json_integer_value(json_object_get(reduced, "effort")));
    if (json_is_integer(first))
        printf(" (farthest first: %" JSON_INTEGER_FORMAT " block%s)", json_integer_value(first), json_integer_value(first) == 1 ? "" : "s");
    putchar('\n');
}

/* One line per state of the complex; "raw" is as traced, "reduced" after walls were taken away. */
static void complexes(const json_t *all) {
    static const counted counts[] = {{"blocks", "block", "blocks"}, {"patches", "patch", "patches"}, {"arcs", "arc", "arcs"},
                                     {"t_arcs", "T-arc", "T-arcs"}, {"nodes", "node", "nodes"},      {"torus_splits", "torus split", "tori split"}};
    const char *kind = json_string_value(json_object_get(all, "kind"));
    const char *name;
    json_t *one;
    json_object_foreach((json_t *)all, name, one) {
        if (!json_is_object(one)) continue;
        char label[64], text[64];
        snprintf(label, sizeof label, "%s, %s", kind ? kind : "complex", name);
        printf("%-15s ", cli_safe(text, sizeof text, label));
        count_line(one, counts, sizeof counts / sizeof *counts);
    }
    reduction(json_object_get(all, "reduced"), kind);
}

static double number(const json_t *object, const char *key) { return json_number_value(json_object_get(object, key)); }

/* What exploration of the base complex came to. */
static void exploration(const json_t *e) {
    const char *method = json_string_value(json_object_get(e, "method")), *cost = json_string_value(json_object_get(e, "cost"));
    const char *cut = json_string_value(json_object_get(e, "cut"));
    char text[32], name[32];
    if (!method || !cost) return;
    printf("%-15s %s for %s: %.6g, by inserting sheets %.6g%s, at first %.6g; %.0f evaluations, the last gain at %.0f, %.3f s", "exploration", cli_safe(text, sizeof text, method),
           cli_safe(name, sizeof name, cost), number(e, "best"), number(e, "serial"), json_is_true(json_object_get(e, "proven")) ? " (proven)" : "", number(e, "start"),
           number(e, "evaluations"), number(e, "improved_at"), number(e, "seconds"));
    if (cut && strcmp(cut, "no")) printf(", cut: %s", cli_safe(text, sizeof text, cut));
    putchar('\n');
}

static void range_line(const char *label, const json_t *range, const char *what) {
    if (!json_is_object(range)) return;
    printf("%-15s %.4g to %.4g, median %.4g (%s)\n", label, json_number_value(json_object_get(range, "min")),
           json_number_value(json_object_get(range, "max")),
           json_number_value(json_object_get(range, "median")), what);
}

static void size_line(const char *label, const json_t *row) {
    const char *status = json_string_value(json_object_get(row, "status"));
    char text[32], distortion[24] = "-"; /* relative to the scale */
    if (number(row, "scale") > 0) snprintf(distortion, sizeof distortion, "%.3f", number(row, "distortion"));
    printf("%-15s %8.4g %10.0f %12.4f %12.4f %7.0f %9.0f %11s  %s\n", label, number(row, "scale"), number(row, "hexes"),
           number(row, "objective"), number(row, "bound"), number(row, "zero_arcs"), number(row, "negative_arcs"), distortion,
           cli_safe(text, sizeof text, status ? status : "?"));
}

/* What was found, and the table over sizes. */
static void quantization(const json_t *q) {
    const char *range = json_string_value(json_object_get(q, "range"));
    char text[32];
    if (!range) return;
    printf("%-15s %s lengths, %.0f free integers, %.3f s", "quantization", cli_safe(text, sizeof text, range),
           number(q, "free_integers"), number(q, "seconds"));
    if (number(q, "gap") > 0) printf(", may be better by %.3g %%", 100 * number(q, "gap"));
    if (number(q, "target_hexes") > 0)
        printf(", %s %.0f hexes", json_is_true(json_object_get(q, "target_met")) ? "near" : "as near as found to", number(q, "target_hexes"));
    const char *goal = json_string_value(json_object_get(q, "goal"));
    if (goal && !strcmp(goal, "hexes")) printf(", as few hexes as %s", number(q, "gap") > 0 ? "found" : "there can be");
    const char *fallback = json_string_value(json_object_get(q, "fallback"));
    if (fallback && strcmp(fallback, "none")) printf(", given up for %s ones by the check", cli_safe(text, sizeof text, fallback));
    printf("\n%-15s %8s %10s %12s %12s %7s %9s %11s  %s\n", "", "scale", "hexes", "objective", "bound", "zeros", "negatives", "distortion", "status");
    size_t index;
    json_t *row;
    json_array_foreach(json_object_get(q, "sweep"), index, row) size_line("sweep", row);
    size_line("lengths", q);
    const json_t *r = json_object_get(q, "rounding");
    if (!json_is_object(r)) return;
    printf("%-15s ", "rounding");
    if (json_is_true(json_object_get(r, "valid"))) printf("%.0f hexes", number(r, "hexes"));
    else printf("%.0f conflicts", number(r, "conflicts"));
    printf(" at scale %.4g", number(r, "scale"));
    if (json_is_true(json_object_get(r, "coarsest_valid")))
        printf("; its coarsest: scale %.4g, %.0f hexes", number(r, "coarsest_scale"), number(r, "coarsest_hexes"));
    printf("\n");
}

/* Where the hexes come from, and what was not as asked for. */
static void hexes_from(const json_t *map, const json_t *extract) {
    const char *route = json_string_value(json_object_get(map, "route")), *reason = json_string_value(json_object_get(map, "reason"));
    char text[400];
    if (!route) return;
    printf("%-15s ", "map");
    if (strcmp(route, "quality")) printf("none; hexes block by block");
    else printf("of the tets, distortion %.3f in the mean, %.3g at most", number(map, "distortion_mean"), number(map, "distortion_max"));
    if (reason && *reason) printf(" (%s)", cli_safe(text, sizeof text, reason));
    if (number(extract, "subdivide") > number(extract, "subdivide_asked"))
        printf("; each hex in %.0f along an edge, or faces would coincide", number(extract, "subdivide"));
    printf("\n");
}

/* Shapes of the hex mesh, before and after smoothing, and how far it is from the input. */
static void hex_quality(const json_t *q) {
    if (!json_is_object(q)) return;
    const json_t *shape = json_object_get(q, "scaled_jacobian"), *smoothing = json_object_get(q, "smoothing");
    printf("%-15s %.0f, scaled Jacobian %.3f at least, %.3f in the mean", "hexes", number(q, "hexes"), number(shape, "min"), number(shape, "mean"));
    if (number(q, "nonpositive") > 0) printf("; %.0f NOT POSITIVE", number(q, "nonpositive"));
    printf("\n%-15s %.3g off the input's surface at most (%.2g %% of its size), volume %+.2f %%\n", "geometry", number(q, "hausdorff"),
           100 * number(q, "hausdorff_relative"), 100 * number(q, "volume_difference"));
    if (!json_is_object(smoothing)) return;
    printf("%-15s scaled Jacobian was %.3f at least, %.3f in the mean", "smoothing", number(smoothing, "min_before"), number(smoothing, "mean_before"));
    if (number(smoothing, "nonpositive_before") > 0) printf("; %.0f not positive", number(smoothing, "nonpositive_before"));
    if (number(smoothing, "vertices_off_surface") > 0)
        printf("; %.0f vertices left the surface, by %.3g at most", number(smoothing, "vertices_off_surface"), number(smoothing, "off_surface_max"));
    printf("\n");
}

/* What the hex mesh takes in the compact form, beside what the paper's model of such a coder estimates. */
static void compression(const json_t *c) {
    if (!json_is_object(c)) return;
    const json_t *w = json_object_get(c, "written");
    printf("%-15s E_g %.2f bits per vertex at %.0f bits (entropies by block: %.2f); blocks %.3g times as long as wide in the mean", "compression", number(c, "estimate_pooled"),
           number(c, "bits"), number(c, "estimate_blocks"), number(c, "cube_ratio") / fmax(number(c, "blocks"), 1));
    if (json_is_object(w)) {
        printf("\n%-15s %.2f bits per vertex, %.2f of them coordinates, ", "hexmesh.bwh", number(w, "bits_per_vertex"), number(w, "bits_per_vertex_places"));
        if (number(w, "bits") > 0) printf("%.0f bits each, off by %.3g at most", number(w, "bits"), number(w, "error_max"));
        else printf("lossless");
    }
    printf("\n");
}

static void stages(const json_t *list) {
    size_t index;
    json_t *stage;
    if (json_array_size(list)) printf("\n%-15s %10s %12s\n", "stage", "seconds", "peak memory");
    json_array_foreach(list, index, stage) {
        const char *name = json_string_value(json_object_get(stage, "name"));
        const json_t *peak = json_object_get(stage, "peak_bytes");
        char size[24] = "", text[32];
        if (json_is_integer(peak)) cli_bytes(size, (uint64_t)json_integer_value(peak));
        printf("%-15s %10.3f %12s\n", cli_safe(text, sizeof text, name ? name : "?"),
               json_number_value(json_object_get(stage, "seconds")), size);
    }
}

static void input_line(const json_t *input) {
    static const counted of_tets[] = {{"vertices", "vertex", "vertices"}, {"tets", "tet", "tets"}, {"singular_edges", "singular edge", "singular edges"}};
    static const counted of_hexes[] = {{"hexes", "hex", "hexes"},
                                       {"tets", "tet made of them", "tets made of them"},
                                       {"singular_edges_interior", "singular edge inside", "singular edges inside"},
                                       {"singular_edges_boundary", "on the boundary", "on the boundary"}};
    bool hexes = json_integer_value(json_object_get(input, "hexes")) > 0;
    printf("%-15s ", "input");
    if (hexes) count_line(input, of_hexes, sizeof of_hexes / sizeof *of_hexes);
    else count_line(input, of_tets, sizeof of_tets / sizeof *of_tets);
}

void cli_summary_print(const json_t *report) {
    const json_t *input = json_object_get(report, "input");
    const json_t *displacement = json_object_get(json_object_get(report, "sanitize"), "displacement_max");
    if (json_is_object(input)) input_line(input);
    if (json_is_number(displacement))
        printf("%-15s parameters moved by at most %.3g\n", "sanitize", json_number_value(displacement));
    repair(json_object_get(json_object_get(report, "sanitize"), "repaired"));
    complexes(json_object_get(report, "complex"));
    exploration(json_object_get(report, "exploration"));
    quantization(json_object_get(report, "quantization"));
    hexes_from(json_object_get(report, "reparametrize"), json_object_get(report, "extract"));
    hex_quality(json_object_get(report, "hex_quality"));
    compression(json_object_get(report, "compression"));
    const json_t *quality = json_object_get(report, "quality");
    range_line("block extent", json_object_get(quality, "block_extent"), "in the map");
    range_line("block aspect", json_object_get(quality, "block_aspect"), "longest over shortest extent");
    range_line("block volume", json_object_get(quality, "block_volume"), "in space");
    stages(json_object_get(report, "stages"));
}

json_t *cli_report_load(const char *folder) {
    char path[4096];
    json_error_t error;
    snprintf(path, sizeof path, "%s/report.json", folder);
    json_t *report = json_load_file(path, 0, &error);
    if (!report) cli_error("%s cannot be read: %s", path, error.text);
    return report;
}

/* Files are stamped with the coarse clock, which runs a few milliseconds behind the fine one. */
int64_t cli_files_now(void) {
    struct timespec t;
    clock_gettime(CLOCK_REALTIME_COARSE, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

void cli_files_print(const char *folder, int64_t since) {
    struct dirent **entries;
    int n = scandir(folder, &entries, NULL, alphasort);
    if (n < 0) return;
    putchar('\n');
    cli_print_safe(stdout, folder);
    puts("/");
    for (int i = 0; i < n; i++) {
        char path[4096], name[300], size[24];
        struct stat s;
        snprintf(path, sizeof path, "%s/%s", folder, entries[i]->d_name);
        if (stat(path, &s) == 0 && S_ISREG(s.st_mode) &&
            (int64_t)s.st_mtim.tv_sec * 1000000000 + s.st_mtim.tv_nsec >= since)
            printf("  %-20s %10s\n", cli_safe(name, sizeof name, entries[i]->d_name), cli_bytes(size, (uint64_t)s.st_size));
        free(entries[i]);
    }
    free(entries);
}
