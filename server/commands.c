/* blockwrightd token ..., owner ..., gc, backup, restore : reads the words, asks the daemon (admin.h), shows what it says.
 *
 * Exit codes: 0 done, 2 a mistake in the words, 5 it could not be done.
 */
#include "server/commands.h"

#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "server/admin.h"
#include "server/backup.h"
#include "server/config.h"

enum { DONE = 0, USAGE = 2, FAILED = 5 };

static const char token_usage[] =
    "usage: blockwrightd token create --data DIR --owner NAME [--scopes LIST] [--expires TIME] [--note TEXT]\n"
    "       blockwrightd token list --data DIR [--json]\n"
    "       blockwrightd token revoke --data DIR ID\n"
    "\n"
    "create prints the token on standard output, once: only its hash is kept. Who shows it (Authorization: Bearer TOKEN) acts as\n"
    "the owner NAME. LIST is some of submit,read,read-all,admin with commas between them, by default submit,read. TIME is 12h, 30d, 52w; 100000w\n"
    "at most; without it the token does not expire. From the first token on, nobody can do anything without one, and that stays so when it is\n"
    "revoked. All of it works while the daemon runs, and takes effect at once.\n";

static int complain(const char *format, ...) __attribute__((format(printf, 1, 2)));
static int complain(const char *format, ...) {
    va_list args;
    va_start(args, format);
    fprintf(stderr, "blockwrightd: ");
    vfprintf(stderr, format, args);
    fputc('\n', stderr);
    va_end(args);
    return USAGE;
}

/* ---- words ---- */

/* Takes `--name VALUE` or `--name=VALUE` out of the words; NULL if it is not among them. False in *good: the value is missing. */
static const char *take_option(int *argc, char **argv, const char *name, bool *good) {
    size_t n = strlen(name);
    for (int i = 1; i < *argc; i++) {
        const char *word = argv[i], *value = NULL;
        int used = 1;
        if (strncmp(word, "--", 2) != 0 || strncmp(word + 2, name, n) != 0) continue;
        if (word[2 + n] == '=') value = word + 3 + n;
        else if (word[2 + n]) continue;
        else if (i + 1 < *argc) value = argv[i + 1], used = 2;
        if (!value) {
            complain("--%s: the value is missing", name);
            *good = false;
            return NULL;
        }
        memmove(argv + i, argv + i + used, (size_t)(*argc - i - used + 1) * sizeof *argv);
        *argc -= used;
        return value;
    }
    return NULL;
}

static bool take_flag(int *argc, char **argv, const char *word) {
    for (int i = 1; i < *argc; i++) {
        if (strcmp(argv[i], word) != 0) continue;
        memmove(argv + i, argv + i + 1, (size_t)(*argc - i) * sizeof *argv);
        --*argc;
        return true;
    }
    return false;
}

/* What is left must be `operands` words that are no options. */
static bool nothing_else(int argc, char **argv, int operands, const char *usage) {
    for (int i = 1; i < argc; i++)
        if (*argv[i] == '-') {
            complain("'%.80s' is not an option here\n%s", argv[i], usage);
            return false;
        }
    if (argc - 1 != operands) complain("%d word(s) too %s\n%s", abs(argc - 1 - operands), argc - 1 > operands ? "many" : "few", usage);
    return argc - 1 == operands;
}

/* 12h, 30d, 52w: milliseconds, BW_TOKEN_LIFE_MOST + 1 for all that is more; -1 if it is no such thing. */
static json_int_t read_life(const char *text) {
    static const struct {
        char unit;
        json_int_t ms;
    } units[] = {{'s', 1000}, {'m', 60000}, {'h', 3600000}, {'d', 86400000}, {'w', 604800000}};
    char *end;
    long n = strtol(text, &end, 10);
    for (size_t i = 0; i < sizeof units / sizeof *units; i++)
        if (*text >= '0' && *text <= '9' && end[0] == units[i].unit && !end[1] && n > 0)
            return n <= BW_TOKEN_LIFE_MOST / units[i].ms ? n * units[i].ms : BW_TOKEN_LIFE_MOST + 1;
    return -1;
}

/* The settings that the daemon has, for its data folder. False after a message. */
static bool load(bw_config *config, int *argc, char **argv) {
    char error[BW_CONFIG_ERROR];
    bw_ask ask;
    if (bw_config_load(config, argc, argv, true, &ask, error) && bw_config_make_data(config, error)) return true;
    complain("%s", error);
    return false;
}

static json_t *ask(const bw_config *config, json_t *request) {
    char error[BW_ADMIN_ERROR];
    json_t *answer = request ? bw_admin_ask(config, request, error) : NULL;
    if (!answer) complain("%s", request ? error : "out of memory, or a word is no UTF-8");
    return answer;
}

/* ---- token ---- */

static int create(const bw_config *config, int argc, char **argv) {
    bool good = true;
    const char *owner = take_option(&argc, argv, "owner", &good), *scopes = take_option(&argc, argv, "scopes", &good);
    const char *expires = take_option(&argc, argv, "expires", &good), *note = take_option(&argc, argv, "note", &good);
    if (!scopes) scopes = "submit,read";
    json_int_t life = expires ? read_life(expires) : 0;
    if (!good || !nothing_else(argc, argv, 0, token_usage)) return USAGE;
    if (!owner || !bw_is_owner_name(owner))
        return complain("--owner NAME: 1 to 64 of A-Z a-z 0-9 . _ @ + -, a letter or digit first");
    if (!bw_scopes_parse(scopes)) return complain("--scopes '%.80s': some of submit,read,read-all,admin", scopes);
    if (life < 0) return complain("--expires '%.80s': examples are 12h, 30d, 52w", expires);
    if (life > BW_TOKEN_LIFE_MOST) return complain("--expires '%.80s': 100000w at most; without it the token does not expire", expires);
    json_t *answer = ask(config, json_pack("{s:s, s:s, s:s, s:s, s:I}", "command", "token create", "owner", owner, "scopes", scopes,
                                           "note", note ? note : "", "expires_ms", life));
    if (!answer) return FAILED;
    const char *id = json_string_value(json_object_get(answer, "id")), *until = json_string_value(json_object_get(answer, "expires"));
    fprintf(stderr, "blockwrightd: token %s of %s (%s), %s%s. It is shown this once:\n", id ? id : "?", owner, scopes,
            until ? "valid until " : "without an end", until ? until : "");
    printf("%s\n", json_string_value(json_object_get(answer, "token")));
    json_decref(answer);
    return DONE;
}

static const char *text_of(const json_t *object, const char *name) {
    const char *text = json_string_value(json_object_get(object, name));
    return text ? text : "-";
}

static void print_token(const json_t *t) {
    char scopes[80] = "";
    const json_t *scope;
    size_t i;
    json_array_foreach(json_object_get(t, "scopes"), i, scope) {
        size_t n = strlen(scopes);
        snprintf(scopes + n, sizeof scopes - n, "%s%s", i ? "," : "", json_string_value(scope));
    }
    printf("%-12s  %-8s  %-20s  %-28s  %-24s  %-24s  %s\n", text_of(t, "id"), text_of(t, "state"), text_of(t, "owner"), scopes,
           text_of(t, "created"), text_of(t, "expires"), text_of(t, "note"));
}

static int list(const bw_config *config, int argc, char **argv) {
    bool raw = take_flag(&argc, argv, "--json");
    const json_t *token;
    size_t i;
    if (!nothing_else(argc, argv, 0, token_usage)) return USAGE;
    json_t *answer = ask(config, json_pack("{s:s}", "command", "token list"));
    if (!answer) return FAILED;
    if (raw) json_dumpf(answer, stdout, JSON_INDENT(1)), putchar('\n');
    else {
        printf("%-12s  %-8s  %-20s  %-28s  %-24s  %-24s  %s\n", "ID", "STATE", "OWNER", "SCOPES", "CREATED", "EXPIRES", "NOTE");
        json_array_foreach(json_object_get(answer, "tokens"), i, token) print_token(token);
    }
    json_decref(answer);
    return DONE;
}

static int revoke_token(const bw_config *config, int argc, char **argv) {
    if (!nothing_else(argc, argv, 1, token_usage)) return USAGE;
    json_t *answer = ask(config, json_pack("{s:s, s:s}", "command", "token revoke", "id", argv[1]));
    if (!answer) return FAILED;
    fprintf(stderr, "blockwrightd: token %s is revoked\n", argv[1]);
    json_decref(answer);
    return DONE;
}

/* ---- owner ---- */

static const char owner_usage[] =
    "usage: blockwrightd owner set --data DIR NAME [--queued N] [--running N] [--bytes SIZE]\n"
    "       blockwrightd owner list --data DIR [--json]\n"
    "\n"
    "set gives an owner limits of its own: jobs that wait or run, stages that run at the same time, bytes of inputs (1000000, 512M, 2G).\n"
    "In the place of a number, none means no limit, and standard that of the configuration (owner-jobs, owner-running, owner-bytes).\n"
    "It works while the daemon runs, and takes effect at once.\n";

/* A limit as the daemon wants it: a number, or a word that it checks. NULL after a message. */
static json_t *read_limit(const char *name, const char *text, bool sizes) {
    static const char units[] = "KMGT";
    char *end;
    long long n = strtoll(text, &end, 10);
    const char *unit = sizes && *end && !end[1] ? strchr(units, *end) : NULL;
    for (long i = unit ? unit - units + 1 : 0; i > 0 && n <= INT64_MAX / 1024; i--) n *= 1024;
    if (strcmp(text, "none") == 0 || strcmp(text, "standard") == 0) return json_string(text);
    if (*text >= '0' && *text <= '9' && (!*end || unit) && n > 0 && n < INT64_MAX / 1024) return json_integer(n);
    complain("--%s '%.80s': %s, none or standard", name, text, sizes ? "a size from 1" : "a number from 1");
    return NULL;
}

static int set_owner(const bw_config *config, int argc, char **argv) {
    static const char *const names[] = {"queued", "running", "bytes"};
    json_t *request = json_pack("{s:s}", "command", "owner set");
    bool good = true, any = false;
    for (int i = 0; good && i < 3; i++) {
        const char *text = take_option(&argc, argv, names[i], &good);
        json_t *limit = text ? read_limit(names[i], text, i == 2) : NULL;
        good = good && !text == !limit;
        any = any || limit;
        if (limit) json_object_set_new(request, names[i], limit);
    }
    good = good && nothing_else(argc, argv, 1, owner_usage);
    if (good && !any) complain("say at least one of --queued, --running, --bytes");
    if (good && any && !bw_is_owner_name(argv[1])) complain("'%.80s' is no name of an owner", argv[1]), good = false;
    if (!good || !any) {
        json_decref(request);
        return USAGE;
    }
    json_object_set_new(request, "owner", json_string(argv[1]));
    json_t *answer = ask(config, request);
    json_decref(answer);
    return answer ? DONE : FAILED;
}

static void print_limit(const json_t *owner, const char *name) {
    const json_t *value = json_object_get(owner, name);
    if (json_is_integer(value)) printf("  %14lld", (long long)json_integer_value(value));
    else printf("  %14s", text_of(owner, name));
}

static int list_owners(const bw_config *config, int argc, char **argv) {
    static const char *const counts[] = {"waiting", "running", "finished", "bytes"}, *const limits[] = {"queued", "running", "bytes"};
    bool raw = take_flag(&argc, argv, "--json");
    const json_t *owner;
    size_t i;
    if (!nothing_else(argc, argv, 0, owner_usage)) return USAGE;
    json_t *answer = ask(config, json_pack("{s:s}", "command", "owner list"));
    if (!answer) return FAILED;
    if (raw) json_dumpf(answer, stdout, JSON_INDENT(1)), putchar('\n');
    else printf("%-20s  %14s  %14s  %14s  %14s  %14s  %14s  %14s\n", "OWNER", "WAITING", "RUNNING", "FINISHED", "BYTES", "QUEUED<=", "RUNNING<=", "BYTES<=");
    json_array_foreach(json_object_get(answer, "owners"), i, owner) {
        if (raw) break;
        printf("%-20s", *text_of(owner, "owner") ? text_of(owner, "owner") : "(local)");
        for (int k = 0; k < 4; k++) print_limit(json_object_get(owner, "has"), counts[k]);
        for (int k = 0; k < 3; k++) print_limit(owner, limits[k]);
        putchar('\n');
    }
    json_decref(answer);
    return DONE;
}

/* ---- all of them ---- */

typedef struct {
    const char *word;
    int (*run)(const bw_config *config, int argc, char **argv);
} verb;

static int run_verb(int argc, char **argv, const verb *verbs, const char *usage) {
    static bw_config config;
    if (take_flag(&argc, argv, "--help")) return fputs(usage, stdout) < 0;
    if (argc < 2) {
        fputs(usage, stderr);
        return USAGE;
    }
    for (; verbs->word; verbs++)
        if (strcmp(argv[1], verbs->word) == 0) {
            argc--, argv++;
            return load(&config, &argc, argv) ? verbs->run(&config, argc, argv) : USAGE;
        }
    return complain("there is no '%s %.40s'\n%s", argv[0], argv[1], usage);
}

int bw_command_token(int argc, char **argv) {
    static const verb verbs[] = {{"create", create}, {"list", list}, {"revoke", revoke_token}, {NULL, NULL}};
    return run_verb(argc, argv, verbs, token_usage);
}

int bw_command_owner(int argc, char **argv) {
    static const verb verbs[] = {{"set", set_owner}, {"list", list_owners}, {NULL, NULL}};
    return run_verb(argc, argv, verbs, owner_usage);
}

/* ---- gc ---- */

static const char gc_usage[] =
    "usage: blockwrightd gc --data DIR [--dry-run] [--json]\n"
    "\n"
    "Removes at once what the daemon removes every --retention-interval anyway, by the daemon's settings (of this command if none runs), and\n"
    "prints how much of what went and why. --dry-run: only tells. Works while the daemon runs.\n";

static json_int_t number_of(const json_t *object, const char *name) { return json_integer_value(json_object_get(object, name)); }

static void print_gc(const json_t *answer) {
    static const char *const reasons[][2] = {{"jobs", "ended longer ago than keep-finished, keep-failed"},
                                             {"outputs", "unused for longest, beyond cache-size"},
                                             {"blobs", "named by no job, unused for keep-uploads"},
                                             {"keys", "Idempotency-Keys older than keep-keys"},
                                             {"gone", "ids of removed jobs, older than keep-gone"}};
    printf("%-8s  %10s  %16s  %s\n", json_is_true(json_object_get(answer, "dry_run")) ? "WOULD GO" : "GONE", "COUNT", "BYTES", "REASON");
    for (size_t i = 0; i < sizeof reasons / sizeof *reasons; i++) {
        const json_t *kind = json_object_get(json_object_get(answer, "collected"), reasons[i][0]);
        printf("%-8s  %10" JSON_INTEGER_FORMAT "  %16" JSON_INTEGER_FORMAT "  %s\n", reasons[i][0], number_of(kind, "count"),
               number_of(kind, "bytes"), reasons[i][1]);
    }
    printf("cache: %" JSON_INTEGER_FORMAT " bytes left, cache-size %" JSON_INTEGER_FORMAT "; %" JSON_INTEGER_FORMAT
           " outputs of %" JSON_INTEGER_FORMAT " bytes would have been due but are in use\n", number_of(answer, "cache_bytes"),
           number_of(answer, "cache_most"), number_of(answer, "held"), number_of(answer, "held_bytes"));
}

int bw_command_gc(int argc, char **argv) {
    static bw_config config;
    if (take_flag(&argc, argv, "--help")) return fputs(gc_usage, stdout) < 0;
    bool dry = take_flag(&argc, argv, "--dry-run"), raw = take_flag(&argc, argv, "--json");
    if (!load(&config, &argc, argv) || !nothing_else(argc, argv, 0, gc_usage)) return USAGE;
    json_t *answer = ask(&config, json_pack("{s:s, s:b}", "command", "gc", "dry_run", dry));
    if (!answer) return FAILED;
    if (raw) json_dumpf(answer, stdout, JSON_INDENT(1)), putchar('\n');
    else print_gc(answer);
    json_decref(answer);
    return DONE;
}

/* ---- backup, restore ---- */

static const char backup_usage[] =
    "usage: blockwrightd backup FILE --data DIR [--with-files]\n"
    "\n"
    "Copies the database to FILE while the daemon runs: everything that was accepted before is in it. FILE.manifest lists the inputs and outputs that\n"
    "its jobs need; with --with-files they are put into FILE.files/, as hard links if that is on the same file system. The daemon writes\n"
    "them, so it must be allowed to write there.\n";
static const char restore_usage[] =
    "usage: blockwrightd restore FILE --data DIR\n"
    "\n"
    "Makes a data folder of a backup: DIR must be new or empty. FILE.files/ is taken if it is there; inputs are checked against their hashes, and\n"
    "those that are damaged left out. Jobs whose files are not there become failed (files-lost) when a daemon starts on DIR.\n"
    "Exit codes: 0 all is there, 5 it could not be done, or files are missing or damaged (the folder is good otherwise).\n";

/* Made absolute, for the daemon is elsewhere. */
static bool absolute(const char *name, char path[4096]) {
    char here[2048] = "";
    if (*name != '/' && !getcwd(here, sizeof here)) return false;
    return snprintf(path, 4096, "%s%s%s", here, *name == '/' ? "" : "/", name) < 3900;
}

int bw_command_backup(int argc, char **argv) {
    static bw_config config;
    char path[4096];
    if (take_flag(&argc, argv, "--help")) return fputs(backup_usage, stdout) < 0;
    bool files = take_flag(&argc, argv, "--with-files");
    if (!load(&config, &argc, argv) || !nothing_else(argc, argv, 1, backup_usage)) return USAGE;
    if (!absolute(argv[1], path)) return complain("the name is too long");
    json_t *answer = ask(&config, json_pack("{s:s, s:s, s:b}", "command", "backup", "file", path, "with_files", files));
    if (!answer) return FAILED;
    printf("%s: %" JSON_INTEGER_FORMAT " jobs; their %" JSON_INTEGER_FORMAT " files of %" JSON_INTEGER_FORMAT " bytes are %s %s.%s\n", path,
           number_of(answer, "jobs"), number_of(answer, "files"), number_of(answer, "bytes"), files ? "in" : "listed in", path, files ? "files" : "manifest");
    json_decref(answer);
    return DONE;
}

int bw_command_restore(int argc, char **argv) {
    static bw_config config;
    char error[BW_BACKUP_ERROR];
    bw_backup_report report;
    if (take_flag(&argc, argv, "--help")) return fputs(restore_usage, stdout) < 0;
    if (!load(&config, &argc, argv) || !nothing_else(argc, argv, 1, restore_usage)) return USAGE;
    if (bw_backup_restore(argv[1], config.data, &report, error) != BW_OK) {
        complain("%s", error);
        return FAILED;
    }
    printf("%s: %lld jobs, %lld files; %lld missing, %lld damaged and left out\n", config.data, (long long)report.jobs, (long long)report.files,
           (long long)report.missing, (long long)report.damaged);
    return report.missing || report.damaged ? FAILED : DONE;
}
