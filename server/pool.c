#include "server/pool.h"

#include <pthread.h>
#include <stdbool.h>
#include <stdlib.h>

enum { THREADS_MOST = 16 };

struct bw_pool {
    pthread_mutex_t lock;
    pthread_cond_t posted;
    STAILQ_HEAD(, bw_pool_work) queue;
    bool stopping;
    int threads;
    pthread_t thread[THREADS_MOST];
};

static void *pool_main(void *user) {
    bw_pool *p = user;
    pthread_mutex_lock(&p->lock);
    for (;;) {
        bw_pool_work *work = STAILQ_FIRST(&p->queue);
        if (!work && p->stopping) break;
        if (!work) {
            pthread_cond_wait(&p->posted, &p->lock);
            continue;
        }
        STAILQ_REMOVE_HEAD(&p->queue, link);
        pthread_mutex_unlock(&p->lock);
        work->fn(work->user); /* the work may be gone now */
        pthread_mutex_lock(&p->lock);
    }
    pthread_mutex_unlock(&p->lock);
    return NULL;
}

bw_status bw_pool_open(int threads, bw_pool **out) {
    bw_pool *p = calloc(1, sizeof *p);
    if (!p) return BW_E_MEMORY;
    STAILQ_INIT(&p->queue);
    pthread_mutex_init(&p->lock, NULL);
    pthread_cond_init(&p->posted, NULL);
    while (p->threads < threads && p->threads < THREADS_MOST) {
        if (pthread_create(&p->thread[p->threads], NULL, pool_main, p) != 0) break;
        p->threads++;
    }
    if (p->threads == 0) {
        bw_pool_close(p);
        return BW_E_IO;
    }
    *out = p;
    return BW_OK;
}

void bw_pool_close(bw_pool *p) {
    if (!p) return;
    pthread_mutex_lock(&p->lock);
    p->stopping = true;
    pthread_cond_broadcast(&p->posted);
    pthread_mutex_unlock(&p->lock);
    for (int i = 0; i < p->threads; i++) pthread_join(p->thread[i], NULL);
    pthread_cond_destroy(&p->posted);
    pthread_mutex_destroy(&p->lock);
    free(p);
}

void bw_pool_post(bw_pool *p, bw_pool_work *work, void (*fn)(void *user), void *user) {
    work->fn = fn;
    work->user = user;
    pthread_mutex_lock(&p->lock);
    STAILQ_INSERT_TAIL(&p->queue, work, link);
    pthread_cond_signal(&p->posted);
    pthread_mutex_unlock(&p->lock);
}
