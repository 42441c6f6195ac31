/* How much an attempt's folder holds; asked by the dispatcher while a worker writes in it. */
#ifndef BW_SERVER_SCRATCH_H
#define BW_SERVER_SCRATCH_H

#include <stdint.h>

/* Bytes of all files below `folder` (a descriptor), each entry counted with a page at least, so that many empty files count too; sparse
 * files by their length. Stops when more than `most` is found. More than any limit (UINT64_MAX) are: folders nested deeper than any stage makes
 * them, more than 20000 entries, and whatever the daemon can not look into (a worker may have made a folder that only it can write to). */
uint64_t bw_scratch_bytes(int folder, uint64_t most);

#endif
