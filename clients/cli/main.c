/* blockwright: the command line program. Finds the subcommand and hands it the rest of the line. */
#include <stdio.h>
#include <string.h>

#include "blockwright.h"
#include "command.h"

static const cli_command *const commands[] = {
    &cli_command_run,    &cli_command_sample, &cli_command_submit, &cli_command_watch, &cli_command_fetch,
    &cli_command_finish, &cli_command_cancel, &cli_command_retry,  &cli_command_rm,    &cli_command_pin,
    &cli_command_unpin,  &cli_command_ls,     &cli_command_log,    &cli_command_capabilities, &cli_command_show,
};
enum { COMMAND_COUNT = sizeof commands / sizeof *commands };

static void print_help(FILE *stream) {
    fprintf(stream, "Usage: blockwright COMMAND ...\n\n"
                    "Decomposes a tet mesh with a seamless parametrization into cuboid blocks, and makes hex meshes of them.\n\n"
                    "Commands:\n");
    for (size_t i = 0; i < COMMAND_COUNT; i++)
        fprintf(stream, "  %-12s %s\n", commands[i]->name, commands[i]->summary);
    fprintf(
        stream,
        "  help         explain a command\n\n"
        "run, sample and show work in place; the others talk to a daemon (blockwrightd), whose address is\n"
        "--server URL, or the environment's BLOCKWRIGHT_SERVER, or http://127.0.0.1:8080. A daemon that wants an access\n"
        "token gets the environment's BLOCKWRIGHT_TOKEN, or the first line of --token-file FILE.\n\n"
        "Start here:\n"
        "  blockwright sample part -o part.hexex       make a parametrized part to play with\n"
        "  blockwright run part.hexex --out result     decompose it; see result/report.json\n"
        "  blockwright run part.hexex --out result --quantize any --target-hexes 5000     and a hex mesh\n"
        "  blockwright help run                        what else 'run' can do\n\n"
        "Exit codes: 0 done, 2 usage, 3 bad input, 4 limit reached or cancelled, 5 internal.\n");
}

static const cli_command *find_command(const char *name) {
    for (size_t i = 0; i < COMMAND_COUNT; i++)
        if (!strcmp(commands[i]->name, name)) return commands[i];
    return NULL;
}

static int unknown_command(const char *name) {
    const char *names[COMMAND_COUNT];
    for (size_t i = 0; i < COMMAND_COUNT; i++) names[i] = commands[i]->name;
    const char *near = cli_nearest(name, names, COMMAND_COUNT);
    fprintf(stderr, "blockwright: there is no command '%s'", name);
    if (near) fprintf(stderr, "; did you mean '%s'?", near);
    fprintf(stderr, "\nTry 'blockwright --help'.\n");
    return CLI_USAGE;
}

static int help(const char *name) {
    if (!name) {
        print_help(stdout);
        return CLI_DONE;
    }
    const cli_command *command = find_command(name);
    if (!command) return unknown_command(name);
    cli_command_help(command);
    return CLI_DONE;
}

static bool asks_for_help(int argc, char **argv) {
    for (int i = 0; i < argc && strcmp(argv[i], "--"); i++)
        if (!strcmp(argv[i], "--help") || !strcmp(argv[i], "-h")) return true;
    return false;
}

static int dispatch(int argc, char **argv) {
    if (argc < 2) {
        print_help(stderr);
        return CLI_USAGE;
    }
    const char *word = argv[1];
    if (!strcmp(word, "--version")) {
        printf("blockwright %s\n", bw_version());
        return CLI_DONE;
    }
    if (!strcmp(word, "--help") || !strcmp(word, "-h")) return help(NULL);
    if (!strcmp(word, "help")) return help(argc > 2 ? argv[2] : NULL);
    if (word[0] == '-') {
        fprintf(stderr, "blockwright: unknown option '%s' before a command\nTry 'blockwright --help'.\n",
                word);
        return CLI_USAGE;
    }
    const cli_command *command = find_command(word);
    if (!command) return unknown_command(word);
    if (asks_for_help(argc - 2, argv + 2)) {
        cli_command_help(command);
        return CLI_DONE;
    }
    return command->run(command, argc - 2, argv + 2);
}

int main(int argc, char **argv) {
    int code = dispatch(argc, argv);
    if ((fflush(stdout) != 0 || ferror(stdout)) && code == CLI_DONE) {
        fprintf(stderr, "blockwright: standard output could not be written\n");
        return CLI_INTERNAL;
    }
    return code;
}
