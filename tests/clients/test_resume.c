/* Over connections that break: a large input gets to a real daemon, also past one that is killed on the way, and its events get to the clients. */
#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/socket.h>

#include "clients/daemon.h"

enum { SIZE = 70 << 20, QUOTA = 20 << 20 };

/* The requests of an upload. */
static const char *const kinds[] = {"HEAD /v1/blobs/", "POST /v1/uploads ", "HEAD /v1/uploads/", "PATCH /v1/uploads/", "PUT /v1/blobs/", "POST /v1/jobs "};
enum { KINDS = sizeof kinds / sizeof *kinds };

/* Between client and daemon, for one connection after the other. */
typedef struct {
    int64_t quota;      /* bytes of the client after which a connection is broken; 0: none is */
    int64_t down;       /* bytes of the daemon after which a connection is broken; 0: none is */
    int cuts;           /* connections that are broken so, no more */
    pid_t victim;       /* killed when the first one is broken; 0: nobody */
    int away;           /* requests after the first break that are answered with 503, as by a proxy whose daemon is just being started */
    int refusals;       /* of them, those that are left */
    bool moody;         /* the first request of a kind is cut off unanswered, the second answered with 503 */
    int busy;           /* seconds of Retry-After in those 503; 0: none */
    bool loses_answer;  /* the first job that is asked for is made, and nobody told */
    bool before_tus;    /* the daemon does not see that an upload is asked for: it answers as one of before did */
    int asked[KINDS];   /* requests of a kind that it was moody about */
    struct timespec due; /* not before then may anything come after a 503 */
    int listener;
    char url[64];
    pid_t process;
} proxy;

static void write_all(int fd, const char *data, ssize_t size) {
    for (ssize_t n; size > 0 && (n = send(fd, data, (size_t)size, MSG_NOSIGNAL)) > 0; data += n) size -= n;
}

/* To the daemon, wherever it listens now; -1: nowhere. */
static int connect_on(void) {
    struct sockaddr_in to = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    char line[80] = "";
    FILE *f = fopen(kit_temp_path("data/address"), "r");
    if (f && !fgets(line, sizeof line, f)) *line = 0;
    if (f) fclose(f);
    if (!strchr(line, ':')) return -1;
    to.sin_port = htons((uint16_t)atoi(strrchr(line, ':') + 1));
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (connect(fd, (struct sockaddr *)&to, sizeof to) == 0) return fd;
    close(fd);
    return -1;
}

/* Carries both ways until an end closes, or the client or the daemon has sent its quota: then it is true. */
static bool carry(proxy *p, int client, int server) {
    static char buffer[65536 + 1];
    bool lost = false;
    struct pollfd ends[2] = {{client, POLLIN, 0}, {server, POLLIN, 0}};
    for (int64_t sent = 0, got = 0; poll(ends, 2, -1) > 0;) {
        for (int i = 0; i < 2; i++) {
            if (!ends[i].revents) continue;
            ssize_t n = recv(ends[i].fd, buffer, sizeof buffer - 1, 0);
            if (n <= 0) return false;
            buffer[n] = 0;
            if (i == 0 && p->before_tus && !strncmp(buffer, "POST /v1/uploads ", 17)) memcpy(buffer + 9, "nothing", 7);
            if (i == 1 && lost) return true;
            if (i == 0 && p->loses_answer && !strncmp(buffer, "POST /v1/jobs ", 14)) lost = true, p->loses_answer = false;
            bool cut = i == 1 && p->cuts && got + n >= p->down;
            if (cut) n = (ssize_t)(p->down - got);
            write_all(ends[1 - i].fd, buffer, n);
            *(i ? &got : &sent) += n;
            if (cut || (p->quota && sent >= p->quota)) return true;
        }
    }
    return false;
}

/* A letter to the file "broken". */
static void note(char what) {
    FILE *f = fopen(kit_temp_path("broken"), "a");
    fputc(what, f);
    fclose(f);
}

/* Answers with 503, and lets the client be the one that closes. */
static void be_busy(proxy *p, int client) {
    char answer[200], after[40] = "";
    if (p->busy) snprintf(after, sizeof after, "Retry-After: %d\r\n", p->busy);
    int n = snprintf(answer, sizeof answer, "HTTP/1.1 503 Service Unavailable\r\n%sContent-Length: 0\r\nConnection: close\r\n\r\n", after);
    clock_gettime(CLOCK_MONOTONIC, &p->due); /* the client counts from when it has the answer */
    p->due.tv_sec += p->busy;
    write_all(client, answer, n);
    shutdown(client, SHUT_WR);
    while (recv(client, answer, sizeof answer, 0) > 0) continue;
}

/* True if a connection was none, by its mood. A request that comes too early after a 503 is noted by a !. */
static bool is_moody(proxy *p, int client) {
    char start[32] = "";
    struct timespec now;
    size_t kind = 0;
    clock_gettime(CLOCK_MONOTONIC, &now);
    if (now.tv_sec < p->due.tv_sec || (now.tv_sec == p->due.tv_sec && now.tv_nsec < p->due.tv_nsec)) note('!');
    if (p->refusals) {
        p->refusals--;
        be_busy(p, client);
        return true;
    }
    if (!p->moody || recv(client, start, sizeof start - 1, MSG_PEEK) <= 0) return false;
    while (kind < KINDS && strncmp(start, kinds[kind], strlen(kinds[kind])) != 0) kind++;
    if (kind == KINDS || p->asked[kind] == 2) return false;
    note((char)('0' + kind));
    if (p->asked[kind]++) be_busy(p, client);
    return true;
}

/* Notes every connection it breaks by a letter in the file "broken". */
static void serve(proxy *p) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    for (;;) {
        int client = accept(p->listener, NULL, NULL), server = is_moody(p, client) ? -1 : connect_on();
        if (server >= 0 && carry(p, client, server)) {
            note('x');
            if (p->cuts) p->cuts--;
            p->refusals = p->away, p->away = 0;
            if (p->victim) kill(p->victim, SIGKILL), p->victim = 0, p->quota = 0;
        }
        if (server >= 0) close(server);
        close(client);
    }
}

static void proxy_start(proxy *p) {
    struct sockaddr_in at = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t size = sizeof at;
    kit_write_text(kit_temp_path("broken"), "");
    p->listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    assert_int_equal(bind(p->listener, (struct sockaddr *)&at, sizeof at), 0);
    assert_int_equal(listen(p->listener, 8), 0);
    assert_int_equal(getsockname(p->listener, (struct sockaddr *)&at, &size), 0);
    snprintf(p->url, sizeof p->url, "http://127.0.0.1:%d", ntohs(at.sin_port));
    fflush(NULL);
    p->process = fork();
    assert_true(p->process >= 0);
    if (p->process == 0) serve(p);
}

/* Ends it; what it has noted, to be freed. */
static char *proxy_notes(proxy *p) {
    kill(p->process, SIGKILL);
    assert_int_equal(waitpid(p->process, NULL, 0), p->process);
    close(p->listener);
    return kit_read_file(kit_temp_path("broken"), NULL);
}

/* Ends it; how many connections it has broken. */
static size_t proxy_stop(proxy *p) {
    char *notes = proxy_notes(p);
    size_t broken = strlen(notes);
    free(notes);
    return broken;
}

/* A file that no other test has uploaded. */
static const char *new_file(uint64_t stream, size_t size) {
    const char *path = kit_temp_path("file-%d", (int)stream);
    uint64_t *data = malloc(size);
    kit_random random = kit_random_start(stream);
    for (size_t i = 0; i < size / sizeof *data; i++) data[i] = kit_random_next(&random);
    kit_write_file(path, data, size);
    free(data);
    return path;
}

static const char *large_file(uint64_t stream) { return new_file(stream, SIZE); }

/* The client at work on its own; its words go to the file "words". */
static pid_t submit(const proxy *p, const char *file) {
    const char *program = kit_program("blockwright"), *words = kit_temp_path("words");
    fflush(NULL);
    pid_t client = fork();
    assert_true(client >= 0);
    if (client > 0) return client;
    int fd = open(words, O_WRONLY | O_CREAT | O_TRUNC, 0600);
    dup2(fd, 1);
    dup2(fd, 2);
    execl(program, program, "submit", file, "--until", "sanitize", "--server", p->url, (char *)NULL);
    _exit(127);
}

/* A job of the file has been created, so the daemon has it, and has found that its SHA-256 is right. */
static void expect_submitted(pid_t client) {
    int status;
    assert_int_equal(waitpid(client, &status, 0), client);
    if (!WIFEXITED(status) || WEXITSTATUS(status) != 0) {
        char *words = kit_read_file(kit_temp_path("words"), NULL);
        fail_msg("the client ended with %d: %s", status, words);
    }
}

/* How often the daemon's log has the words. */
static size_t logged(const char *words) {
    size_t n = 0;
    char *log = kit_read_file(kit_temp_path("daemon.log"), NULL);
    for (const char *at = log; (at = strstr(at, words)); at++) n++;
    free(log);
    return n;
}

static void an_upload_goes_on_after_every_break(void **state) {
    (void)state;
    proxy p = {.quota = QUOTA};
    size_t puts = logged("method=PUT");
    proxy_start(&p);
    expect_submitted(submit(&p, large_file(1)));
    assert_int_equal(proxy_stop(&p), (SIZE - 1) / QUOTA);
    assert_int_equal(logged("method=PUT"), puts);
}

static void an_upload_outlives_a_kill_of_its_daemon(void **state) {
    (void)state;
    proxy p = {.quota = QUOTA, .victim = here.process};
    const char *file = large_file(2);
    size_t puts = logged("method=PUT");
    proxy_start(&p);
    pid_t client = submit(&p, file);
    assert_int_equal(waitpid(here.process, NULL, 0), here.process);
    daemon_start(&here);
    expect_submitted(client);
    assert_int_equal(proxy_stop(&p), 1);
    assert_int_equal(logged("method=PUT"), puts);
}

static void a_daemon_that_takes_no_such_upload_gets_it_in_one(void **state) {
    (void)state;
    proxy p = {.before_tus = true};
    size_t puts = logged("method=PUT");
    proxy_start(&p);
    expect_submitted(submit(&p, large_file(3)));
    assert_int_equal(proxy_stop(&p), 0);
    assert_int_equal(logged("method=PUT"), puts + 1);
}

static void every_request_of_an_upload_is_tried_again(void **state) {
    (void)state;
    proxy p = {.moody = true};
    size_t puts = logged("method=PUT");
    proxy_start(&p);
    expect_submitted(submit(&p, large_file(4)));
    char *notes = proxy_notes(&p);
    assert_string_equal(notes, "0011322355"); /* after a PATCH that was cut off it is asked how far the upload is */
    free(notes);
    assert_int_equal(logged("method=PUT"), puts);
}

static void a_small_file_is_sent_again_and_not_before_the_daemon_wants_it(void **state) {
    (void)state;
    proxy p = {.moody = true, .busy = 2};
    proxy_start(&p);
    expect_submitted(submit(&p, new_file(5, 4096)));
    char *notes = proxy_notes(&p);
    assert_string_equal(notes, "004455");
    free(notes);
}

static void a_job_whose_answer_was_lost_is_one_job(void **state) {
    (void)state;
    proxy p = {.loses_answer = true};
    size_t made = logged("event=job.accepted"), asked = logged("method=POST path=/v1/jobs ");
    proxy_start(&p);
    expect_submitted(submit(&p, new_file(7, 4096)));
    char *notes = proxy_notes(&p);
    assert_string_equal(notes, "x");
    free(notes);
    assert_int_equal(logged("method=POST path=/v1/jobs "), asked + 2);
    assert_int_equal(logged("event=job.accepted"), made + 1);
}

static void a_daemon_that_wants_to_be_left_alone_for_long_is(void **state) {
    (void)state;
    proxy p = {.moody = true, .busy = 3600};
    int status;
    proxy_start(&p);
    pid_t client = submit(&p, new_file(6, 4096));
    assert_int_equal(waitpid(client, &status, 0), client);
    assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 5);
    char *words = kit_read_file(kit_temp_path("words"), NULL), *notes = proxy_notes(&p);
    if (!strstr(words, "no upload for the next 3600 seconds: HTTP status 503")) fail_msg("%s", words);
    assert_string_equal(notes, "00");
    free(words);
    free(notes);
}

static kit_result call(bool shell, const char *url, const char *command, const char *id, const char *option) {
    const char *const words[] = {"sh", BW_SOURCE_DIR "/clients/sh/blockwright.sh", command, id, "--server", url, option, NULL};
    const char *own[] = {kit_program("blockwright"), command, id, "--server", url, option, NULL};
    kit_result r = kit_run(shell ? words : own);
    if (r.exit != 0) fail_msg("%s: exit %d\n%s", command, r.exit, r.err);
    return r;
}

enum { CUTS = 7, DOWN = 500 }; /* an answer's head and a bit of the log */

/* A job that has just begun, of another kind than the one before. */
static char *new_job(int kind) {
    char hexes[16];
    snprintf(hexes, sizeof hexes, "%d", 3000 + 500 * kind);
    const char *part = kit_temp_path("part.hexex");
    kit_result r = kit_run((const char *[]){kit_program("blockwright"), "sample", "cuboid", "-o", part, NULL});
    assert_int_equal(r.exit, 0);
    kit_result_clear(&r);
    r = kit_run((const char *[]){kit_program("blockwright"), "submit", part, "--quantize", "any", "--target-hexes", hexes, "--server", here.url, "--quiet", NULL});
    assert_int_equal(r.exit, 0);
    char *id = strndup(r.out, strcspn(r.out, "\n"));
    kit_result_clear(&r);
    return id;
}

static void a_log_is_followed_past_every_break_without_loss_or_repetition(void **state) {
    (void)state;
    for (int i = 0; i < 4; i++) {
        bool shell = i & 1;
        proxy p = i < 2 ? (proxy){.down = 240, .cuts = 1} : (proxy){.down = DOWN, .cuts = CUTS, .away = 3}; /* 240: behind the head */
        char *id = new_job(i);
        proxy_start(&p);
        kit_result r = call(shell, p.url, "log", id, "--follow");
        assert_true(proxy_stop(&p) > 0);
        kit_result whole = call(false, here.url, "log", id, NULL);
        assert_string_equal(r.out, whole.out);
        kit_result_clear(&r);
        kit_result_clear(&whole);
        free(id);
    }
}

static size_t lines_of(const char *text, const char *line) {
    size_t n = 0, size = strlen(line);
    for (const char *at = text; (at = strstr(at, line)); at += size) n += at[size] == '\n' && (at == text || at[-1] == '\n');
    return n;
}

/* A job that searches for two seconds. */
static char *new_search(const char *part, const char *seed) {
    kit_result r = kit_run((const char *[]){kit_program("blockwright"), "submit", part, "--explore", "anneal", "--explore-work", "1000000000", "--explore-time", "2",
                                            "--seed", seed, "--server", here.url, "--quiet", NULL});
    assert_int_equal(r.exit, 0);
    char *id = strndup(r.out, strcspn(r.out, "\n"));
    kit_result_clear(&r);
    return id;
}

static kit_result watch_past_breaks(bool shell, const char *id, int away) {
    proxy p = {.down = 3000, .cuts = CUTS, .away = away};
    proxy_start(&p);
    kit_result r = call(shell, p.url, "watch", id, NULL);
    assert_true(proxy_stop(&p) > 0);
    return r;
}

/* The shell's client tells each stage once; it joins while the search runs, so what was before is not told. */
static void a_job_is_watched_past_every_break_to_its_end(void **state) {
    (void)state;
    const char *part = kit_temp_path("bearing.hexex");
    kit_result r = kit_run((const char *[]){kit_program("blockwright"), "sample", "bearing", "--size", "2", "-o", part, NULL});
    assert_int_equal(r.exit, 0);
    kit_result_clear(&r);
    char *id = new_search(part, "1");
    r = watch_past_breaks(true, id, 0);
    if (lines_of(r.err, "running reduce") > 1 || lines_of(r.err, "running encode") != 1 || lines_of(r.err, "successful") != 1) fail_msg("%s", r.err);
    kit_result_clear(&r);
    r = call(true, here.url, "watch", id, NULL); /* has ended */
    if (strcmp(r.err, "successful\n") != 0) fail_msg("%s", r.err);
    kit_result_clear(&r);
    free(id);
    for (int shell = 0; shell < 2; shell++) {
        char *other = new_search(part, shell ? "3" : "2");
        r = watch_past_breaks(shell, other, 3);
        kit_result_clear(&r);
        free(other);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(an_upload_goes_on_after_every_break),
    cmocka_unit_test(an_upload_outlives_a_kill_of_its_daemon),
    cmocka_unit_test(a_daemon_that_takes_no_such_upload_gets_it_in_one),
    cmocka_unit_test(every_request_of_an_upload_is_tried_again),
    cmocka_unit_test(a_small_file_is_sent_again_and_not_before_the_daemon_wants_it),
    cmocka_unit_test(a_job_whose_answer_was_lost_is_one_job),
    cmocka_unit_test(a_daemon_that_wants_to_be_left_alone_for_long_is),
    cmocka_unit_test(a_log_is_followed_past_every_break_without_loss_or_repetition),
    cmocka_unit_test(a_job_is_watched_past_every_break_to_its_end),
};
DAEMON_MAIN(tests, daemon_begin)
