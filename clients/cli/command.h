/* What a subcommand of `blockwright` is: a name, its help, its options and the function that carries it out.
 *
 * One file per subcommand (run.c, sample.c, submit.c, ...), each defining one cli_command; main.c lists them
 * all. To add one: write its file, declare it below, add it to the table in main.c, describe it in
 * tests/clients.
 *
 * Results go to standard output; progress, notes and errors go to standard error. A command that failed has
 * said why.
 */
#ifndef BW_CLI_COMMAND_H
#define BW_CLI_COMMAND_H

#include "args.h"

/* Exit codes, the same for every subcommand (those of core/base/status.def). */
enum {
    CLI_DONE = 0,
    CLI_USAGE = 2,    /* the command line or a request is not understood */
    CLI_INPUT = 3,    /* the input is at fault, or what was asked for does not exist */
    CLI_LIMIT = 4,    /* a limit was reached, or the job was cancelled */
    CLI_INTERNAL = 5, /* anything that is not the caller's fault: input and output, network, a failed check */
};

struct cli_command {
    const char *name;
    const char *synopsis; /* operands and the most used options, as the usage line shows them */
    const char *summary;  /* one line for the list of commands */
    const char *about;    /* paragraphs for its help, lines at most 100 wide */
    const char *examples; /* lines, each starting with two spaces */
    const cli_option *options;
    size_t option_count;
    /* argv: what follows the command's name. Returns the exit code. */
    int (*run)(const cli_command *self, int argc, char **argv);
};

extern const cli_command cli_command_run, cli_command_sample, cli_command_show;
extern const cli_command cli_command_submit, cli_command_watch, cli_command_fetch;
extern const cli_command cli_command_finish, cli_command_cancel, cli_command_ls, cli_command_log;
extern const cli_command cli_command_retry, cli_command_rm, cli_command_pin, cli_command_unpin, cli_command_capabilities;

#endif
