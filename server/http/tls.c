#include "server/http/tls.h"

#include <errno.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

enum { CHAIN_MOST = 16, FILE_MOST = 1 << 20 };

/* What was read at one time. Handshakes under way may use an older one, so all stay until the end: one per reload. */
typedef struct pair {
    gnutls_pcert_st chain[CHAIN_MOST];
    unsigned length;
    gnutls_privkey_t key;
    struct pair *older;
} pair;

static const char *certificate_file, *key_file;
static pair *_Atomic current;

static bw_status fail(char error[BW_TLS_ERROR], const char *file, const char *why) {
    snprintf(error, BW_TLS_ERROR, "%.200s: %s", file, why);
    return BW_E_USAGE;
}

/* The whole of a file, with a NUL; `data` is malloc'ed. */
static bw_status read_file(const char *path, bool secret, gnutls_datum_t *data, char error[BW_TLS_ERROR]) {
    struct stat info;
    FILE *f = fopen(path, "re");
    if (!f) return fail(error, path, strerror(errno));
    bw_status status = BW_OK;
    if (fstat(fileno(f), &info) != 0 || !S_ISREG(info.st_mode) || info.st_size > FILE_MOST) status = fail(error, path, "is no file of a sensible size");
    else if (secret && info.st_mode & 0027) status = fail(error, path, "others can read or change this key; chmod 600 it");
    data->data = status == BW_OK ? calloc(1, (size_t)info.st_size + 1) : NULL;
    if (status == BW_OK && !data->data) status = fail(error, path, "out of memory");
    data->size = status == BW_OK ? (unsigned)fread(data->data, 1, (size_t)info.st_size, f) : 0;
    fclose(f);
    return status;
}

static void wipe(gnutls_datum_t *data) {
    if (data->data) explicit_bzero(data->data, data->size);
    free(data->data);
}

static void pair_free(pair *p) {
    if (!p) return;
    for (unsigned i = 0; i < p->length; i++) gnutls_pcert_deinit(&p->chain[i]);
    if (p->key) gnutls_privkey_deinit(p->key);
    free(p);
}

/* Does the key belong to the first certificate? */
static bool fits(const pair *p) {
    static const gnutls_datum_t text = {(unsigned char *)"text", 4};
    gnutls_datum_t signature = {NULL, 0};
    int type = gnutls_privkey_get_pk_algorithm(p->key, NULL);
    gnutls_sign_algorithm_t sign = type > 0 ? gnutls_pk_to_sign((gnutls_pk_algorithm_t)type, GNUTLS_DIG_SHA256) : GNUTLS_SIGN_UNKNOWN;
    bool good = type == gnutls_pubkey_get_pk_algorithm(p->chain[0].pubkey, NULL);
    if (good && sign != GNUTLS_SIGN_UNKNOWN)
        good = gnutls_privkey_sign_data(p->key, GNUTLS_DIG_SHA256, 0, &text, &signature) == 0 &&
               gnutls_pubkey_verify_data2(p->chain[0].pubkey, sign, 0, &text, &signature) == 0;
    gnutls_free(signature.data);
    return good;
}

static bw_status load(pair **out, char error[BW_TLS_ERROR]) {
    gnutls_datum_t certificate = {NULL, 0}, key = {NULL, 0};
    pair *p = calloc(1, sizeof *p);
    bw_status status = p ? read_file(certificate_file, false, &certificate, error) : fail(error, certificate_file, "out of memory");
    if (status == BW_OK) status = read_file(key_file, true, &key, error);
    unsigned length = CHAIN_MOST;
    int code = status == BW_OK ? gnutls_pcert_list_import_x509_raw(p->chain, &length, &certificate, GNUTLS_X509_FMT_PEM, 0) : 0;
    if (status == BW_OK && code < 0) status = fail(error, certificate_file, gnutls_strerror(code));
    if (status == BW_OK) p->length = length;
    if (status == BW_OK && (code = gnutls_privkey_init(&p->key)) == 0)
        code = gnutls_privkey_import_x509_raw(p->key, &key, GNUTLS_X509_FMT_PEM, NULL, 0);
    if (status == BW_OK && code < 0) status = fail(error, key_file, gnutls_strerror(code));
    if (status == BW_OK && !fits(p)) status = fail(error, key_file, "this key is not the certificate's");
    wipe(&certificate);
    wipe(&key);
    if (status == BW_OK) *out = p;
    else pair_free(p);
    return status;
}

bw_status bw_tls_reload(char error[BW_TLS_ERROR]) {
    pair *fresh;
    bw_status status = load(&fresh, error);
    if (status != BW_OK) return status;
    fresh->older = atomic_load(&current);
    atomic_store(&current, fresh);
    return BW_OK;
}

bw_status bw_tls_open(const char *certificate, const char *key, char error[BW_TLS_ERROR]) {
    certificate_file = certificate;
    key_file = key;
    return bw_tls_reload(error);
}

void bw_tls_close(void) {
    pair *p = atomic_exchange(&current, NULL), *older;
    for (; p; p = older) {
        older = p->older;
        pair_free(p);
    }
}

int bw_tls_choose(gnutls_session_t session, const gnutls_datum_t *names, int name_count, const gnutls_pk_algorithm_t *algorithms,
                  int algorithm_count, gnutls_pcert_st **chain, unsigned *length, gnutls_privkey_t *key) {
    pair *p = atomic_load(&current);
    (void)session, (void)names, (void)name_count, (void)algorithms, (void)algorithm_count;
    if (!p) return -1;
    *chain = p->chain;
    *length = p->length;
    *key = p->key;
    return 0;
}
