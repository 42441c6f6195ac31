#include "explore/space.h"

static const bw_rim *rim_at(const bw_space *s, bw_patch p, bw_arc arc, bw_patch straight) {
    for (size_t i = s->rim_begin[p]; i < s->rim_begin[p + 1]; i++)
        if (s->rim[i].arc == arc && s->rim[i].straight == straight) return &s->rim[i];
    return NULL;
}

static bool touches(const bw_space *s, bw_patch p, bw_arc arc) {
    for (size_t i = s->rim_begin[p]; i < s->rim_begin[p + 1]; i++)
        if (s->rim[i].arc == arc) return true;
    return false;
}

static bw_status check_rims(bw_context *ctx, const bw_space *s) {
    for (bw_patch p = 0; p < (bw_patch)s->patch_count; p++)
        for (size_t i = s->rim_begin[p]; i < s->rim_begin[p + 1]; i++) {
            const bw_rim *r = &s->rim[i];
            for (int k = 0; k < 2; k++)
                if (r->beside[k] != BW_NONE && !touches(s, r->beside[k], r->arc))
                    return bw_fail(ctx, BW_E_CHECK, "patch %d stands beside patch %d at arc %d, on which it does not end", r->beside[k], p, r->arc);
            if (r->straight == BW_NONE) continue;
            const bw_rim *other = rim_at(s, r->straight, r->arc, p);
            if (!other || !r->inside) return bw_fail(ctx, BW_E_CHECK, "patch %d is straight behind arc %d of patch %d, but not the other way round", r->straight, r->arc, p);
            bool same = (r->beside[0] == other->beside[0] && r->beside[1] == other->beside[1]) ||
                        (r->beside[0] == other->beside[1] && r->beside[1] == other->beside[0]);
            if (!same) return bw_fail(ctx, BW_E_CHECK, "patches %d and %d see different patches beside arc %d", p, r->straight, r->arc);
        }
    return BW_OK;
}

static bool is_member(const bw_space *s, bw_patch p, bw_sheet sheet) {
    for (size_t i = s->of_patch_begin[p]; i < s->of_patch_begin[p + 1]; i++)
        if (s->of_patch[i] == sheet) return true;
    return false;
}

static bw_status check_sheets(bw_context *ctx, const bw_space *s) {
    bw_patch last = BW_NONE;
    for (bw_sheet sheet = 0; sheet < (bw_sheet)s->sheet_count; sheet++) {
        size_t begin = s->sheet_begin[sheet], end = s->sheet_begin[sheet + 1];
        if (s->sheet_seeds[sheet] < 1 || begin + (size_t)s->sheet_seeds[sheet] > end || s->sheet_patch[begin] < last)
            return bw_fail(ctx, BW_E_CHECK, "sheet %d has %d seeds in %zu patches, or comes too late", sheet, s->sheet_seeds[sheet], end - begin);
        last = s->sheet_patch[begin];
        for (size_t i = begin; i < end; i++) {
            bool seed = i < begin + (size_t)s->sheet_seeds[sheet];
            if (seed && !s->must[s->sheet_patch[i]]) return bw_fail(ctx, BW_E_CHECK, "patch %d is a seed of sheet %d, but may go", s->sheet_patch[i], sheet);
            if (!is_member(s, s->sheet_patch[i], sheet)) return bw_fail(ctx, BW_E_CHECK, "patch %d does not list sheet %d", s->sheet_patch[i], sheet);
        }
    }
    for (bw_patch p = 0; p < (bw_patch)s->patch_count; p++) {
        bool boundary = s->patch_block[p][0] == BW_NONE || s->patch_block[p][1] == BW_NONE;
        if (s->must[p] && !boundary && s->of_patch_begin[p] == s->of_patch_begin[p + 1])
            return bw_fail(ctx, BW_E_CHECK, "patch %d has to stay, but is of no sheet", p);
        for (size_t i = s->of_patch_begin[p] + 1; i < s->of_patch_begin[p + 1]; i++)
            if (s->of_patch[i] <= s->of_patch[i - 1]) return bw_fail(ctx, BW_E_CHECK, "the sheets of patch %d do not ascend", p);
    }
    return BW_OK;
}

static bw_status check_links(bw_context *ctx, const bw_space *s) {
    for (bw_sheet a = 0; a < (bw_sheet)s->sheet_count; a++)
        for (size_t i = s->link_begin[a]; i < s->link_begin[a + 1]; i++) {
            bw_sheet b = s->link[i];
            bool back = false;
            for (size_t k = s->link_begin[b]; k < s->link_begin[b + 1]; k++) back = back || s->link[k] == a;
            if (!back || a == b) return bw_fail(ctx, BW_E_CHECK, "sheet %d is linked to sheet %d, but not the other way round", a, b);
            if (s->sheet_component[a] != s->sheet_component[b] || (size_t)s->sheet_component[a] >= s->component_count)
                return bw_fail(ctx, BW_E_CHECK, "linked sheets %d and %d are of different components", a, b);
        }
    return BW_OK;
}

bw_status bw_space_check(bw_context *ctx, const bw_space *s) {
    bw_status status = check_rims(ctx, s);
    if (status == BW_OK) status = check_sheets(ctx, s);
    if (status == BW_OK) status = check_links(ctx, s);
    return status;
}
