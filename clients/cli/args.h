/* Command lines: options declared in tables, parsed into a settings struct, explained from the same table.
 *
 * Understood: --name VALUE, --name=VALUE, -x VALUE, -xVALUE, --flag, -- (the rest are operands), operands
 * anywhere. An unknown option is an error that names the nearest known one; so is a value that is missing or
 * out of range.
 */
#ifndef BW_CLI_ARGS_H
#define BW_CLI_ARGS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct cli_command cli_command;

typedef enum {
    CLI_FLAG,    /* bool */
    CLI_TEXT,    /* const char *, borrowed from argv */
    CLI_INTEGER, /* int64_t within low..high */
    CLI_NUMBER,  /* double within low..high */
    CLI_BYTES,   /* uint64_t; suffixes K M G T are powers of 1024 */
    CLI_CHOICE,  /* const char *: one of the words of `value`, which separates them by | */
} cli_kind;

typedef struct {
    const char *name; /* without its dashes */
    char letter;      /* short form, 0 if none */
    cli_kind kind;
    size_t offset;     /* of the field in the command's settings; the field has the type named at `kind` */
    const char *value; /* what the help calls the value; the choices of a CLI_CHOICE */
    const char *help;
    double low, high; /* accepted range of CLI_INTEGER and CLI_NUMBER */
} cli_option;

enum { CLI_OPERANDS_MAX = 4 };

typedef struct {
    const char *operand[CLI_OPERANDS_MAX]; /* borrowed from argv */
    int count;
} cli_operands;

/* Fills `settings` (a struct holding the defaults) and `operands`; requires low..high operands. On false the
 * error and a hint are on standard error and the command is to end with CLI_USAGE. */
bool cli_parse(const cli_command *command, int argc, char **argv, void *settings, cli_operands *operands,
               int low, int high);
/* Complains about the command line in the form of cli_parse's own errors and returns CLI_USAGE. */
int cli_usage_error(const cli_command *command, const char *format, ...)
    __attribute__((format(printf, 2, 3)));
/* Prints a command's help on standard output. */
void cli_command_help(const cli_command *command);
/* The word of `words` (n of them) nearest to `word` in edit distance, or NULL if none is near enough to
 * suggest. */
const char *cli_nearest(const char *word, const char *const *words, size_t n);

#endif
