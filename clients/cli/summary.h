/* The short summary of a result that ends `run` and `fetch`, read from report.json. */
#ifndef BW_CLI_SUMMARY_H
#define BW_CLI_SUMMARY_H

#include <jansson.h>
#include <stdint.h>

/* Prints what the report says of input, displacement, complex and stages on standard output; members that are
 * absent (stages that did not run) are left out. */
void cli_summary_print(const json_t *report);
/* Reads folder/report.json. NULL (the error is on standard error) if there is none that can be read;
 * json_decref() it. */
json_t *cli_report_load(const char *folder);
/* Lists the regular files of `folder` that were written at or after `since` (nanoseconds of the real time
 * clock), sorted by name, with their sizes. */
void cli_files_print(const char *folder, int64_t since);
/* The time that files written from now on cannot be older than. */
int64_t cli_files_now(void);

#endif
