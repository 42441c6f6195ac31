#include "terminal.h"

#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <time.h>
#include <unistd.h>

static const double redraw_seconds = 0.05;

double cli_now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

void cli_pause(double seconds) {
    struct timespec t = {(time_t)seconds, (long)((seconds - (double)(time_t)seconds) * 1e9)};
    nanosleep(&t, NULL);
}

const char *cli_bytes(char text[24], uint64_t bytes) {
    static const char *const units[] = {"kB", "MB", "GB", "TB"};
    if (bytes < 1000) {
        snprintf(text, 24, "%u B", (unsigned)bytes);
        return text;
    }
    double value = (double)bytes / 1000;
    size_t unit = 0;
    while (value >= 999.95 && unit + 1 < sizeof units / sizeof *units) {
        value /= 1000;
        unit++;
    }
    snprintf(text, 24, "%.1f %s", value, units[unit]);
    return text;
}

const char *cli_seconds(char text[24], double seconds) {
    if (seconds < 0) seconds = 0;
    if (seconds < 60)
        snprintf(text, 24, "%.2f s", seconds);
    else if (seconds < 3600)
        snprintf(text, 24, "%d min %02d s", (int)seconds / 60, (int)seconds % 60);
    else
        snprintf(text, 24, "%.1f h", seconds / 3600);
    return text;
}

/* Bytes at `text` that steer a terminal: 1 for a C0 control or DEL, 2 for a C1 control in UTF-8, else 0. */
static size_t control_length(const char *text, size_t left) {
    unsigned char c = (unsigned char)*text;
    if (c < 32 || c == 127) return 1;
    return c == 0xc2 && left > 1 && ((unsigned char)text[1] & 0xe0) == 0x80 ? 2 : 0;
}

void cli_print_lines(FILE *stream, const char *text, size_t size) {
    for (size_t i = 0; i < size; i++) {
        size_t control = text[i] == '\n' || text[i] == '\t' ? 0 : control_length(text + i, size - i);
        fputc(control ? '?' : text[i], stream);
        if (control) i += control - 1;
    }
}

void cli_print_safe(FILE *stream, const char *text) {
    size_t size = strlen(text);
    for (size_t i = 0; i < size; i++) {
        size_t control = control_length(text + i, size - i);
        fputc(!control ? text[i] : text[i] == '\n' || text[i] == '\t' ? ' ' : '?', stream);
        if (control) i += control - 1;
    }
}

const char *cli_safe(char *out, size_t size, const char *text) {
    size_t left = strlen(text), n = 0;
    while (left > 0 && n + 1 < size) {
        size_t control = control_length(text, left), step = control ? control : 1;
        out[n++] = !control ? *text : *text == '\n' || *text == '\t' ? ' ' : '?';
        text += step, left -= step;
    }
    out[n] = 0;
    return out;
}

void cli_error(const char *format, ...) {
    char text[1024];
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    fputs("blockwright: ", stderr);
    cli_print_safe(stderr, text);
    fputc('\n', stderr);
}

void cli_progress_open(cli_progress *p, bool quiet) {
    const char *term = getenv("TERM");
    memset(p, 0, sizeof *p);
    p->quiet = quiet;
    p->tty = isatty(STDERR_FILENO) && !(term && !strcmp(term, "dumb"));
    p->started = cli_now();
    p->drawn = -1;
    p->percent = -1;
}

static int columns(void) {
    struct winsize size;
    if (ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0) return size.ws_col;
    return 80;
}

static void draw(const cli_progress *p) {
    enum { BAR_MAX = 40 };
    char bar[BAR_MAX + 1], elapsed[24];
    int room = columns() - 40, width = room > BAR_MAX ? BAR_MAX : room;
    if (width < 0) width = 0;
    int full = width * p->percent / 100;
    for (int i = 0; i < width; i++) bar[i] = i < full ? '#' : '.';
    bar[width] = 0;
    fprintf(stderr, "\r\033[K%-13.13s [%s] %3d %%  %s", p->stage, bar, p->percent,
            cli_seconds(elapsed, cli_now() - p->started));
    fflush(stderr);
}

void cli_progress_show(cli_progress *p, const char *stage, double fraction) {
    if (p->quiet) return;
    int percent = fraction <= 0 ? 0 : fraction >= 1 ? 100 : (int)(fraction * 100);
    char safe[sizeof p->stage];
    bool new_stage = strcmp(p->stage, cli_safe(safe, sizeof safe, stage)) != 0;
    if (new_stage) memcpy(p->stage, safe, sizeof safe);
    if (!p->tty) {
        if (new_stage) fprintf(stderr, "[%8.2f s] %s\n", cli_now() - p->started, p->stage);
        return;
    }
    if (!new_stage && (percent == p->percent || cli_now() - p->drawn < redraw_seconds)) return;
    p->percent = percent;
    p->drawn = cli_now();
    draw(p);
}

void cli_progress_clear(cli_progress *p) {
    if (p->quiet || !p->tty || p->drawn < 0) return;
    fputs("\r\033[K", stderr);
    fflush(stderr);
    p->drawn = -1;
    p->percent = -1;
}
