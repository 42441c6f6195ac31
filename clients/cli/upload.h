/* Bringing a file to a daemon: only if it has not got it, and on from where it was when a connection breaks. */
#ifndef BW_CLI_UPLOAD_H
#define BW_CLI_UPLOAD_H

#include "hash.h"
#include "http.h"

/* Makes sure that the daemon has the file `name`; `hash` receives its name there. A large file goes as an upload that can be
 * resumed (tus), if the daemon takes one, else as one PUT. Returns an exit code; errors are on standard error. */
int cli_upload(cli_http *http, const char *name, bool quiet, char hash[CLI_HASH_TEXT]);

#endif
