/* Copies of all that a daemon has, and data folders made from them.
 *
 *     FILE            the queue: jobs, attempts, owners, tokens (as hashes), what is where
 *     FILE.manifest   the files its jobs need: "blobs SHA256 BYTES" or "cache KEY BYTES", one a line
 *     FILE.files/     with files: these, as in a data folder, and the logs. Hard links where that goes: none is ever changed
 */
#ifndef BW_SERVER_BACKUP_H
#define BW_SERVER_BACKUP_H

#include "server/queue/backup.h"
#include "server/retention.h"

enum { BW_BACKUP_ERROR = 300 };

typedef struct {
    int64_t jobs, files, bytes; /* files that are needed, whether copied or not */
    int64_t missing, damaged;   /* of them: not there; no plain file or folder of such, or, at a restore, with another content
                                * than their name says: left out */
} bw_backup_report;

/* While the queue is used and written; nothing is collected meanwhile. `data`: its folder. FILE must not be there. If it fails, or is stopped
 * (queue/backup.h), nothing is left. */
bw_status bw_backup_make(const char *data, bw_queue *queue, bw_retention *retention, const char *file, bool with_files, const atomic_bool *stop,
                         bw_backup_report *report, char error[BW_BACKUP_ERROR]);
/* Fills the folder `data`, which is there and empty. */
bw_status bw_backup_restore(const char *file, const char *data, bw_backup_report *report, char error[BW_BACKUP_ERROR]);

#endif
