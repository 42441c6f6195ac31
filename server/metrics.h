/* What the daemon counts of itself, for GET /metrics in the text format of Prometheus (0.0.4).
 *
 * A metric is a row of the table in metrics.c; its series (one per combination of label values, which are known beforehand) are atomic
 * numbers in one block, so counting takes no lock and never fails. Names follow Prometheus' conventions: base units (seconds,
 * bytes), counters end in _total.
 *
 * How to add a metric: an enumerator here, a row in metrics.c in the same order, and bw_count, bw_gauge or bw_observe where it happens.
 * README.md (server) lists them; a test holds the list, deploy/grafana.json and the table together.
 */
#ifndef BW_SERVER_METRICS_H
#define BW_SERVER_METRICS_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

typedef enum {
    BW_METRIC_BUILD,            /* by nothing; always 1, its label is the version */
    BW_METRIC_READY,            /* 1 or 0 */
    BW_METRIC_JOBS,             /* by state: waiting, running, ended */
    BW_METRIC_QUEUE_AGE,        /* ms of the oldest job that no stage has begun of */
    BW_METRIC_QUEUE_WAIT,       /* ms from acceptance to a job's first worker */
    BW_METRIC_JOBS_ACCEPTED,
    BW_METRIC_JOBS_ENDED,       /* by bw_job_state - BW_JOB_SUCCESSFUL */
    BW_METRIC_CLAIMS,           /* by stage */
    BW_METRIC_FAILURES,         /* by bw_problem: failed attempts, also those that are tried again */
    BW_METRIC_STAGE_SECONDS,    /* by stage, in ms */
    BW_METRIC_STAGE_CPU,        /* by stage, in ms */
    BW_METRIC_STAGE_PEAK,       /* by stage, in bytes */
    BW_METRIC_CACHE_HITS,       /* by stage */
    BW_METRIC_CACHE_MISSES,     /* by stage */
    BW_METRIC_CACHE_BYTES,      /* written */
    BW_METRIC_CACHE_SIZE,       /* bytes of all outputs */
    BW_METRIC_COLLECTED,        /* by bw_keep_kind */
    BW_METRIC_COLLECTED_BYTES,  /* by bw_keep_kind: outputs and blobs */
    BW_METRIC_UPLOAD_BYTES,     /* received */
    BW_METRIC_REQUESTS,         /* by bw_op (BW_OP_COUNT: none), by class: status / 100 - 1 */
    BW_METRIC_REQUEST_SECONDS,  /* by bw_op, in us */
    BW_METRIC_REPLY_BYTES,
    BW_METRIC_REQUESTS_ACTIVE,
    BW_METRIC_CONNECTIONS,
    BW_METRIC_STREAMS,
    BW_METRIC_FSYNC_SECONDS,    /* in us */
    BW_METRIC_COMMIT_SECONDS,   /* in us */
    BW_METRIC_WRITES_WAITING,   /* for the next commit */
    BW_METRIC_WAL_BYTES,
    BW_METRIC_DISK_FREE,        /* bytes */
    BW_METRIC_WORKERS,          /* most at the same time */
    BW_METRIC_PROCESS_CPU,      /* ms */
    BW_METRIC_PROCESS_MEMORY,   /* bytes */
    BW_METRIC_PROCESS_FILES,
    BW_METRIC_PROCESS_FILES_MOST,
    BW_METRIC_PROCESS_START,    /* ms since 1970 */
    BW_METRIC_COUNT
} bw_metric;

typedef enum { BW_COUNTER, BW_GAUGE, BW_HISTOGRAM } bw_metric_kind;

/* `first` and `second` are the indexes of the labels' values, 0 for a label the metric has not. */
void bw_count(bw_metric metric, int first, int second, uint64_t more); /* a counter, or a gauge that goes up */
void bw_gauge(bw_metric metric, int first, int64_t value);
void bw_gauge_add(bw_metric metric, int first, int64_t change);
void bw_observe(bw_metric metric, int first, int64_t value); /* a histogram; in the unit told above */
int64_t bw_metric_value(bw_metric metric, int first, int second); /* a counter or gauge; a histogram: how many observed */

const char *bw_metric_name(bw_metric metric);
bw_metric_kind bw_metric_kind_of(bw_metric metric);
/* Reads what the kernel knows of this process into the PROCESS metrics. */
void bw_metrics_read_process(void);
void bw_metrics_write(FILE *to);

#endif
