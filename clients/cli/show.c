/* blockwright show: the summary of a result, as `run` and `fetch` end with. */
#include <stdio.h>

#include "command.h"
#include "summary.h"

static int run(const cli_command *self, int argc, char **argv) {
    cli_operands operands;
    if (!cli_parse(self, argc, argv, NULL, &operands, 1, 1)) return CLI_USAGE;
    json_t *report = cli_report_load(operands.operand[0]);
    if (!report) return CLI_INTERNAL;
    cli_summary_print(report);
    cli_files_print(operands.operand[0], 0);
    json_decref(report);
    return CLI_DONE;
}

const cli_command cli_command_show = {
    .name = "show",
    .synopsis = "DIR",
    .summary = "sum up a folder of results",
    .about = "Prints what the report.json in DIR says of the input, the complex, its quality and the\n"
             "stages, and the files that are there.",
    .examples = "  blockwright show result",
    .run = run,
};
