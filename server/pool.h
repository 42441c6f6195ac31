/* A few threads for what may take long and must not hold up others: syncing, hashing and removing files. */
#ifndef BW_SERVER_POOL_H
#define BW_SERVER_POOL_H

#include <sys/queue.h>

#include "base/status.h"

typedef struct bw_pool bw_pool;

/* A piece of work; it belongs to the caller, who keeps it in place until fn is called. */
typedef struct bw_pool_work {
    void (*fn)(void *user);
    void *user;
    STAILQ_ENTRY(bw_pool_work) link;
} bw_pool_work;

bw_status bw_pool_open(int threads, bw_pool **pool);
void bw_pool_close(bw_pool *pool); /* after all that was posted is done; may be NULL */
/* fn(user) will be called by one of the threads, in order of posting. Never fails. */
void bw_pool_post(bw_pool *pool, bw_pool_work *work, void (*fn)(void *user), void *user);

#endif
