/* cross.h, one segment against as many as a register holds. Include behind lanes.h. */

/* Are the boxes of two segments apart? Pieces of one line that follow each other are not near, though their lines are.
 */
static bool boxes_apart(const CrossRows *r, uint32_t i, uint32_t k) {
    for (int a = 0; a < 2; a++) {
        const double *const *x = a ? r->y : r->x;
        const double low = x[0][i] < x[1][i] ? x[0][i] : x[1][i], high = x[0][i] < x[1][i] ? x[1][i] : x[0][i];
        if ((x[0][k] < low - CROSS_NEAR && x[1][k] < low - CROSS_NEAR) ||
            (x[0][k] > high + CROSS_NEAR && x[1][k] > high + CROSS_NEAR))
            return true;
    }
    return false;
}

static bool cross_row(const CrossRows *r, uint32_t i, uint32_t from, uint32_t to, CrossFound *found, uint32_t *n) {
    const double dx = r->x[1][i] - r->x[0][i], dy = r->y[1][i] - r->y[0][i];
    const Some near = (Some){0} + r->blur[i];
    uint32_t count = 0;
    for (uint32_t k = from; k < to; k += SOME) {
        const uint32_t some = to - k < SOME ? (1u << (to - k)) - 1 : (1u << SOME) - 1;
        Some x[2], y[2], side[2], turned[2];
        uint32_t shares = 0;
        for (int e = 0; e < 2; e++) {
            const Some end = some_doubles(r->end[e] + k);
            x[e] = some_doubles(r->x[e] + k), y[e] = some_doubles(r->y[e] + k);
            side[e] = dx * (y[e] - r->y[0][i]) - dy * (x[e] - r->x[0][i]);
            for (int o = 0; o < 2; o++) shares |= equal_some(end, (Some){0} + r->end[o][i]);
        }
        shares &= some;
        const uint32_t left[2] = {less_some(near, side[0]), less_some(near, side[1])},
                       right[2] = {less_some(side[0], -near), less_some(side[1], -near)},
                       beside = (left[0] & left[1]) | (right[0] & right[1]);
        uint32_t may = some & ~beside & ~shares, meets = shares;
        if (may) {
            const Some blur = some_doubles(r->blur + k);
            for (int e = 0; e < 2; e++)
                turned[e] = (x[1] - x[0]) * (r->y[e][i] - y[0]) - (y[1] - y[0]) * (r->x[e][i] - x[0]);
            const uint32_t to_left[2] = {less_some(blur, turned[0]), less_some(blur, turned[1])},
                           to_right[2] = {less_some(turned[0], -blur), less_some(turned[1], -blur)};
            may &= ~((to_left[0] & to_left[1]) | (to_right[0] & to_right[1]));
            const uint32_t across = may & ((left[0] & right[1]) | (right[0] & left[1])) &
                                    ((to_left[0] & to_right[1]) | (to_right[0] & to_left[1]));
            for (uint32_t unclear = may & ~across; unclear; unclear &= unclear - 1)
                if (!boxes_apart(r, i, k + (uint32_t)__builtin_ctz(unclear))) return false;
            meets |= across;
        }
        for (; meets; meets &= meets - 1) {
            const uint32_t lane = (uint32_t)__builtin_ctz(meets);
            CrossFound f = {.other = k + lane, .shares = shares >> lane & 1};
            if (!f.shares) {
                f.up = right[0] >> lane & 1;
                f.at = turned[0][lane] / (turned[0][lane] - turned[1][lane]);
                f.other_at = side[0][lane] / (side[0][lane] - side[1][lane]);
            }
            found[count++] = f;
        }
    }
    *n = count;
    return true;
}
