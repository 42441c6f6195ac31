#include "format/sizes_svg.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "format/output.h"

enum { WIDTH = 360, HEIGHT = 230, LEFT = 64, RIGHT = 16, TOP = 34, BOTTOM = 46, NOTE = 24, CHARTS = 4, TICKS = 5 };

typedef struct {
    const char *title;
    double value[BW_REPORT_SWEEP];
    bool logarithmic, whole, relative; /* whole numbers; relative to the scale: not for scale 0 */
} chart;

typedef struct {
    bw_output out;
    const bw_report_sweep *row[BW_REPORT_SWEEP]; /* by scale */
    size_t count;
} writer;

static void put(writer *w, const char *format, ...) __attribute__((format(printf, 2, 3)));

static void put(writer *w, const char *format, ...) {
    char text[400];
    va_list list;
    va_start(list, format);
    vsnprintf(text, sizeof text, format, list);
    va_end(list);
    bw_put_text(&w->out, text);
}

static int by_scale(const void *a, const void *b) {
    const bw_report_sweep *x = *(const bw_report_sweep *const *)a, *y = *(const bw_report_sweep *const *)b;
    if (x->scale != y->scale) return x->scale < y->scale ? -1 : 1;
    return (x > y) - (x < y);
}

static double place(const writer *w, size_t i) {
    double room = WIDTH - LEFT - RIGHT;
    return LEFT + (w->count > 1 ? room * (double)i / (double)(w->count - 1) : room / 2);
}

/* What the axis shows: the value, or its logarithm. */
static double shown(const chart *c, double value) { return c->logarithmic ? log10(fmax(value, 1)) : value; }

static double height(const chart *c, double value, double top) {
    return HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * shown(c, value) / top;
}

/* The smallest of 1, 2, 5, 10, 20, ... (for fractions 0.1, 0.2, ...) that comes to `most` in TICKS steps; whole powers of ten on a logarithmic axis. */
static double tick_step(const chart *c, double most) {
    double step = c->logarithmic ? 1 : pow(10, floor(log10(most / TICKS)));
    for (int i = 0; step * TICKS < most * (1 - 1e-9); i++) step *= c->logarithmic ? (step + 1) / step : i % 3 == 1 ? 2.5 : 2;
    return c->whole ? fmax(step, 1) : step;
}

static void put_axes(writer *w, const chart *c, double step, int ticks) {
    put(w, "<text x=\"%d\" y=\"20\" class=\"title\">%s</text>\n", LEFT, c->title);
    for (int t = 0; t <= ticks; t++) {
        double y = HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * (double)t / ticks, value = c->logarithmic ? pow(10, t * step) : t * step;
        put(w, "<line x1=\"%d\" y1=\"%.2f\" x2=\"%d\" y2=\"%.2f\" class=\"grid\"/><text x=\"%d\" y=\"%.2f\" class=\"y\">%.5g</text>\n", LEFT, y,
            WIDTH - RIGHT, y, LEFT - 6, y + 4, value);
    }
    size_t every = 1 + w->count / 10;
    for (size_t i = 0; i < w->count; i += every)
        put(w, "<text x=\"%.2f\" y=\"%d\" class=\"x\">%.4g</text>\n", place(w, i), HEIGHT - BOTTOM + 16, w->row[i]->scale);
    put(w, "<text x=\"%d\" y=\"%d\" class=\"x\">scale</text>\n", (LEFT + WIDTH - RIGHT) / 2, HEIGHT - 8);
}

static void put_chart(writer *w, const chart *c, int at) {
    double high = 0;
    for (size_t i = 0; i < w->count; i++) high = fmax(high, shown(c, c->value[i]));
    double step = tick_step(c, high > 0 ? high : 1);
    int ticks = (int)fmax(ceil(high / step - 1e-9), 1);
    high = step * ticks;
    put(w, "<g transform=\"translate(%d %d)\">\n", at % 2 * WIDTH, at / 2 * HEIGHT);
    put_axes(w, c, step, ticks);
    bw_put_text(&w->out, "<polyline class=\"line\" points=\"");
    size_t first = 0;
    while (c->relative && first < w->count && w->row[first]->scale <= 0) first++;
    for (size_t i = first; i < w->count; i++) put(w, "%.2f,%.2f ", place(w, i), height(c, c->value[i], high));
    bw_put_text(&w->out, "\"/>\n");
    for (size_t i = first; i < w->count; i++)
        put(w, "<circle cx=\"%.2f\" cy=\"%.2f\" r=\"3\" class=\"%s\"><title>scale %.6g: %.6g</title></circle>\n", place(w, i),
            height(c, c->value[i], high), strcmp(w->row[i]->status, "optimal") ? "open" : "full", w->row[i]->scale, c->value[i]);
    bw_put_text(&w->out, "</g>\n");
}

bw_status bw_sizes_write(bw_context *ctx, const bw_report *report, const char *path, uint64_t *bytes) {
    static const char style[] = "<style>text{font:11px sans-serif;fill:#333}.title{font-size:13px;font-weight:bold}.y{text-anchor:end}.x{text-anchor:middle}"
                                ".grid{stroke:#ddd}.line{fill:none;stroke:#2563a8;stroke-width:1.5}.full{fill:#2563a8}"
                                ".open{fill:#fff;stroke:#2563a8}</style>\n";
    writer w = {.count = report->sweep_count};
    chart charts[CHARTS] = {{.title = "hexes", .logarithmic = true}, {.title = "objective"}, {.title = "arcs of length 0", .whole = true}, {.title = "distortion", .relative = true}};
    for (size_t i = 0; i < w.count; i++) w.row[i] = &report->sweep[i];
    qsort(w.row, w.count, sizeof *w.row, by_scale);
    for (size_t i = 0; i < w.count; i++) {
        charts[0].value[i] = (double)w.row[i]->hexes, charts[1].value[i] = w.row[i]->objective;
        charts[2].value[i] = (double)w.row[i]->zero_arcs, charts[3].value[i] = w.row[i]->distortion;
    }
    bw_output_open(ctx, &w.out, path);
    put(&w, "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 %d %d\" width=\"%d\" height=\"%d\">\n", 2 * WIDTH, 2 * HEIGHT + NOTE, 2 * WIDTH,
        2 * HEIGHT + NOTE);
    bw_put_text(&w.out, style);
    put(&w, "<rect width=\"%d\" height=\"%d\" fill=\"#fff\"/>\n", 2 * WIDTH, 2 * HEIGHT + NOTE);
    for (int i = 0; i < CHARTS; i++) put_chart(&w, &charts[i], i);
    put(&w, "<text x=\"%d\" y=\"%d\">filled: proven optimal; hollow: may be better; scale 0: the coarsest</text>\n</svg>\n", LEFT, 2 * HEIGHT + NOTE / 2);
    return bw_output_close(&w.out, bytes);
}
