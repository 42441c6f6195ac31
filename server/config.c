/* Where settings come from. settings.c has the table and the values. */
#include "server/config.h"

#include <ctype.h>
#include <errno.h>
#include <inttypes.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "server/networks.h"

enum { LINE_MOST = 2 * PATH_MAX, HELP_WIDTH = 118, HELP_INDENT = 32 };

static const char prefix[] = "BLOCKWRIGHT_";
/* Variables with the prefix that are not the daemon's. */
static const char *const of_others[] = {"BLOCKWRIGHT_SERVER", "BLOCKWRIGHT_TOKEN"};

extern char **environ;

static bool mistake(char error[BW_CONFIG_ERROR], const char *format, ...) __attribute__((format(printf, 2, 3)));
static bool mistake(char error[BW_CONFIG_ERROR], const char *format, ...) {
    va_list args;
    va_start(args, format);
    vsnprintf(error, BW_CONFIG_ERROR, format, args);
    va_end(args);
    return false;
}

/* "; did you mean NAME?" or nothing. */
static const char *hint(const char *before, const char *name, size_t length, char text[96]) {
    const char *nearest = bw_setting_nearest(name, length);
    text[0] = '\0';
    if (nearest) snprintf(text, 96, "; did you mean %s%s?", before, nearest);
    return text;
}

static bool apply(bw_config *config, int index, const char *text, bw_origin origin, const char *place,
                  char error[BW_CONFIG_ERROR]) {
    char why[400];
    if (!bw_setting_parse(&bw_settings[index], config, text, why, sizeof why)) return mistake(error, "%s: %s", place, why);
    config->origins[index] = origin;
    return true;
}

static bool set_defaults(bw_config *config, char error[BW_CONFIG_ERROR]) {
    char text[BW_VALUE_TEXT];
    memset(config, 0, sizeof *config);
    for (size_t i = 0; i < bw_setting_count; i++) {
        const char *value = bw_setting_default(&bw_settings[i], text);
        if (*value && !apply(config, (int)i, value, (bw_origin){BW_FROM_DEFAULT, 0}, bw_settings[i].name, error)) return false;
    }
    return true;
}

/* ---- the file ---- */

/* Cuts the value out of what stands after '=': up to a comment or the end, or between double quotes, where \" and \\ stand for
 * themselves without the backslash. NULL if the quotes do not end or something follows them. */
static char *cut_value(char *text) {
    text += strspn(text, " \t");
    if (*text != '"') {
        char *end = text;
        while (*end && !(*end == '#' && (end == text || isblank((unsigned char)end[-1])))) end++;
        while (end > text && isspace((unsigned char)end[-1])) end--;
        *end = '\0';
        return text;
    }
    char *from = text + 1, *to = text;
    while (*from && *from != '"') {
        if (*from == '\\' && (from[1] == '"' || from[1] == '\\')) from++;
        *to++ = *from++;
    }
    if (*from != '"') return NULL;
    from += 1 + strspn(from + 1, " \t\r\n");
    *to = '\0';
    return *from && *from != '#' ? NULL : text;
}

static bool apply_line(bw_config *config, char *line, int number, char error[BW_CONFIG_ERROR]) {
    char near[96], place[PATH_MAX + 96];
    const char *file = config->file;
    line += strspn(line, " \t\r\n");
    if (!*line || *line == '#') return true;
    size_t length = strcspn(line, " \t\r\n=#");
    char *equals = line + length + strspn(line + length, " \t");
    if (*equals != '=' || length == 0)
        return mistake(error, "%.300s:%d: '%.60s' is not \"name = value\"", file, number, strtok(line, "\r\n"));
    int index = bw_setting_find(line, length);
    if (index < 0)
        return mistake(error, "%.300s:%d: there is no setting '%.*s'%s", file, number, length > 60 ? 60 : (int)length, line,
                       hint("", line, length, near));
    if (strcmp(bw_settings[index].name, "config") == 0)
        return mistake(error, "%.300s:%d: a file cannot name another one", file, number);
    if (config->origins[index].source == BW_FROM_FILE)
        return mistake(error, "%.300s:%d: %s was already set on line %d", file, number, bw_settings[index].name,
                       config->origins[index].line);
    char *value = cut_value(equals + 1);
    if (!value) return mistake(error, "%.300s:%d: %s: the quotes do not fit", file, number, bw_settings[index].name);
    snprintf(place, sizeof place, "%.300s:%d: %s", file, number, bw_settings[index].name);
    return apply(config, index, value, (bw_origin){BW_FROM_FILE, number}, place, error);
}

static bool apply_file(bw_config *config, char error[BW_CONFIG_ERROR]) {
    char line[LINE_MOST];
    bool good = true;
    if (!*config->file) return true;
    FILE *f = fopen(config->file, "re");
    if (!f) return mistake(error, "cannot read the configuration file '%.300s': %s", config->file, strerror(errno));
    for (int number = 1; good && fgets(line, sizeof line, f); number++) {
        size_t n = strlen(line);
        if (n == 0 || (line[n - 1] != '\n' && !feof(f)))
            good = mistake(error, "%.300s:%d: the line is too long, or has a zero byte in it", config->file, number);
        else good = apply_line(config, line, number, error);
    }
    if (good && ferror(f)) good = mistake(error, "cannot read the configuration file '%.300s': %s", config->file, strerror(errno));
    fclose(f);
    return good;
}

/* ---- the environment ---- */

static void variable_of(const bw_setting *s, char name[96]) {
    size_t n = (size_t)snprintf(name, 96, "%s%s", prefix, s->name);
    for (size_t i = sizeof prefix - 1; i < n; i++) name[i] = name[i] == '-' ? '_' : (char)toupper((unsigned char)name[i]);
}

static bool apply_environment(bw_config *config, char error[BW_CONFIG_ERROR]) {
    for (size_t i = 0; i < bw_setting_count; i++) {
        char name[96];
        variable_of(&bw_settings[i], name);
        const char *value = getenv(name);
        if (value && !apply(config, (int)i, value, (bw_origin){BW_FROM_ENVIRONMENT, 0}, name, error)) return false;
    }
    return true;
}

static bool belongs(const char *variable) {
    size_t n = strcspn(variable, "=");
    char name[96];
    for (size_t i = 0; i < sizeof of_others / sizeof *of_others; i++)
        if (strlen(of_others[i]) == n && strncmp(of_others[i], variable, n) == 0) return true;
    for (size_t i = 0; i < bw_setting_count; i++) {
        variable_of(&bw_settings[i], name);
        if (strlen(name) == n && strncmp(name, variable, n) == 0) return true;
    }
    return false;
}

const char *bw_config_stray_variable(size_t i) {
    for (char **v = environ; v && *v; v++)
        if (strncmp(*v, prefix, sizeof prefix - 1) == 0 && !belongs(*v) && i-- == 0) return *v;
    return NULL;
}

/* ---- the command line ---- */

static bool is_ask(const char *word, bw_ask *ask) {
    static const struct {
        const char *word;
        bw_ask ask;
    } words[] = {{"--check-config", BW_ASK_CHECK}, {"--help", BW_ASK_HELP}, {"--version", BW_ASK_VERSION}};
    for (size_t i = 0; i < sizeof words / sizeof *words; i++)
        if (strcmp(word, words[i].word) == 0 && words[i].ask > *ask) *ask = words[i].ask;
    return strcmp(word, "--check-config") == 0 || strcmp(word, "--help") == 0 || strcmp(word, "--version") == 0;
}

/* Moves the settings of the command line into `flags` (NULL: not given). */
static bool take_flags(int *argc, char **argv, bool others, bw_ask *ask, const char *flags[BW_SETTINGS_MOST],
                       char error[BW_CONFIG_ERROR]) {
    int kept = 1;
    char near[96];
    for (int i = 1; i < *argc; i++) {
        const char *word = argv[i], *name = word + 2;
        bool flag = strncmp(word, "--", 2) == 0;
        size_t length = flag ? strcspn(name, "=") : 0;
        int index = flag ? bw_setting_find(name, length) : -1;
        if (index >= 0 && name[length] == '=') {
            flags[index] = name + length + 1;
        } else if (index >= 0) {
            if (i + 1 >= *argc) return mistake(error, "%s: the value is missing", word);
            flags[index] = argv[++i];
        } else if (!is_ask(word, ask)) {
            if (!others)
                return mistake(error, "'%.80s' is not an option%s", word, flag ? hint("--", name, length, near) : "");
            argv[kept++] = argv[i];
        }
    }
    *argc = kept;
    argv[kept] = NULL;
    return true;
}

static bool apply_flags(bw_config *config, const char *const flags[BW_SETTINGS_MOST], char error[BW_CONFIG_ERROR]) {
    for (size_t i = 0; i < bw_setting_count; i++) {
        char place[96];
        snprintf(place, sizeof place, "--%s", bw_settings[i].name);
        if (flags[i] && !apply(config, (int)i, flags[i], (bw_origin){BW_FROM_FLAG, 0}, place, error)) return false;
    }
    return true;
}

/* ---- all together ---- */

/* The data folder by its real name, so that two ways to it are seen to be one. */
static bool resolve_data(bw_config *config) {
    char *real = realpath(config->data, NULL);
    bool good = real && strlen(real) < sizeof config->data;
    if (good) strcpy(config->data, real);
    free(real);
    return good;
}

bool bw_config_is_loopback(const bw_config *config) {
    uint8_t address[16];
    return bw_address_of((const struct sockaddr *)&config->listen, address) && bw_address_is_loopback(address);
}

/* What no single value shows. */
static bool complete(bw_config *config, char error[BW_CONFIG_ERROR]) {
    struct stat info;
    config->listen_size = config->listen.ss_family == AF_INET6 ? sizeof(struct sockaddr_in6) : sizeof(struct sockaddr_in);
    if (!*config->data) return mistake(error, "say with --data DIR where jobs and results are to be kept");
    if (resolve_data(config) && stat(config->data, &info) == 0 && !S_ISDIR(info.st_mode))
        return mistake(error, "the data folder '%.300s' is a file", config->data);
    if (!*config->tls_certificate != !*config->tls_key) return mistake(error, "tls-cert and tls-key go together: one of them is missing");
    if (!bw_config_is_loopback(config) && !*config->tls_certificate && !*config->behind_proxy)
        return mistake(error, "refusing to listen on other than loopback: access tokens and parts would cross the network for all to read. Give tls-cert "
                       "and tls-key, or listen on 127.0.0.1 or [::1]; if a proxy before the daemon speaks TLS, say with behind-proxy which");
    if (access(config->worker, X_OK) != 0) return mistake(error, "the worker '%.300s' cannot be run", config->worker);
    return true;
}

bool bw_config_load(bw_config *config, int *argc, char **argv, bool others, bw_ask *ask, char error[BW_CONFIG_ERROR]) {
    const char *flags[BW_SETTINGS_MOST] = {NULL};
    int file = bw_setting_find("config", strlen("config"));
    *ask = BW_ASK_RUN;
    if (!take_flags(argc, argv, others, ask, flags, error)) return false;
    if (*ask == BW_ASK_HELP || *ask == BW_ASK_VERSION) return true;
    if (!set_defaults(config, error)) return false;
    const char *path = flags[file] ? flags[file] : getenv("BLOCKWRIGHT_CONFIG");
    if (path && !apply(config, file, path, (bw_origin){BW_FROM_FLAG, 0}, "--config", error)) return false;
    return apply_file(config, error) && apply_environment(config, error) && apply_flags(config, flags, error) &&
           complete(config, error);
}

bool bw_config_make_data(bw_config *config, char error[BW_CONFIG_ERROR]) {
    if (mkdir(config->data, 0700) != 0 && errno != EEXIST)
        return mistake(error, "cannot make the folder '%.300s': %s", config->data, strerror(errno));
    return resolve_data(config) || mistake(error, "cannot use the folder '%.300s'", config->data);
}

void bw_config_reload(bw_config *live, const bw_config *fresh,
                      void (*tell)(const bw_setting *setting, const char *value, bool applied)) {
    for (size_t i = 0; i < bw_setting_count; i++) {
        const bw_setting *s = &bw_settings[i];
        char before[BW_VALUE_TEXT], after[BW_VALUE_TEXT], why[8];
        bw_setting_text(s, live, before);
        bw_setting_text(s, fresh, after);
        if (s->reloadable) live->origins[i] = fresh->origins[i];
        if (strcmp(before, after) == 0) continue;
        tell(s, after, s->reloadable && bw_setting_parse(s, live, after, why, sizeof why));
    }
}

/* ---- telling ---- */

/* The value as cut_value() reads it. */
static void print_value(const char *text, FILE *to) {
    if (*text && !strpbrk(text, "\"#") && text[0] != ' ' && text[strlen(text) - 1] != ' ') {
        fputs(text, to);
        return;
    }
    fputc('"', to);
    for (; *text; text++) fprintf(to, *text == '"' || *text == '\\' ? "\\%c" : "%c", *text);
    fputc('"', to);
}

static void print_origin(const bw_config *config, size_t i, FILE *to) {
    const bw_setting *s = &bw_settings[i];
    char name[96];
    variable_of(s, name);
    switch (config->origins[i].source) {
    case BW_FROM_DEFAULT: fprintf(to, "  # default\n"); break;
    case BW_FROM_FILE: fprintf(to, "  # %s:%d\n", config->file, config->origins[i].line); break;
    case BW_FROM_ENVIRONMENT: fprintf(to, "  # %s\n", name); break;
    case BW_FROM_FLAG: fprintf(to, "  # --%s\n", s->name); break;
    }
}

void bw_config_print(const bw_config *config, FILE *to) {
    for (size_t i = 0; i < bw_setting_count; i++) {
        char text[BW_VALUE_TEXT];
        bw_setting_text(&bw_settings[i], config, text);
        if (!*text) continue;
        bool comment = bw_settings[i].offset == offsetof(bw_config, file); /* cannot stand in a file */
        fprintf(to, "%s%s = ", comment ? "# " : "", bw_settings[i].name);
        print_value(text, to);
        print_origin(config, i, to);
    }
}

static void print_wrapped(const char *text, FILE *to) {
    for (size_t column = HELP_INDENT, n; *text; text += n + strspn(text + n, " "), column += n) {
        bool first = column == HELP_INDENT;
        n = strcspn(text, " ");
        if (column + n >= HELP_WIDTH) fprintf(to, "\n%*s", HELP_INDENT, ""), column = HELP_INDENT, first = true;
        if (!first) fputc(' ', to), column++;
        fprintf(to, "%.*s", (int)n, text);
    }
    fputc('\n', to);
}

void bw_config_print_help(FILE *to) {
    for (size_t i = 0; i < bw_setting_count; i++) {
        const bw_setting *s = &bw_settings[i];
        char left[96], right[700];
        int n = snprintf(left, sizeof left, "  %s--%s %s", s->reloadable ? "* " : "  ", s->name, s->value);
        fprintf(to, "%-*s", HELP_INDENT, left);
        if (n >= HELP_INDENT) fprintf(to, "\n%*s", HELP_INDENT, "");
        n = snprintf(right, sizeof right, "%s", s->help);
        if (s->choices) n += snprintf(right + n, sizeof right - (size_t)n, ": %s", s->choices);
        if (s->standard && *s->standard) snprintf(right + n, sizeof right - (size_t)n, "; default %s", s->standard);
        print_wrapped(right, to);
    }
}
