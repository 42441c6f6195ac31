/* File system steps that durability is made of.
 *
 * Invariant: after a failed fsync nobody knows what is on the disk, so such a failure ends the process (the journal and
 * the order of steps make a restart safe). A full disk is the exception: it is reported and nothing has been renamed yet.
 */
#ifndef BW_SERVER_FILES_H
#define BW_SERVER_FILES_H

#include <stddef.h>
#include <stdint.h>

#include "base/status.h"

bw_status bw_sync(int fd, const char *what);         /* fdatasync; BW_E_IO only for lack of room */
bw_status bw_sync_path(const char *path);            /* fsync of a folder or file */
/* Has the kernel begin to write what a growing file has more than at the last call, once that is worth it, so that the sync
 * at the end has little left to wait for. `*begun`, 0 at first, remembers how far. Promises nothing: only bw_sync does. */
void bw_write_behind(int fd, uint64_t *begun, uint64_t written);
bw_status bw_make_dir(const char *path);             /* fine if it is there; the parent is synced if it was made */
/* Fine if it is not there. However deep the tree is and whatever rights its folders have: a worker may have made it. Needs three descriptors. */
bw_status bw_remove_tree(const char *path);
bw_status bw_rename(const char *from, const char *to); /* within a folder, which is synced; absolute */
bw_status bw_write_file(const char *path, const char *data, size_t size); /* temporary, sync, rename, sync folder */
/* The file, made if missing, with its lock; -1 if another process has it. The lock goes with the descriptor, however the process ends. */
int bw_lock_file(const char *path);

/* Closes those that are not negative. */
void bw_close_all(const int *fds, size_t count);

#endif
