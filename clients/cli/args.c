#include "args.h"

#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "command.h"

enum { WORD_MAX = 32, OPTIONS_MAX = 64, LEFT = 24 };

int cli_usage_error(const cli_command *command, const char *format, ...) {
    va_list args;
    va_start(args, format);
    fprintf(stderr, "blockwright %s: ", command->name);
    vfprintf(stderr, format, args);
    va_end(args);
    fprintf(stderr, "\nTry 'blockwright %s --help'.\n", command->name);
    return CLI_USAGE;
}

/* Edit distance (Levenshtein); words longer than WORD_MAX are far from everything. */
static int distance(const char *a, const char *b) {
    size_t n = strlen(a), m = strlen(b);
    if (n > WORD_MAX || m > WORD_MAX) return WORD_MAX;
    int row[WORD_MAX + 1];
    for (size_t j = 0; j <= m; j++) row[j] = (int)j;
    for (size_t i = 1; i <= n; i++) {
        int diagonal = row[0];
        row[0] = (int)i;
        for (size_t j = 1; j <= m; j++) {
            int best = diagonal + (a[i - 1] != b[j - 1]);
            if (row[j] + 1 < best) best = row[j] + 1;
            if (row[j - 1] + 1 < best) best = row[j - 1] + 1;
            diagonal = row[j];
            row[j] = best;
        }
    }
    return row[m];
}

const char *cli_nearest(const char *word, const char *const *words, size_t n) {
    const char *best = NULL;
    int limit = strlen(word) < 4 ? 1 : 3;
    for (size_t i = 0; i < n; i++) {
        int d = distance(word, words[i]);
        if (d > limit || d >= (int)strlen(words[i])) continue;
        limit = d - 1;
        best = words[i];
    }
    return best;
}

static bool unknown_option(const cli_command *command, const char *given, size_t length) {
    char word[WORD_MAX + 1];
    snprintf(word, sizeof word, "%.*s", (int)(length < WORD_MAX ? length : WORD_MAX), given);
    const char *names[OPTIONS_MAX] = {"help"};
    size_t count = 1;
    for (size_t i = 0; i < command->option_count && count < OPTIONS_MAX; i++)
        names[count++] = command->options[i].name;
    const char *near = cli_nearest(word, names, count);
    if (near)
        cli_usage_error(command, "unknown option '--%s'; did you mean '--%s'?", word, near);
    else
        cli_usage_error(command, "unknown option '--%s'", word);
    return false;
}

static bool read_integer(const cli_command *command, const cli_option *o, const char *text, int64_t *value) {
    char *end;
    errno = 0;
    long long v = strtoll(text, &end, 10);
    if (end == text || *end || errno || (double)v < o->low || (double)v > o->high) {
        cli_usage_error(command, "--%s takes a whole number from %.0f to %.0f, not '%s'", o->name, o->low,
                        o->high, text);
        return false;
    }
    *value = v;
    return true;
}

static bool read_number(const cli_command *command, const cli_option *o, const char *text, double *value) {
    char *end;
    double v = strtod(text, &end);
    if (end == text || *end || !isfinite(v) || v < o->low || v > o->high) {
        cli_usage_error(command, "--%s takes a number from %g to %g, not '%s'", o->name, o->low, o->high,
                        text);
        return false;
    }
    *value = v;
    return true;
}

static bool read_bytes(const cli_command *command, const cli_option *o, const char *text, uint64_t *value) {
    static const char suffixes[] = "KMGT";
    char *end;
    errno = 0;
    unsigned long long v = strtoull(text, &end, 10);
    bool good = end != text && !errno && *text != '-';
    unsigned shift = 0;
    const char *suffix = *end ? strchr(suffixes, *end) : NULL;
    if (suffix) {
        shift = 10u * (unsigned)(suffix - suffixes + 1);
        end++;
    }
    if (!good || *end || v == 0 || v > (UINT64_MAX >> 1) >> shift) {
        cli_usage_error(command, "--%s takes a number of bytes such as 500M or 4G, not '%s'", o->name, text);
        return false;
    }
    *value = (uint64_t)v << shift;
    return true;
}

static bool read_choice(const cli_command *command, const cli_option *o, const char *text,
                        const char **value) {
    size_t length = strlen(text);
    for (const char *word = o->value; word; word = strchr(word, '|')) {
        if (*word == '|') word++;
        if (length && strcspn(word, "|") == length && !strncmp(word, text, length)) {
            *value = text;
            return true;
        }
    }
    cli_usage_error(command, "--%s is one of %s, not '%s'", o->name, o->value, text);
    return false;
}

static bool read_value(const cli_command *command, const cli_option *o, const char *text, void *settings) {
    void *field = (char *)settings + o->offset;
    switch (o->kind) {
    case CLI_FLAG:
        *(bool *)field = true;
        return true;
    case CLI_TEXT:
        *(const char **)field = text;
        return true;
    case CLI_INTEGER:
        return read_integer(command, o, text, field);
    case CLI_NUMBER:
        return read_number(command, o, text, field);
    case CLI_BYTES:
        return read_bytes(command, o, text, field);
    case CLI_CHOICE:
        return read_choice(command, o, text, field);
    }
    return false;
}

static const cli_option *find_long(const cli_command *command, const char *name, size_t length) {
    for (size_t i = 0; i < command->option_count; i++)
        if (strlen(command->options[i].name) == length && !strncmp(command->options[i].name, name, length))
            return &command->options[i];
    return NULL;
}

static const cli_option *find_letter(const cli_command *command, char letter) {
    for (size_t i = 0; i < command->option_count; i++)
        if (command->options[i].letter && command->options[i].letter == letter) return &command->options[i];
    return NULL;
}

/* Reads the option at argv[*at]; moves *at to the last word it used. */
static bool read_option(const cli_command *command, int argc, char **argv, int *at, void *settings) {
    const char *word = argv[*at], *text = NULL;
    const cli_option *o;
    if (word[1] == '-') {
        size_t length = strcspn(word + 2, "=");
        o = find_long(command, word + 2, length);
        if (!o) return unknown_option(command, word + 2, length);
        if (word[2 + length]) text = word + 3 + length;
    } else {
        o = find_letter(command, word[1]);
        if (!o) return cli_usage_error(command, "unknown option '-%c'", word[1]), false;
        if (word[2]) text = word + 2;
    }
    if (o->kind == CLI_FLAG) {
        if (text) return cli_usage_error(command, "--%s takes no value", o->name), false;
    } else if (!text) {
        if (*at + 1 >= argc)
            return cli_usage_error(command, "--%s needs a value: %s", o->name, o->value), false;
        text = argv[++*at];
    }
    return read_value(command, o, text, settings);
}

bool cli_parse(const cli_command *command, int argc, char **argv, void *settings, cli_operands *operands,
               int low, int high) {
    bool only_operands = false;
    operands->count = 0;
    for (int i = 0; i < argc; i++) {
        if (!only_operands && !strcmp(argv[i], "--")) {
            only_operands = true;
        } else if (!only_operands && argv[i][0] == '-' && argv[i][1]) {
            if (!read_option(command, argc, argv, &i, settings)) return false;
        } else if (operands->count >= high) {
            cli_usage_error(command, "'%s' is one word too many", argv[i]);
            return false;
        } else {
            operands->operand[operands->count++] = argv[i];
        }
    }
    if (operands->count < low) {
        cli_usage_error(command, "something is missing: blockwright %s %s", command->name, command->synopsis);
        return false;
    }
    return true;
}

void cli_command_help(const cli_command *command) {
    printf("Usage: blockwright %s %s\n\n%s\n\nOptions:\n", command->name, command->synopsis, command->about);
    for (size_t i = 0; i <= command->option_count; i++) {
        static const cli_option help = {"help", 'h', CLI_FLAG, 0, NULL, "show this text", 0, 0};
        const cli_option *o = i < command->option_count ? &command->options[i] : &help;
        char left[100];
        int n = o->letter ? snprintf(left, sizeof left, "-%c, --%s", o->letter, o->name)
                          : snprintf(left, sizeof left, "    --%s", o->name);
        if (o->kind != CLI_FLAG) snprintf(left + n, sizeof left - (size_t)n, " %s", o->value);
        if (strlen(left) > LEFT) printf("  %s\n  %*s %s\n", left, LEFT, "", o->help);
        else printf("  %-*s %s\n", LEFT, left, o->help);
    }
    printf("\nExamples:\n%s\n\n"
           "Exit codes: 0 done, 2 usage, 3 bad input, 4 limit reached or cancelled, 5 internal.\n",
           command->examples);
}
