/* Job options: checked against the tables made from api/openapi.yaml, and the cache keys that depend on them. */
#ifndef BW_SERVER_JOBOPTIONS_H
#define BW_SERVER_JOBOPTIONS_H

#include <jansson.h>
#include <stdbool.h>

#include "bw_api.h"
#include "server/digest.h"

/* `given`: what the client sent (NULL: nothing). On success *all is a new object with every option, defaults filled in;
 * equal requests give equal objects. Else false, and `detail` names the option at fault. */
bool bw_joboptions_check(const json_t *given, json_t **all, char *detail, size_t size);
bool bw_joboptions_has(const char *name);
/* The value that `text` gives the option in a query, as bw_joboptions_check takes it (and checks it): a number, true or false, a name, lists of them
 * with commas between. NULL: there is no such option, or no memory. */
json_t *bw_joboptions_value(const char *name, const char *text);
/* A number, true or false; other texts as a string. */
json_t *bw_joboptions_scalar(const char *text);
/* How many stages a job with these (checked) options runs. */
int bw_joboptions_stages(const json_t *all);
/* The name under which the output of `stage` is cached: a hash over the hashes of the input and of its file of parameters ("":
 * none) and, for every stage up to this one, its name, version and the options it depends on. `all` is a checked object. `owner` is
 * "", or the id of the only job that the output is for, because a search was cut short in it, or the memory that jobs had for it.
 * False if out of memory. */
bool bw_cache_key(const char *input_sha256, const char *parameters_sha256, const json_t *all, int stage,
                  const char *owner, char key[BW_SHA256_TEXT]);

#endif
