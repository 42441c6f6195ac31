#include "upload.h"

#include <errno.h>
#include <openssl/evp.h>
#include <stdlib.h>
#include <string.h>

#include "command.h"

/* Below `resumable_from` bytes it takes less time to send all again than to ask how much there is. */
static const int64_t resumable_from = (int64_t)64 << 20;
enum { TRIES = 8 }; /* in a row that bring nothing */
static const double pause_first = 0.5, pause_most = 8; /* seconds; doubled from try to try, 39.5 together */
static const double asked_most = 60;                   /* a daemon that wants to be left alone for longer is not waited for */

typedef struct {
    cli_http *http;
    FILE *file;
    int64_t size, done; /* bytes; those that the daemon has for good */
    const char *hash;
    char blob[96];      /* path of the file's content */
    char address[96];   /* of the upload */
    char why[320];      /* the last try was in vain */
    double asked;       /* seconds that the daemon wanted to be left alone for then */
    int tries;
    double pause; /* after the next try that is in vain */
    cli_progress progress;
} transfer;

/* ---- trying again ---- */

static void got_on(transfer *t) { t->tries = 0, t->pause = pause_first; }

/* Keeps why a request was in vain; `status` 0: there was no answer. */
static void note_trouble(transfer *t, long status) {
    const char *asked = status ? cli_http_answered(t->http, "Retry-After") : NULL; /* as a date, which no daemon sends: as if it were not there */
    if (status) snprintf(t->why, sizeof t->why, "HTTP status %ld", status);
    else snprintf(t->why, sizeof t->why, "%s", cli_http_error(t->http));
    t->asked = asked && strspn(asked, "0123456789") == strlen(asked) ? strtod(asked, NULL) : 0;
}

/* After a request in vain: true, after a pause, if it is worth another try. False: there were enough; this was said. */
static bool try_again(transfer *t) {
    double pause = t->asked > t->pause ? t->asked : t->pause;
    if (++t->tries <= TRIES && pause <= asked_most) {
        cli_pause(pause);
        t->pause = t->pause * 2 < pause_most ? t->pause * 2 : pause_most;
        return true;
    }
    cli_progress_clear(&t->progress);
    if (pause > asked_most) cli_error("%s wants no upload for the next %.0f seconds: %s", cli_http_server(t->http), pause, t->why);
    else cli_error("the upload to %s broke off, and %d tries to go on with it failed: %s", cli_http_server(t->http), TRIES, t->why);
    return false;
}

/* Sends a request that may be sent twice until the daemon, and no proxy in its place, answers. False: it does not; *code is set, and this was said. */
static bool ask(transfer *t, bool (*send)(transfer *t, cli_reply *reply), cli_reply *reply, int *code) {
    *code = CLI_INTERNAL;
    do {
        bool answered = send(t, reply);
        long status = answered ? reply->status : 0;
        if (answered && status != 502 && status != 503 && status != 504) {
            *code = CLI_DONE;
            got_on(t);
            return true;
        }
        if (!answered && !cli_http_lost(t->http)) {
            *code = cli_http_failed(t->http);
            return false;
        }
        note_trouble(t, status);
        cli_reply_clear(reply);
    } while (try_again(t));
    return false;
}

/* ---- in one go ---- */

static bool send_look(transfer *t, cli_reply *reply) { return cli_http_call(t->http, "HEAD", t->blob, NULL, reply); }

static bool send_blob(transfer *t, cli_reply *reply) {
    cli_http_header(t->http, "Content-Type", "application/octet-stream");
    return cli_http_upload(t->http, "PUT", t->blob, t->file, 0, t->size, &t->progress, reply);
}

static int put_blob(transfer *t) {
    cli_reply reply;
    int code;
    if (!ask(t, send_blob, &reply, &code)) return code;
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

static bool send_begin(transfer *t, cli_reply *reply) {
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
    if (!ask(t, send_begin, &reply, code)) return true;
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
        note_trouble(t, answered ? reply.status : 0);
        cli_reply_clear(&reply);
        return BROKE;
    }
    int64_t told = reply.status / 100 == 2 ? offset_told(t) : -1;
    if (told < 0) {
        cli_progress_clear(&t->progress);
        if (!send && reply.status == 404) cli_error("%s has given the upload up", cli_http_server(t->http));
        *code = !send && reply.status == 404 ? CLI_INTERNAL : cli_http_refused(t->http, &reply);
    } else {
        if (send && told <= t->done) snprintf(t->why, sizeof t->why, "it took nothing"), t->asked = 0;
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
        if (t->done > had) got_on(t);
        if (o == GOES_ON && (!send || t->done > had)) {
            send = true;
            continue;
        }
        if (!try_again(t)) return CLI_INTERNAL;
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
    got_on(&t);
    if (!t.file || !cli_hash_file(t.file, hash, &t.size)) {
        cli_error("%s cannot be read: %s", name, strerror(errno));
        code = CLI_INTERNAL;
        goto out;
    }
    cli_progress_open(&t.progress, quiet);
    snprintf(t.blob, sizeof t.blob, "/v1/blobs/%s", hash);
    if (!ask(&t, send_look, &reply, &code)) goto out;
    if (reply.status == 404) code = bring(&t);
    else if (reply.status != 200) code = cli_http_refused(http, &reply);
    cli_reply_clear(&reply);
out:
    if (t.file) fclose(t.file);
    return code;
}
