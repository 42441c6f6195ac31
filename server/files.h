/* File system steps that durability is made of.
 *
 * Invariant: after a failed fsync nobody knows what is on the disk, so such a failure ends the process (the journal and
 * the order of steps make a restart safe). A full disk is the exception: it is reported and nothing has been renamed yet.
 */
#ifndef BW_SERVER_FILES_H
#define BW_SERVER_FILES_H

#include <stddef.h>

#include "base/status.h"

bw_status bw_sync(int fd, const char *what);         /* fdatasync; BW_E_IO only for lack of room */
bw_status bw_sync_path(const char *path);            /* fsync of a folder or file */
bw_status bw_make_dir(const char *path);             /* fine if it is there; the parent is synced if it was made */
bw_status bw_remove_tree(const char *path);          /* fine if it is not there */
bw_status bw_write_file(const char *path, const char *data, size_t size); /* temporary, sync, rename, sync folder */
/* The file, made if missing, with its lock; -1 if another process has it. The lock goes with the descriptor, however the process ends. */
int bw_lock_file(const char *path);

/* Closes those that are not negative. */
void bw_close_all(const int *fds, size_t count);

#endif
