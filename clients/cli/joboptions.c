#include "joboptions.h"

#include <stdlib.h>
#include <string.h>

/* "0,0.5,1" as a list; NULL if it is none. */
static json_t *numbers(const char *text) {
    json_t *list = json_array();
    for (char *end;; text = end + 1) {
        double value = strtod(text, &end);
        if (end == text || (*end && *end != ',') || json_array_append_new(list, json_real(value))) break;
        if (!*end) return list;
    }
    json_decref(list);
    return NULL;
}

/* "vtu,bwh" as a list of names, "none" as an empty one; which names there are is judged like every value. */
static json_t *names(const char *text) {
    json_t *list = json_array();
    if (!strcmp(text, "none")) return list;
    for (;;) {
        size_t length = strcspn(text, ",");
        json_array_append_new(list, json_stringn(text, length));
        if (!text[length]) return list;
        text += length + 1;
    }
}

static const char *conflict(const cli_job_options *o) {
    int sizes = (o->scale > 0) + o->coarsest + o->fewest_hexes + (o->target_hexes > 0);
    if (sizes > 1) return "only one of --scale, --coarsest, --fewest-hexes and --target-hexes says the size";
    if ((!o->quantize || !strcmp(o->quantize, "none")) &&
        (sizes || o->scales || o->rounding || o->time_limit > 0 || o->route || o->max_map_work > 0 || o->subdivide > 0 || o->max_hexes > 0 || o->smooth))
        return "a size, limit, route, subdivision, smoothing or rounding beside a quantization wants --quantize positive, nonnegative or any";
    bool explored = o->explore && strcmp(o->explore, "none");
    if (!explored && (o->explore_cost || o->explore_weights || o->explore_expand || o->beam > 0 || o->seed > 0 || o->explore_work > 0 || o->explore_time > 0))
        return "a cost, weights, beam, seed, work or time of exploration wants --explore";
    if ((o->explore_weights != NULL) != (o->explore_cost && !strcmp(o->explore_cost, "weighted"))) return "--explore-cost weighted and --explore-weights want each other";
    return NULL;
}

json_t *cli_job_options_json(const cli_job_options *o, const char **problem) {
    json_t *json = json_object(), *scales = o->scales ? numbers(o->scales) : NULL;
    json_t *weights = o->explore_weights ? numbers(o->explore_weights) : NULL;
    const char *wrong = conflict(o);
    if (!wrong && o->scales && !scales) wrong = "--scales wants numbers with commas between them";
    if (!wrong && o->explore_weights && !weights) wrong = "--explore-weights wants numbers with commas between them";
    if (wrong) {
        *problem = wrong;
        json_decref(json), json_decref(scales), json_decref(weights);
        return NULL;
    }
    if (o->kind) json_object_set_new(json, "kind", json_string(o->kind));
    if (o->complex) json_object_set_new(json, "complex", json_string(o->complex));
    if (o->reduce) json_object_set_new(json, "reduce", json_string(o->reduce));
    if (o->self_adjacent) json_object_set_new(json, "self_adjacent", json_string(o->self_adjacent));
    if (o->effort) json_object_set_new(json, "effort", json_integer(o->effort[0] - '0'));
    if (o->explore) json_object_set_new(json, "explore", json_string(o->explore));
    if (o->explore_cost) json_object_set_new(json, "explore_cost", json_string(o->explore_cost));
    if (weights) json_object_set_new(json, "explore_weights", weights);
    if (o->explore_expand) json_object_set_new(json, "explore_expand", json_string(o->explore_expand));
    if (o->beam > 0) json_object_set_new(json, "beam", json_integer(o->beam));
    if (o->seed > 0) json_object_set_new(json, "seed", json_integer(o->seed));
    if (o->explore_work > 0) json_object_set_new(json, "explore_work", json_integer(o->explore_work));
    if (o->explore_time > 0) json_object_set_new(json, "explore_time", json_real(o->explore_time));
    if (o->quantize) json_object_set_new(json, "quantize", json_string(o->quantize));
    if (o->scale > 0 || o->coarsest) json_object_set_new(json, "scale", json_real(o->scale));
    if (o->fewest_hexes) json_object_set_new(json, "fewest_hexes", json_true());
    if (o->target_hexes > 0) json_object_set_new(json, "target_hexes", json_integer(o->target_hexes));
    if (scales) json_object_set_new(json, "scales", scales);
    if (o->rounding) json_object_set_new(json, "rounding", json_true());
    if (o->time_limit > 0) json_object_set_new(json, "time_limit", json_real(o->time_limit));
    if (o->route) json_object_set_new(json, "route", json_string(o->route));
    if (o->max_map_work > 0) json_object_set_new(json, "max_map_work", json_integer(o->max_map_work));
    if (o->subdivide > 0) json_object_set_new(json, "subdivide", json_integer(o->subdivide));
    if (o->max_hexes > 0) json_object_set_new(json, "max_hexes", json_integer(o->max_hexes));
    if (o->smooth) json_object_set_new(json, "smooth", json_string(o->smooth));
    if (o->hex_formats) json_object_set_new(json, "hex_formats", names(o->hex_formats));
    if (o->bwh_bits > 0) json_object_set_new(json, "bwh_bits", json_integer(o->bwh_bits));
    if (o->vtk) json_object_set_new(json, "vtk", json_string("yes"));
    if (o->tmesh) json_object_set_new(json, "tmesh", json_string("yes"));
    if (o->repair) json_object_set_new(json, "repair", json_true());
    if (o->until) json_object_set_new(json, "until", json_string(o->until));
    if (o->tolerance > 0) json_object_set_new(json, "tolerance", json_real(o->tolerance));
    if (o->max_cells > 0) json_object_set_new(json, "max_cells", json_integer(o->max_cells));
    return json;
}
