#include "joboptions.h"

json_t *cli_job_options_json(const cli_job_options *o) {
    json_t *json = json_object();
    if (o->complex) json_object_set_new(json, "complex", json_string(o->complex));
    if (o->reduce) json_object_set_new(json, "reduce", json_string(o->reduce));
    if (o->self_adjacent) json_object_set_new(json, "self_adjacent", json_string(o->self_adjacent));
    if (o->effort) json_object_set_new(json, "effort", json_integer(o->effort[0] - '0'));
    if (o->vtk) json_object_set_new(json, "vtk", json_string("yes"));
    if (o->repair) json_object_set_new(json, "repair", json_true());
    if (o->until) json_object_set_new(json, "until", json_string(o->until));
    if (o->tolerance > 0) json_object_set_new(json, "tolerance", json_real(o->tolerance));
    if (o->max_cells > 0) json_object_set_new(json, "max_cells", json_integer(o->max_cells));
    return json;
}
