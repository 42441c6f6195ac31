/* Commands of blockwrightd other than serve. Each takes the words from its name on and returns the exit code. */
#ifndef BW_SERVER_COMMANDS_H
#define BW_SERVER_COMMANDS_H

int bw_command_token(int argc, char **argv); /* token create, list, revoke */
int bw_command_gc(int argc, char **argv);
int bw_command_backup(int argc, char **argv);
int bw_command_restore(int argc, char **argv);

int bw_command_owner(int argc, char **argv); /* owner set, list */

#endif
