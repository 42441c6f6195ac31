#include "format/sizes_svg.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "format/output.h"

enum { WIDTH = 360, HEIGHT = 230, LEFT = 64, RIGHT = 16, TOP = 34, BOTTOM = 46, CHARTS = 4, TICKS = 4 };

typedef struct {
    const char *title;
    double value[BW_REPORT_SWEEP];
    bool logarithmic, relative; /* relative to the scale: not for scale 0 */
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

static double height(const chart *c, double value, double low, double high) {
    double at = c->logarithmic ? log10(fmax(value, 1)) : value;
    return HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * (at - low) / (high - low);
}

static void put_axes(writer *w, const chart *c, double low, double high) {
    put(w, "<text x=\"%d\" y=\"20\" class=\"title\">%s</text>\n", LEFT, c->title);
    for (int t = 0; t <= TICKS; t++) {
        double at = low + (high - low) * t / TICKS, value = c->logarithmic ? pow(10, at) : at;
        double y = height(c, value, low, high);
        put(w, "<line x1=\"%d\" y1=\"%.2f\" x2=\"%d\" y2=\"%.2f\" class=\"grid\"/><text x=\"%d\" y=\"%.2f\" class=\"y\">%.3g</text>\n", LEFT, y,
            WIDTH - RIGHT, y, LEFT - 6, y + 4, value);
    }
    size_t every = 1 + w->count / 10;
    for (size_t i = 0; i < w->count; i += every)
        put(w, "<text x=\"%.2f\" y=\"%d\" class=\"x\">%.4g</text>\n", place(w, i), HEIGHT - BOTTOM + 16, w->row[i]->scale);
    put(w, "<text x=\"%d\" y=\"%d\" class=\"x\">scale</text>\n", (LEFT + WIDTH - RIGHT) / 2, HEIGHT - 8);
}

static void put_chart(writer *w, const chart *c, int at) {
    double high = 0;
    for (size_t i = 0; i < w->count; i++) high = fmax(high, c->logarithmic ? log10(fmax(c->value[i], 1)) : c->value[i]);
    if (high <= 0) high = 1;
    put(w, "<g transform=\"translate(%d %d)\">\n", at % 2 * WIDTH, at / 2 * HEIGHT);
    put_axes(w, c, 0, high);
    bw_put_text(&w->out, "<polyline class=\"line\" points=\"");
    size_t first = 0;
    while (c->relative && first < w->count && w->row[first]->scale <= 0) first++;
    for (size_t i = first; i < w->count; i++) put(w, "%.2f,%.2f ", place(w, i), height(c, c->value[i], 0, high));
    bw_put_text(&w->out, "\"/>\n");
    for (size_t i = first; i < w->count; i++)
        put(w, "<circle cx=\"%.2f\" cy=\"%.2f\" r=\"3\" class=\"%s\"><title>scale %.6g: %.6g</title></circle>\n", place(w, i),
            height(c, c->value[i], 0, high), strcmp(w->row[i]->status, "optimal") ? "open" : "full", w->row[i]->scale, c->value[i]);
    bw_put_text(&w->out, "</g>\n");
}

bw_status bw_sizes_write(bw_context *ctx, const bw_report *report, const char *path, uint64_t *bytes) {
    static const char style[] = "<style>text{font:11px sans-serif;fill:#333}.title{font-size:13px;font-weight:bold}.y{text-anchor:end}.x{text-anchor:middle}"
                                ".grid{stroke:#ddd}.line{fill:none;stroke:#2563a8;stroke-width:1.5}.full{fill:#2563a8}"
                                ".open{fill:#fff;stroke:#2563a8}</style>\n";
    writer w = {.count = report->sweep_count};
    chart charts[CHARTS] = {{.title = "hexes", .logarithmic = true}, {.title = "objective"}, {.title = "arcs of length 0"}, {.title = "distortion", .relative = true}};
    for (size_t i = 0; i < w.count; i++) w.row[i] = &report->sweep[i];
    qsort(w.row, w.count, sizeof *w.row, by_scale);
    for (size_t i = 0; i < w.count; i++) {
        charts[0].value[i] = (double)w.row[i]->hexes, charts[1].value[i] = w.row[i]->objective;
        charts[2].value[i] = (double)w.row[i]->zero_arcs, charts[3].value[i] = w.row[i]->distortion;
    }
    bw_output_open(ctx, &w.out, path);
    put(&w, "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 %d %d\" width=\"%d\" height=\"%d\">\n", 2 * WIDTH, 2 * HEIGHT, 2 * WIDTH,
        2 * HEIGHT);
    bw_put_text(&w.out, style);
    put(&w, "<rect width=\"%d\" height=\"%d\" fill=\"#fff\"/>\n", 2 * WIDTH, 2 * HEIGHT);
    for (int i = 0; i < CHARTS; i++) put_chart(&w, &charts[i], i);
    bw_put_text(&w.out, "</svg>\n");
    return bw_output_close(&w.out, bytes);
}
