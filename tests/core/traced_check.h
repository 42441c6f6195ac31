/* An independent check of a traced mesh: reads the text of the file and decides everything in rational
 * arithmetic (GMP), with nothing of the core in use.
 *
 *   positive    every tet has a positive parametric volume (negative throughout, if the file is mirrored)
 *   conforming  no facet has more than two tets, no tet repeats a vertex
 *   seamless    every interior facet is carried over by one of the 24 rotations and a translation
 *   walls       every wall is a facet, listed once, constant in one parameter; every boundary facet is a wall
 *   blocks      the tets between walls, laid out in one chart, close up and fill their bounding box exactly
 */
#ifndef BW_TESTS_CORE_TRACED_CHECK_H
#define BW_TESTS_CORE_TRACED_CHECK_H

#include <gmp.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    size_t vertices, tets, walls, feature_vertices, feature_edges, feature_facets, blocks, boundary;
    double boundary_area, volume; /* in space */
    bool mirrored;
    size_t not_positive, not_conforming, not_seamless, stray_walls, not_aligned, open_boundary, twisted,
        not_cuboid, not_canonical;
} traced_verdict;

static inline size_t traced_faults(const traced_verdict *v) {
    return v->not_positive + v->not_conforming + v->not_seamless + v->stray_walls + v->not_aligned +
           v->open_boundary + v->twisted + v->not_cuboid + v->not_canonical;
}

typedef struct {
    int v[3], tet, corner[3]; /* v ascending; corner: where they are in the tet */
    bool wall;
} traced_facet;

typedef struct {
    double (*x)[3];
    int (*tet)[4];
    mpq_t (*u)[4][3];
    traced_facet *facet;
    int (*wall)[3];
    int (*feature_edge)[2], (*feature_facet)[3], *feature_vertex;
    int (*across)[4]; /* [tet][corner opposite]: the tet there, if no wall is between; -1 */
    traced_verdict *out;
} traced_mesh;

static int traced_turn[24][3][2]; /* [rotation][axis]: axis it comes from, sign */

static inline void traced_make_turns(void) {
    int n = 0;
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++)
            for (int signs = 0; a != b && signs < 8; signs++) {
                int c = 3 - a - b, s[3] = {signs & 1 ? -1 : 1, signs & 2 ? -1 : 1, signs & 4 ? -1 : 1};
                int even = (b - a + 3) % 3 == 1 ? 1 : -1;
                if (even * s[0] * s[1] * s[2] < 0) continue;
                int from[3] = {a, b, c};
                for (int k = 0; k < 3; k++) traced_turn[n][k][0] = from[k], traced_turn[n][k][1] = s[k];
                n++;
            }
}

static inline bool traced_number(const char *token, mpq_t q) {
    if (mpq_set_str(q, token, 10)) return false;
    mpq_t canonical;
    mpq_init(canonical);
    mpq_set(canonical, q);
    mpq_canonicalize(canonical);
    char *text = mpq_get_str(NULL, 10, canonical);
    bool same = !strcmp(text, token);
    free(text);
    mpq_set(q, canonical);
    mpq_clear(canonical);
    return same;
}

static inline int traced_compare_ints(const void *a, const void *b) {
    const int *x = a, *y = b;
    for (int k = 0; k < 3; k++)
        if (x[k] != y[k]) return x[k] < y[k] ? -1 : 1;
    return 0;
}
static inline void traced_sort3(int v[3]) {
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 2 - i; j++)
            if (v[j] > v[j + 1]) {
                int t = v[j];
                v[j] = v[j + 1], v[j + 1] = t;
            }
}

/* Reads the whole file; text is changed. Returns false if it is not written as traced.h says. */
static inline bool traced_parse(traced_mesh *m, char *text) {
    traced_verdict *o = m->out;
    char *state, *word = strtok_r(text, " \n", &state);
#define TRACED_NEXT (word = strtok_r(NULL, " \n", &state))
    o->vertices = word ? strtoul(word, NULL, 10) : 0;
    m->x = calloc(o->vertices + 1, sizeof *m->x);
    for (size_t i = 0; i < 3 * o->vertices; i++) {
        if (!TRACED_NEXT) return false;
        m->x[i / 3][i % 3] = strtod(word, NULL);
    }
    if (!TRACED_NEXT) return false;
    o->tets = strtoul(word, NULL, 10);
    m->tet = calloc(o->tets + 1, sizeof *m->tet);
    m->u = calloc(o->tets + 1, sizeof *m->u);
    for (size_t t = 0; t < o->tets; t++) {
        for (int i = 0; i < 4; i++) {
            if (!TRACED_NEXT) return false;
            m->tet[t][i] = atoi(word);
            if (m->tet[t][i] < 0 || (size_t)m->tet[t][i] >= o->vertices) return false;
        }
        for (int i = 0; i < 12; i++) {
            if (!TRACED_NEXT) return false;
            mpq_init(m->u[t][i / 3][i % 3]);
            o->not_canonical += !traced_number(word, m->u[t][i / 3][i % 3]);
        }
    }
    if (!TRACED_NEXT) return false;
    o->walls = strtoul(word, NULL, 10);
    m->wall = calloc(o->walls + 1, sizeof *m->wall);
    for (size_t i = 0; i < o->walls; i++) {
        for (int k = 0; k < 3; k++) {
            if (!TRACED_NEXT) return false;
            m->wall[i][k] = atoi(word);
        }
        traced_sort3(m->wall[i]);
        if (!TRACED_NEXT || !isfinite(strtod(word, NULL))) return false;
    }
    if (!TRACED_NEXT) return true;
    o->feature_vertices = strtoul(word, NULL, 10);
    o->feature_edges = TRACED_NEXT ? strtoul(word, NULL, 10) : 0;
    o->feature_facets = TRACED_NEXT ? strtoul(word, NULL, 10) : 0;
    m->feature_vertex = calloc(o->feature_vertices + 1, sizeof *m->feature_vertex);
    m->feature_edge = calloc(o->feature_edges + 1, sizeof *m->feature_edge);
    m->feature_facet = calloc(o->feature_facets + 1, sizeof *m->feature_facet);
    for (size_t i = 0; i < o->feature_vertices; i++) m->feature_vertex[i] = TRACED_NEXT ? atoi(word) : -1;
    for (size_t i = 0; i < 2 * o->feature_edges; i++)
        m->feature_edge[i / 2][i % 2] = TRACED_NEXT ? atoi(word) : -1;
    for (size_t i = 0; i < 3 * o->feature_facets; i++)
        m->feature_facet[i / 3][i % 3] = TRACED_NEXT ? atoi(word) : -1;
    return word && !TRACED_NEXT;
#undef TRACED_NEXT
}

static inline void traced_volume(traced_mesh *m, size_t t, mpq_t out) {
    mpq_t e[3][3], a, b;
    mpq_inits(a, b, NULL);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) mpq_init(e[i][k]), mpq_sub(e[i][k], m->u[t][i + 1][k], m->u[t][0][k]);
    mpq_set_ui(out, 0, 1);
    for (int k = 0; k < 3; k++) {
        int i = (k + 1) % 3, j = (k + 2) % 3;
        mpq_mul(a, e[1][i], e[2][j]);
        mpq_mul(b, e[1][j], e[2][i]);
        mpq_sub(a, a, b);
        mpq_mul(a, a, e[0][k]);
        mpq_add(out, out, a);
    }
    mpq_clears(a, b, NULL);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) mpq_clear(e[i][k]);
}

static inline void traced_rotate(int r, mpq_t in[3], mpq_t out[3]) {
    for (int k = 0; k < 3; k++) {
        mpq_set(out[k], in[traced_turn[r][k][0]]);
        if (traced_turn[r][k][1] < 0) mpq_neg(out[k], out[k]);
    }
}

/* The rotation that carries three points to three others; -1 if there is none. shift: what is left then. */
static inline int traced_transition(mpq_t *from[3], mpq_t *to[3], mpq_t shift[3]) {
    mpq_t d[2][3], e[2][3], w[3];
    int found = -1;
    for (int k = 0; k < 3; k++) {
        mpq_init(w[k]);
        for (int i = 0; i < 2; i++) {
            mpq_inits(d[i][k], e[i][k], NULL);
            mpq_sub(d[i][k], from[i + 1][k], from[0][k]);
            mpq_sub(e[i][k], to[i + 1][k], to[0][k]);
        }
    }
    for (int r = 0; r < 24 && found < 0; r++) {
        bool same = true;
        for (int i = 0; i < 2 && same; i++) {
            traced_rotate(r, d[i], w);
            for (int k = 0; k < 3; k++) same = same && mpq_equal(w[k], e[i][k]);
        }
        if (same) found = r;
    }
    if (found >= 0) {
        traced_rotate(found, from[0], w);
        for (int k = 0; k < 3; k++) mpq_sub(shift[k], to[0][k], w[k]);
    }
    for (int k = 0; k < 3; k++) mpq_clears(d[0][k], d[1][k], e[0][k], e[1][k], w[k], NULL);
    return found;
}

static inline bool traced_aligned(traced_mesh *m, const traced_facet *f) {
    for (int k = 0; k < 3; k++)
        if (mpq_equal(m->u[f->tet][f->corner[0]][k], m->u[f->tet][f->corner[1]][k]) &&
            mpq_equal(m->u[f->tet][f->corner[0]][k], m->u[f->tet][f->corner[2]][k]))
            return true;
    return false;
}

static inline double traced_area(const traced_mesh *m, const int v[3]) {
    double a[3], b[3], n[3];
    for (int k = 0; k < 3; k++) a[k] = m->x[v[1]][k] - m->x[v[0]][k], b[k] = m->x[v[2]][k] - m->x[v[0]][k];
    for (int k = 0; k < 3; k++) n[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
    return sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]) / 2;
}

static inline void traced_list_facets(traced_mesh *m) {
    m->facet = calloc(4 * m->out->tets + 1, sizeof *m->facet);
    for (size_t t = 0; t < m->out->tets; t++)
        for (int i = 0; i < 4; i++) {
            traced_facet *f = &m->facet[4 * t + (size_t)i];
            f->tet = (int)t;
            for (int j = 0, n = 0; j < 4; j++)
                if (j != i) f->v[n++] = m->tet[t][j];
            traced_sort3(f->v);
            for (int k = 0; k < 3; k++)
                for (int j = 0; j < 4; j++)
                    if (m->tet[t][j] == f->v[k]) f->corner[k] = j;
            if (f->v[0] == f->v[1] || f->v[1] == f->v[2]) m->out->not_conforming++;
        }
    qsort(m->facet, 4 * m->out->tets, sizeof *m->facet, traced_compare_ints);
}

static inline void traced_link(traced_mesh *m, const traced_facet *a, const traced_facet *b) {
    mpq_t shift[3], *from[3], *to[3];
    mpq_inits(shift[0], shift[1], shift[2], NULL);
    for (int i = 0; i < 3; i++) from[i] = m->u[a->tet][a->corner[i]], to[i] = m->u[b->tet][b->corner[i]];
    if (traced_transition(from, to, shift) < 0) {
        m->out->not_seamless++;
    } else if (!a->wall) {
        m->across[a->tet][6 - a->corner[0] - a->corner[1] - a->corner[2]] = b->tet;
        m->across[b->tet][6 - b->corner[0] - b->corner[1] - b->corner[2]] = a->tet;
    }
    mpq_clears(shift[0], shift[1], shift[2], NULL);
}

static inline void traced_check_facets(traced_mesh *m) {
    traced_verdict *o = m->out;
    size_t n = 4 * o->tets, w = 0;
    qsort(m->wall, o->walls, sizeof *m->wall, traced_compare_ints);
    for (size_t i = 0, j; i < n; i = j) {
        for (j = i; j < n && !traced_compare_ints(&m->facet[i], &m->facet[j]); j++) {
        }
        for (; w < o->walls && traced_compare_ints(m->wall[w], &m->facet[i]) < 0; w++) o->stray_walls++;
        bool wall = w < o->walls && !traced_compare_ints(m->wall[w], &m->facet[i]);
        w += wall;
        if (j - i > 2) o->not_conforming++;
        if (wall && !traced_aligned(m, &m->facet[i])) o->not_aligned++;
        for (size_t k = i; k < j; k++) m->facet[k].wall = wall;
        if (j - i == 1) {
            o->boundary++;
            o->boundary_area += traced_area(m, m->facet[i].v);
            o->open_boundary += !wall;
        } else if (j - i == 2) {
            traced_link(m, &m->facet[i], &m->facet[i + 1]);
        }
    }
    o->stray_walls += o->walls - w; /* a wall listed twice is left over too */
}

/* Carries tet b into the chart of the root, next to tet a that is there already. False if it is there too,
 * but elsewhere. */
static inline bool traced_place(traced_mesh *m, size_t a, int opposite, size_t b, bool placed,
                                mpq_t (*at)[4][3]) {
    mpq_t shift[3], w[3], *from[3], *to[3];
    for (int k = 0; k < 3; k++) mpq_inits(shift[k], w[k], NULL);
    int n = 0;
    for (int p = 0; p < 4; p++)
        for (int q = 0; q < 4; q++)
            if (p != opposite && m->tet[a][p] == m->tet[b][q]) to[n] = at[a][p], from[n++] = m->u[b][q];
    int r = n == 3 ? traced_transition(from, to, shift) : -1;
    bool same = r >= 0;
    for (int p = 0; p < 4 && r >= 0; p++) {
        traced_rotate(r, m->u[b][p], w);
        for (int k = 0; k < 3; k++) {
            mpq_add(w[k], w[k], shift[k]);
            if (placed)
                same = same && mpq_equal(at[b][p][k], w[k]);
            else
                mpq_set(at[b][p][k], w[k]);
        }
    }
    for (int k = 0; k < 3; k++) mpq_clears(shift[k], w[k], NULL);
    return same;
}

/* One block: its tets laid out from `root`. at[t]: the corners of t in the chart of the root. */
static inline void traced_check_block(traced_mesh *m, size_t root, bool *seen, mpq_t (*at)[4][3],
                                      size_t *stack) {
    mpq_t low[3], high[3], sum, term;
    mpq_inits(sum, term, NULL);
    for (int k = 0; k < 3; k++) mpq_inits(low[k], high[k], NULL);
    for (int i = 0; i < 12; i++) mpq_set(at[root][i / 3][i % 3], m->u[root][i / 3][i % 3]);
    for (int k = 0; k < 3; k++) mpq_set(low[k], at[root][0][k]), mpq_set(high[k], at[root][0][k]);
    size_t top = 0;
    bool twisted = false;
    seen[root] = true;
    stack[top++] = root;
    while (top) {
        size_t a = stack[--top];
        traced_volume(m, a, term);
        mpq_add(sum, sum, term);
        for (int i = 0; i < 12; i++) {
            if (mpq_cmp(at[a][i / 3][i % 3], low[i % 3]) < 0) mpq_set(low[i % 3], at[a][i / 3][i % 3]);
            if (mpq_cmp(at[a][i / 3][i % 3], high[i % 3]) > 0) mpq_set(high[i % 3], at[a][i / 3][i % 3]);
        }
        for (int i = 0; i < 4; i++) {
            if (m->across[a][i] < 0) continue;
            size_t b = (size_t)m->across[a][i];
            if (!traced_place(m, a, i, b, seen[b], at)) twisted = true;
            if (!seen[b]) stack[top++] = b;
            seen[b] = true;
        }
    }
    mpq_set_si(term, m->out->mirrored ? -6 : 6, 1);
    for (int k = 0; k < 3; k++) {
        mpq_sub(high[k], high[k], low[k]);
        mpq_mul(term, term, high[k]);
    }
    m->out->twisted += twisted;
    m->out->not_cuboid += !twisted && !mpq_equal(term, sum);
    m->out->blocks++;
    mpq_clears(sum, term, NULL);
    for (int k = 0; k < 3; k++) mpq_clears(low[k], high[k], NULL);
}

static inline void traced_check_blocks(traced_mesh *m) {
    size_t n = m->out->tets;
    bool *seen = calloc(n + 1, 1);
    size_t *stack = calloc(n + 1, sizeof *stack);
    mpq_t(*at)[4][3] = calloc(n + 1, sizeof *at);
    for (size_t i = 0; i < 12 * n; i++) mpq_init(at[i / 12][i / 3 % 4][i % 3]);
    for (size_t t = 0; t < n; t++)
        if (!seen[t]) traced_check_block(m, t, seen, at, stack);
    for (size_t i = 0; i < 12 * n; i++) mpq_clear(at[i / 12][i / 3 % 4][i % 3]);
    free(seen), free(stack), free(at);
}

static inline void traced_check_volumes(traced_mesh *m) {
    size_t negative = 0, n = m->out->tets;
    int *sign = calloc(n + 1, sizeof *sign);
    mpq_t volume;
    mpq_init(volume);
    for (size_t t = 0; t < n; t++) {
        traced_volume(m, t, volume);
        sign[t] = mpq_sgn(volume);
        negative += sign[t] < 0;
        double e[3][3];
        for (int i = 0; i < 3; i++)
            for (int k = 0; k < 3; k++) e[i][k] = m->x[m->tet[t][i + 1]][k] - m->x[m->tet[t][0]][k];
        m->out->volume += (e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1]) -
                           e[0][1] * (e[1][0] * e[2][2] - e[1][2] * e[2][0]) +
                           e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0])) /
                          6;
    }
    m->out->mirrored = negative > n / 2;
    for (size_t t = 0; t < n; t++) m->out->not_positive += m->out->mirrored ? sign[t] >= 0 : sign[t] <= 0;
    mpq_clear(volume);
    free(sign);
}

/* Checks the text of a file (changed by this). False if it cannot be read at all. with_blocks: walls are
 * complete. */
static inline bool traced_check(char *text, bool with_blocks, traced_verdict *out) {
    traced_mesh m = {.out = out};
    memset(out, 0, sizeof *out);
    traced_make_turns();
    bool good = traced_parse(&m, text);
    if (good) {
        m.across = malloc((out->tets + 1) * sizeof *m.across);
        memset(m.across, -1, (out->tets + 1) * sizeof *m.across);
        traced_check_volumes(&m);
        traced_list_facets(&m);
        traced_check_facets(&m);
        if (with_blocks) traced_check_blocks(&m);
    }
    for (size_t i = 0; good && i < 12 * out->tets; i++) mpq_clear(m.u[i / 12][i / 3 % 4][i % 3]);
    free(m.x), free(m.tet), free(m.u), free(m.facet), free(m.wall), free(m.across);
    free(m.feature_edge), free(m.feature_facet), free(m.feature_vertex);
    return good;
}

static inline void traced_print(const char *what, const traced_verdict *v) {
    printf("%s: %zu tets, %zu walls, %zu blocks; faults: positive %zu conforming %zu seamless %zu stray %zu "
           "aligned %zu boundary %zu "
           "twisted %zu cuboid %zu canonical %zu\n",
           what, v->tets, v->walls, v->blocks, v->not_positive, v->not_conforming, v->not_seamless,
           v->stray_walls, v->not_aligned, v->open_boundary, v->twisted, v->not_cuboid, v->not_canonical);
}

#endif
