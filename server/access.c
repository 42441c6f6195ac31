#include "server/access.h"

#include <ctype.h>
#include <openssl/crypto.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>

static const char prefix[] = "bwt_";
enum { SECRET_BYTES = 32, ID_BYTES = 6 };

struct bw_access {
    bw_queue *queue;
    pthread_rwlock_t lock; /* all below */
    bw_token *tokens;      /* sorted by hash */
    size_t count;
};

static int by_hash(const void *a, const void *b) { return strcmp(((const bw_token *)a)->hash, ((const bw_token *)b)->hash); }

bw_status bw_access_refresh(bw_access *access) {
    bw_token *tokens, *old;
    size_t count, old_count;
    bw_status status = bw_queue_tokens(access->queue, &tokens, &count);
    if (status != BW_OK) return status;
    if (count) qsort(tokens, count, sizeof *tokens, by_hash);
    pthread_rwlock_wrlock(&access->lock);
    old = access->tokens;
    old_count = access->count;
    access->tokens = tokens;
    access->count = count;
    pthread_rwlock_unlock(&access->lock);
    bw_tokens_free(old, old_count);
    return BW_OK;
}

bw_status bw_access_open(bw_queue *queue, bw_access **out) {
    bw_access *access = calloc(1, sizeof *access);
    if (!access) return BW_E_MEMORY;
    access->queue = queue;
    pthread_rwlock_init(&access->lock, NULL);
    bw_status status = bw_access_refresh(access);
    if (status == BW_OK) *out = access;
    else bw_access_close(access);
    return status;
}

void bw_access_close(bw_access *access) {
    if (!access) return;
    bw_tokens_free(access->tokens, access->count);
    pthread_rwlock_destroy(&access->lock);
    free(access);
}

bool bw_access_is_open(bw_access *access) {
    pthread_rwlock_rdlock(&access->lock);
    bool open = access->count == 0;
    pthread_rwlock_unlock(&access->lock);
    return open;
}

/* ---- who it is ---- */

static bool hash_secret(const char *secret, char hash[BW_SHA256_TEXT]) {
    bw_digest *digest = bw_digest_new();
    bool good = digest && bw_digest_add(digest, secret, strlen(secret)) && bw_digest_end(digest, hash);
    bw_digest_free(digest);
    return good;
}

static bw_recognized state_of(const bw_token *t, int64_t now) {
    if (!t) return BW_UNKNOWN;
    if (t->revoked) return BW_REVOKED;
    return t->expires && t->expires <= now ? BW_EXPIRED : BW_KNOWN;
}

bw_recognized bw_access_recognize(bw_access *access, const char *secret, int64_t now, bw_caller *caller) {
    bw_token key;
    memset(caller, 0, sizeof *caller);
    /* Where the search for the hash ends says something about hashes only, and nobody can aim at those. */
    if (strncmp(secret, prefix, sizeof prefix - 1) != 0 || !hash_secret(secret, key.hash)) return BW_UNKNOWN;
    pthread_rwlock_rdlock(&access->lock);
    const bw_token *t = access->count ? bsearch(&key, access->tokens, access->count, sizeof key, by_hash) : NULL;
    if (t && CRYPTO_memcmp(t->hash, key.hash, sizeof key.hash) != 0) t = NULL;
    bw_recognized is = state_of(t, now);
    if (is == BW_KNOWN) {
        memcpy(caller->owner, t->owner, sizeof caller->owner);
        memcpy(caller->token, t->id, sizeof caller->token);
        caller->scopes = t->scopes;
    }
    pthread_rwlock_unlock(&access->lock);
    return is;
}

bool bw_access_holds(bw_access *access, const bw_caller *caller, int64_t now) {
    bool holds = false;
    pthread_rwlock_rdlock(&access->lock);
    if (caller->open) holds = access->count == 0;
    for (size_t i = 0; *caller->token && i < access->count; i++)
        if (strcmp(access->tokens[i].id, caller->token) == 0) holds = state_of(&access->tokens[i], now) == BW_KNOWN;
    pthread_rwlock_unlock(&access->lock);
    return holds;
}

bool bw_scopes_allow(int scopes, int scope) {
    if (scope == 0 || scopes & BW_SCOPE_ADMIN || scopes & scope) return true;
    return scope == BW_SCOPE_READ && scopes & BW_SCOPE_READ_ALL;
}

/* ---- making one ---- */

int bw_scopes_parse(const char *text) {
    int scopes = 0;
    for (size_t n; *text; text += n + (text[n] == ',')) {
        int before = scopes;
        n = strcspn(text, ",");
        for (int i = 0; i < BW_SCOPE_COUNT; i++)
            if (strlen(bw_scope_names[i]) == n && strncmp(bw_scope_names[i], text, n) == 0) scopes |= 1 << i;
        if (scopes == before) return 0; /* unknown, or named twice */
    }
    return scopes;
}

bool bw_is_owner_name(const char *name) {
    static const char good[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._@+-";
    size_t n = strlen(name);
    return n > 0 && n < BW_OWNER_TEXT && strspn(name, good) == n && isalnum((unsigned char)name[0]);
}

bw_status bw_token_make(bw_token *token, int64_t now, char secret[BW_TOKEN_TEXT]) {
    unsigned char raw[SECRET_BYTES + ID_BYTES];
    char *to = secret + sizeof prefix - 1;
    if (getrandom(raw, sizeof raw, 0) != (ssize_t)sizeof raw) return BW_E_IO;
    memcpy(secret, prefix, sizeof prefix);
    for (size_t i = 0; i < SECRET_BYTES; i++, to += 2) snprintf(to, 3, "%02x", raw[i]);
    for (size_t i = 0; i < ID_BYTES; i++) snprintf(token->id + 2 * i, 3, "%02x", raw[SECRET_BYTES + i]);
    token->created = now;
    OPENSSL_cleanse(raw, sizeof raw);
    return hash_secret(secret, token->hash) ? BW_OK : BW_E_MEMORY;
}
