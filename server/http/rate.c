#include "server/http/rate.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/queue.h>

#include "server/access.h"

enum { LISTS = 256 };

typedef struct asker {
    LIST_ENTRY(asker) link;
    int64_t due; /* when the next one is due */
    char owner[BW_OWNER_TEXT];
} asker;

LIST_HEAD(asker_list, asker);

struct bw_rates {
    pthread_mutex_t lock;
    size_t known;
    struct asker_list lists[LISTS]; /* by hash of the owner's name */
};

bw_rates *bw_rates_open(void) {
    bw_rates *r = calloc(1, sizeof *r);
    if (r) pthread_mutex_init(&r->lock, NULL);
    return r;
}

void bw_rates_close(bw_rates *r) {
    if (!r) return;
    for (int i = 0; i < LISTS; i++)
        for (asker *a; (a = LIST_FIRST(&r->lists[i]));) {
            LIST_REMOVE(a, link);
            free(a);
        }
    pthread_mutex_destroy(&r->lock);
    free(r);
}

static struct asker_list *list_of(bw_rates *r, const char *owner) {
    uint32_t hash = 2166136261u;
    for (; *owner; owner++) hash = (hash ^ (unsigned char)*owner) * 16777619u;
    return &r->lists[(hash ^ hash >> 16) % LISTS];
}

/* The owner's, or a new one; all others of its list that nothing is to be known of any more go. NULL: no memory. */
static asker *find(bw_rates *r, const char *owner, int64_t now) {
    struct asker_list *list = list_of(r, owner);
    asker *found = NULL, *next;
    for (asker *a = LIST_FIRST(list); a; a = next) {
        next = LIST_NEXT(a, link);
        if (strcmp(a->owner, owner) == 0) {
            found = a;
        } else if (a->due <= now) {
            LIST_REMOVE(a, link);
            free(a);
            r->known--;
        }
    }
    if (found || !(found = calloc(1, sizeof *found))) return found;
    strncpy(found->owner, owner, sizeof found->owner - 1);
    LIST_INSERT_HEAD(list, found, link);
    r->known++;
    return found;
}

int64_t bw_rates_ask(bw_rates *r, const char *owner, int per_second, int64_t now) {
    const int64_t each = 1000000 / per_second, most = BW_RATE_BURST_SECONDS * (int64_t)1000000;
    int64_t wait = 0;
    pthread_mutex_lock(&r->lock);
    asker *a = find(r, owner, now);
    if (a) {
        int64_t due = (a->due > now ? a->due : now) + each;
        if (due - now > most) wait = due - now - most;
        else a->due = due;
    }
    pthread_mutex_unlock(&r->lock);
    return wait;
}

size_t bw_rates_known(bw_rates *r) {
    pthread_mutex_lock(&r->lock);
    size_t known = r->known;
    pthread_mutex_unlock(&r->lock);
    return known;
}
