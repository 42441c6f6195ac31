#include "explore/swap.h"

bw_status bw_random_order(bw_search *s, bw_serial *serial) {
    bw_sheet *order = serial->order;
    for (size_t i = 0; i < s->space->sheet_count; i++) order[i] = (bw_sheet)i;
    for (size_t i = s->space->sheet_count; i > 1; i--) {
        size_t j = bw_search_below(s, i);
        bw_sheet swap = order[i - 1];
        order[i - 1] = order[j], order[j] = swap;
    }
    bw_serial_insert(serial, order);
    return bw_poll(s->ctx);
}

/* Moves a sheet before another that comes earlier; back again if that is no gain. */
static bw_status try_swap(bw_search *s, bw_serial *serial, bw_sheet later, bw_sheet earlier, int64_t *cost, bool *gain) {
    uint64_t hash = serial->hash;
    size_t place = bw_serial_place(serial, later);
    int64_t now = *cost;
    bw_serial_move_before(serial, later, earlier);
    bw_status status = serial->hash != hash ? bw_search_price_serial(s, serial, &now) : BW_OK;
    *gain = now < *cost;
    if (*gain) *cost = now;
    else bw_serial_move_to(serial, later, place);
    return status;
}

bw_status bw_swap(bw_search *s, bw_serial *serial, uint64_t until, int64_t *cost) {
    const bw_space *x = s->space;
    bool helped = true;
    bw_status status = bw_search_price_serial(s, serial, cost);
    while (helped && status == BW_OK) {
        helped = false;
        for (bw_sheet a = 0; a < (bw_sheet)x->sheet_count && status == BW_OK; a++)
            for (size_t i = x->link_begin[a]; i < x->link_begin[a + 1] && status == BW_OK; i++) {
                bool gain;
                if (serial->key[a] < serial->key[x->link[i]]) continue;
                if (bw_search_spent(s, until)) return bw_poll(s->ctx);
                status = try_swap(s, serial, a, x->link[i], cost, &gain);
                helped = helped || gain;
                if (status == BW_OK && s->evaluations % 64 == 0) status = bw_poll(s->ctx);
            }
        if (status == BW_OK) status = bw_poll(s->ctx);
    }
    return status;
}
