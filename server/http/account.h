/* What is counted and logged of every request when it ends. */
#ifndef BW_SERVER_HTTP_ACCOUNT_H
#define BW_SERVER_HTTP_ACCOUNT_H

#include "server/http/request.h"

/* `cut`: the connection ended before the answer did. */
void bw_request_account(const bw_request *request, bool cut);

#endif
