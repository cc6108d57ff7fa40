#include "streams.h"

#include <math.h>

#include "ziggurat.h"

/* ---- seeds: NumPy's SeedSequence ---- */

static uint32_t hashed(uint32_t word, uint32_t *constant, uint32_t factor)
{
    const uint32_t before = *constant;
    *constant = before * factor;
    const uint32_t value = (word ^ before) * *constant;
    return value ^ (value >> 16);
}

static uint32_t mixed(uint32_t one, uint32_t other)
{
    const uint32_t value = 0xCA01F9DDu * one - 0x4973F715u * other;
    return value ^ (value >> 16);
}

/* ---- whole numbers: PCG64 ---- */

/* The upper 64 bits of a product of 128. */
static uint64_t high_of_product(uint64_t one, uint64_t other)
{
    const uint64_t mask = 0xFFFFFFFFu;
    const uint64_t a = one >> 32, b = one & mask, c = other >> 32, d = other & mask;
    const uint64_t middle = a * d + (b * d >> 32), rest = b * c + (middle & mask);
    return a * c + (middle >> 32) + (rest >> 32);
}

static uint64_t next(Stream *s)
{
    const uint64_t factor_high = 0x2360ED051FC65DA4u, factor_low = 0x4385DF649FCCF645u;
    const uint64_t product = s->low * factor_low;
    uint64_t high =
        high_of_product(s->low, factor_low) + s->high * factor_low + s->low * factor_high + s->increment_high;
    const uint64_t low = product + s->increment_low;
    if (low < product) high++;
    s->high = high;
    s->low = low;
    const uint64_t by = high >> 58, both = high ^ low;
    return (both >> by) | (both << ((0u - by) & 63u));
}

void stream_begin(Stream *stream, const uint32_t *seed, int words, const uint32_t name[8])
{
    uint32_t pool[4], constant = 0x43B0D7E5u;
    for (int place = 0; place < 4; place++) {
        pool[place] = hashed(seed[place], &constant, 0x931E8875u);
    }
    for (int source = 0; source < 4; source++) {
        for (int place = 0; place < 4; place++) {
            if (source != place) pool[place] = mixed(pool[place], hashed(pool[source], &constant, 0x931E8875u));
        }
    }
    for (int source = 4; source < words + 8; source++) {
        const uint32_t word = source < words ? seed[source] : name[source - words];
        for (int place = 0; place < 4; place++) {
            pool[place] = mixed(pool[place], hashed(word, &constant, 0x931E8875u));
        }
    }
    uint64_t state[4];
    constant = 0x8B51F9DDu;
    for (int place = 0; place < 4; place++) {
        const uint64_t low = hashed(pool[(2 * place) & 3], &constant, 0x58F38DEDu);
        const uint64_t high = hashed(pool[(2 * place + 1) & 3], &constant, 0x58F38DEDu);
        state[place] = low | (high << 32);
    }
    stream->increment_high = (state[2] << 1) | (state[3] >> 63);
    stream->increment_low = (state[3] << 1) | 1u;
    /* From a state of zero, a step leads to the increment. */
    const uint64_t low = stream->increment_low + state[1];
    stream->high = stream->increment_high + state[0] + (low < state[1] ? 1u : 0u);
    stream->low = low;
    next(stream);
}

double stream_part(Stream *stream)
{
    return (double)(next(stream) >> 11) * (1.0 / 9007199254740992.0);
}

/* ---- normal numbers: the ziggurat ---- */

double stream_normal(Stream *stream)
{
    for (;;) {
        const uint64_t bits = next(stream);
        const uint64_t layer = bits & 0xFFu, place = (bits >> 9) & 0x000FFFFFFFFFFFFFu;
        const double width = ziggurat_widths[layer];
        const double number = (double)place * ((bits >> 8) & 1u ? -width : width);
        if (place < ziggurat_inside[layer]) return number; /* all but one in a hundred */
        if (layer == 0) {
            for (;;) {
                const double across = -ziggurat_tail_scale * log1p(-stream_part(stream));
                const double up = -log1p(-stream_part(stream));
                if (up + up > across * across) {
                    return (place >> 8) & 1u ? -(ziggurat_tail + across) : ziggurat_tail + across;
                }
            }
        }
        const double height =
            (ziggurat_heights[layer - 1] - ziggurat_heights[layer]) * stream_part(stream) + ziggurat_heights[layer];
        if (height < exp(-0.5 * number * number)) return number;
    }
}
