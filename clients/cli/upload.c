#include "upload.h"

#include <errno.h>
#include <openssl/evp.h>
#include <stdlib.h>
#include <string.h>

#include "command.h"
#include "persist.h"

/* Below `resumable_from` bytes it takes less time to send all again than to ask how much there is. */
static const int64_t resumable_from = (int64_t)64 << 20;

typedef struct {
    cli_http *http;
    FILE *file;
    int64_t size, done; /* bytes; those that the daemon has for good */
    const char *hash;
    char blob[96];      /* path of the file's content */
    char address[96];   /* of the upload */
    cli_progress progress;
    cli_persistence persistence;
} transfer;

/* ---- in one go ---- */

static bool send_look(void *user, cli_reply *reply) {
    transfer *t = user;
    return cli_http_call(t->http, "HEAD", t->blob, NULL, reply);
}

static bool send_blob(void *user, cli_reply *reply) {
    transfer *t = user;
    cli_http_header(t->http, "Content-Type", "application/octet-stream");
    return cli_http_upload(t->http, "PUT", t->blob, t->file, 0, t->size, &t->progress, reply);
}

static int put_blob(transfer *t) {
    cli_reply reply;
    int code;
    if (!cli_persist(&t->persistence, send_blob, t, &reply, &code)) return code;
    cli_progress_clear(&t->progress);
    if (reply.status / 100 != 2) code = cli_http_refused(t->http, &reply);
    cli_reply_clear(&reply);
    return code;
}

/* ---- resumable: tus 1.0.0, creation and the core protocol ---- */

/* Takes the address of an upload from an answer. What is foreign stays out of paths. */
static bool take_address(transfer *t) {
    static const char folder[] = "/v1/uploads/";
    const char *location = cli_http_answered(t->http, "Location");
    if (!location || strncmp(location, folder, sizeof folder - 1) != 0 || !cli_job_id_valid(location + sizeof folder - 1)) return false;
    snprintf(t->address, sizeof t->address, "%s", location);
    return true;
}

static bool send_begin(void *user, cli_reply *reply) {
    transfer *t = user;
    char length[24], metadata[16 + (CLI_HASH_TEXT + 2) / 3 * 4] = "sha256 ";
    snprintf(length, sizeof length, "%lld", (long long)t->size);
    EVP_EncodeBlock((unsigned char *)metadata + 7, (const unsigned char *)t->hash, (int)strlen(t->hash));
    cli_http_header(t->http, "Tus-Resumable", "1.0.0");
    cli_http_header(t->http, "Upload-Length", length);
    cli_http_header(t->http, "Upload-Metadata", metadata);
    return cli_http_call(t->http, "POST", "/v1/uploads", NULL, reply);
}

/* Begins an upload. True with *code CLI_DONE: it has an address. True with another: it was refused for good, and that was said.
 * False: this daemon takes none (one of before, one that speaks another tus, one that has too many), and a PUT may do. One that was begun by
 * a request whose answer got lost is empty, and the daemon gives it up by its age. */
static bool begin(transfer *t, int *code) {
    cli_reply reply;
    if (!cli_persist(&t->persistence, send_begin, t, &reply, code)) return true;
    bool offered = reply.status != 404 && reply.status != 405 && reply.status != 412 && reply.status != 429;
    if (reply.status == 201) offered = take_address(t);
    else if (offered) *code = cli_http_refused(t->http, &reply);
    cli_reply_clear(&reply);
    return offered;
}

/* How far the upload is, by the last answer; -1 if that does not say it, or says what cannot be. */
static int64_t offset_told(const transfer *t) {
    const char *text = cli_http_answered(t->http, "Upload-Offset");
    char *end;
    if (!text || *text < '0' || *text > '9') return -1;
    errno = 0;
    long long offset = strtoll(text, &end, 10);
    return errno || *end || offset > t->size ? -1 : offset;
}

/* Is an answer one after which it is worth while to ask again? (409: the daemon has another offset than was thought.) */
static bool passes(long status) {
    return status == 409 || status == 423 || status == 429 || (status >= 500 && status != 507);
}

typedef enum { GOES_ON, BROKE, REFUSED } outcome;

/* One request about the upload. GOES_ON: t->done is what the daemon has. REFUSED: that was said, *code is set. */
static outcome step(transfer *t, bool send, int *code) {
    cli_reply reply;
    char offset[24];
    snprintf(offset, sizeof offset, "%lld", (long long)t->done);
    cli_http_header(t->http, "Tus-Resumable", "1.0.0");
    if (send) {
        cli_http_header(t->http, "Upload-Offset", offset);
        cli_http_header(t->http, "Content-Type", "application/offset+octet-stream");
    }
    bool answered = send ? cli_http_upload(t->http, "PATCH", t->address, t->file, t->done, t->size, &t->progress, &reply)
                         : cli_http_call(t->http, "HEAD", t->address, NULL, &reply);
    if (!answered || passes(reply.status)) {
        cli_persist_note(&t->persistence, answered ? reply.status : 0);
        cli_reply_clear(&reply);
        return BROKE;
    }
    int64_t told = reply.status / 100 == 2 ? offset_told(t) : -1;
    if (told < 0) {
        cli_progress_clear(&t->progress);
        if (!send && reply.status == 404) cli_error("%s has given the upload up", cli_http_server(t->http));
        *code = !send && reply.status == 404 ? CLI_INTERNAL : cli_http_refused(t->http, &reply);
    } else {
        if (send && told <= t->done) cli_persist_note(&t->persistence, reply.status);
        t->done = told;
    }
    cli_reply_clear(&reply);
    return told < 0 ? REFUSED : GOES_ON;
}

/* Sends what is missing. After a break it asks how far the upload is, and goes on there. */
static int send_all(transfer *t) {
    int code = CLI_DONE;
    for (bool send = true; t->done < t->size;) {
        int64_t had = t->done;
        outcome o = step(t, send, &code);
        if (o == REFUSED) return code;
        if (t->done > had) cli_persist_got_on(&t->persistence);
        if (o == GOES_ON && (!send || t->done > had)) {
            send = true;
            continue;
        }
        if (!cli_persist_again(&t->persistence)) return CLI_INTERNAL;
        send = false;
    }
    return CLI_DONE;
}

/* ---- */

static int bring(transfer *t) {
    int code = CLI_DONE;
    if (t->size < resumable_from || !begin(t, &code)) code = put_blob(t);
    else if (code == CLI_DONE) code = send_all(t);
    cli_progress_clear(&t->progress);
    return code;
}

int cli_upload(cli_http *http, const char *name, bool quiet, char hash[CLI_HASH_TEXT]) {
    cli_reply reply;
    int code = CLI_DONE;
    transfer t = {.http = http, .file = fopen(name, "rb"), .hash = hash};
    cli_persist_begin(&t.persistence, http, "upload", &t.progress);
    if (!t.file || !cli_hash_file(t.file, hash, &t.size)) {
        cli_error("%s cannot be read: %s", name, strerror(errno));
        code = CLI_INTERNAL;
        goto out;
    }
    cli_progress_open(&t.progress, quiet);
    snprintf(t.blob, sizeof t.blob, "/v1/blobs/%s", hash);
    if (!cli_persist(&t.persistence, send_look, &t, &reply, &code)) goto out;
    if (reply.status != 200) code = bring(&t); /* an answer to HEAD has no words for what is wrong; sending it tells */
    cli_reply_clear(&reply);
out:
    if (t.file) fclose(t.file);
    return code;
}
