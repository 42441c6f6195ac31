/* Statuses: what every fallible function returns. The list is status.def; nothing else defines a code. */
#ifndef BW_BASE_STATUS_H
#define BW_BASE_STATUS_H

typedef enum {
#define BW_STATUS(name, code, class, exit, http, text) BW_##name,
#include "base/status.def"
#undef BW_STATUS
    BW_STATUS_COUNT
} bw_status;

typedef enum { BW_CLASS_NONE, BW_CLASS_INPUT, BW_CLASS_ALGORITHM, BW_CLASS_LIMIT, BW_CLASS_SYSTEM } bw_class;

const char *bw_status_code(bw_status status);  /* "not-seamless" */
const char *bw_status_text(bw_status status);  /* one sentence for people */
const char *bw_class_name(bw_class class_);    /* "input" */
bw_class bw_status_class(bw_status status);
int bw_status_exit(bw_status status);          /* exit code of the command line: 0 2 3 4 5 */
int bw_status_http(bw_status status);
bw_status bw_status_from_code(const char *code); /* BW_E_INTERNAL for an unknown word */

#endif
