/* The files of the page, as they were when the daemon was built (embed.py). */
#ifndef BW_PAGE_H
#define BW_PAGE_H

#include <stddef.h>

typedef struct {
    const char *name, *media_type, *bytes;
    size_t size;
} bw_page_file;

extern const bw_page_file bw_page_files[]; /* the first is index.html; ends with a row without a name */

#endif
