/* Streams of random numbers: those of NumPy's generators, bit for bit. NumPy's SeedSequence makes the first state of
 * the words of a seed and of a stream's name, PCG64 (O'Neill, HMC-CS-2014-0905) makes whole numbers, and the ziggurat
 * of Marsaglia and Tsang (doi:10.18637/jss.v005.i08) makes normal numbers of these. */
#ifndef STREAMS_H
#define STREAMS_H

#include <stdint.h>

/* The state of a stream and its increment, numbers of 128 bits in two words each. */
typedef struct {
    uint64_t high;
    uint64_t low;
    uint64_t increment_high;
    uint64_t increment_low;
} Stream;

/* Begin a stream with the words of a seed, four at least, and the eight of its name. */
void stream_begin(Stream *stream, const uint32_t *seed, int words, const uint32_t name[8]);

/* The next number from 0 to 1, and the next standard normal number. */
double stream_part(Stream *stream);
double stream_normal(Stream *stream);

#endif
