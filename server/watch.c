#include "server/watch.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "server/clock.h"

enum { BUCKETS = 1024 };

TAILQ_HEAD(watchers, bw_watcher);

struct bw_watch {
    pthread_mutex_t lock;
    pthread_cond_t changed; /* the earliest deadline is another one, or it stops */
    pthread_t thread;
    bool stopping;
    struct watchers buckets[BUCKETS]; /* by the job's id */
    struct watchers order;            /* all, the earliest deadline first */
};

/* FNV-1a; ids are random. */
static struct watchers *bucket_of(bw_watch *w, const char *job) {
    uint32_t hash = 2166136261u;
    while (*job) hash = (hash ^ (unsigned char)*job++) * 16777619u;
    return &w->buckets[hash % BUCKETS];
}

static void unlist(bw_watch *w, bw_watcher *one) {
    TAILQ_REMOVE(bucket_of(w, one->job), one, same);
    TAILQ_REMOVE(&w->order, one, order);
    one->added = false;
}

static void tell(bw_watch *w, bw_watcher *one, bw_watch_reason reason) {
    unlist(w, one);
    one->fn(one->user, reason); /* the watcher may be gone now */
}

static void *watch_deadlines(void *user) {
    bw_watch *w = user;
    pthread_mutex_lock(&w->lock);
    while (!w->stopping) {
        bw_watcher *first = TAILQ_FIRST(&w->order);
        if (first && first->deadline <= bw_mono_ms()) {
            tell(w, first, BW_WATCH_TIME);
        } else if (first) {
            struct timespec until = {first->deadline / 1000, first->deadline % 1000 * 1000000};
            pthread_cond_timedwait(&w->changed, &w->lock, &until);
        } else {
            pthread_cond_wait(&w->changed, &w->lock);
        }
    }
    pthread_mutex_unlock(&w->lock);
    return NULL;
}

bw_status bw_watch_open(bw_watch **out) {
    pthread_condattr_t monotonic;
    bw_watch *w = calloc(1, sizeof *w);
    if (!w) return BW_E_MEMORY;
    for (int i = 0; i < BUCKETS; i++) TAILQ_INIT(&w->buckets[i]);
    TAILQ_INIT(&w->order);
    pthread_mutex_init(&w->lock, NULL);
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_cond_init(&w->changed, &monotonic);
    pthread_condattr_destroy(&monotonic);
    if (pthread_create(&w->thread, NULL, watch_deadlines, w) != 0) {
        free(w);
        return BW_E_IO;
    }
    *out = w;
    return BW_OK;
}

void bw_watch_stop(bw_watch *w) {
    if (!w) return;
    pthread_mutex_lock(&w->lock);
    w->stopping = true;
    for (bw_watcher *one; (one = TAILQ_FIRST(&w->order));) tell(w, one, BW_WATCH_STOP);
    pthread_cond_signal(&w->changed);
    pthread_mutex_unlock(&w->lock);
}

void bw_watch_close(bw_watch *w) {
    if (!w) return;
    bw_watch_stop(w);
    pthread_join(w->thread, NULL);
    pthread_cond_destroy(&w->changed);
    pthread_mutex_destroy(&w->lock);
    free(w);
}

static void add(bw_watch *w, bw_watcher *one, const char *job, int64_t deadline, bw_watch_fn fn, void *user) {
    snprintf(one->job, sizeof one->job, "%s", job);
    one->deadline = deadline;
    one->fn = fn;
    one->user = user;
    pthread_mutex_lock(&w->lock);
    bw_watcher *earlier = TAILQ_LAST(&w->order, watchers);
    while (earlier && earlier->deadline > deadline) earlier = TAILQ_PREV(earlier, watchers, order);
    if (earlier) TAILQ_INSERT_AFTER(&w->order, earlier, one, order);
    else TAILQ_INSERT_HEAD(&w->order, one, order);
    TAILQ_INSERT_TAIL(bucket_of(w, one->job), one, same);
    one->added = true;
    if (w->stopping) tell(w, one, BW_WATCH_STOP);
    else if (!earlier) pthread_cond_signal(&w->changed);
    pthread_mutex_unlock(&w->lock);
}

void bw_watch_add(bw_watch *w, bw_watcher *one, const char *job, int64_t deadline, bw_watch_fn fn, void *user) {
    one->listens = false;
    add(w, one, job, deadline, fn, user);
}

void bw_watch_listen(bw_watch *w, bw_watcher *one, const char *job, int64_t deadline, bw_watch_fn fn, void *user) {
    one->listens = true;
    add(w, one, job, deadline, fn, user);
}

bool bw_watch_remove(bw_watch *w, bw_watcher *one) {
    pthread_mutex_lock(&w->lock);
    bool there = one->added;
    if (there) unlist(w, one);
    pthread_mutex_unlock(&w->lock);
    return there;
}

static void tell_bucket(bw_watch *w, const char *topic, bool all) {
    struct watchers *bucket = bucket_of(w, topic);
    for (bw_watcher *one = TAILQ_FIRST(bucket), *next; one; one = next) {
        next = TAILQ_NEXT(one, same);
        if ((all || one->listens) && strcmp(one->job, topic) == 0) tell(w, one, BW_WATCH_NEWS);
    }
}

void bw_watch_notify(bw_watch *w, const char *job) {
    pthread_mutex_lock(&w->lock);
    tell_bucket(w, job, true);
    if (*job) tell_bucket(w, "", true);
    pthread_mutex_unlock(&w->lock);
}

void bw_watch_murmur(bw_watch *w, const char *job) {
    pthread_mutex_lock(&w->lock);
    tell_bucket(w, job, false);
    pthread_mutex_unlock(&w->lock);
}

bool bw_watch_stopped(bw_watch *w) {
    pthread_mutex_lock(&w->lock);
    bool stopped = w->stopping;
    pthread_mutex_unlock(&w->lock);
    return stopped;
}
