/* What a simulation of any kind does with its values, which go by value reference: check, refuse, keep. A Simulation
 * has its phase, time, values, integers and message, and the mark `current`. */
#ifndef VALUES_H
#define VALUES_H

#include "simulation.h"

/* Add a message, and return the status. */
Status say(Simulation *s, Status status, const char *format, ...)
#ifdef __GNUC__
    __attribute__((format(printf, 3, 4)))
#endif
    ;

/* Whether a value reference is one of those from `first` to before `end`. */
static inline bool is_among(unsigned reference, unsigned first, unsigned end)
{
    return reference >= first && reference < end;
}

static inline bool is_state(unsigned reference)
{
    return is_among(reference, FIRST_STATE, FIRST_DERIVATIVE);
}

static inline bool is_derivative(unsigned reference)
{
    return is_among(reference, FIRST_DERIVATIVE, FIRST_INPUT);
}

static inline bool is_input(unsigned reference)
{
    return is_among(reference, FIRST_INPUT, FIRST_PARAMETER);
}

static inline bool is_real_parameter(unsigned reference)
{
    return is_among(reference, FIRST_PARAMETER, FIRST_OUTPUT);
}

static inline bool is_output(unsigned reference)
{
    return is_among(reference, FIRST_OUTPUT, N_REALS);
}

static inline bool is_integer(unsigned reference)
{
    return is_among(reference, FIRST_INTEGER, TIME);
}

/* Refuse a value reference that is no Real's. */
Status no_real(Simulation *s, unsigned reference);

/* Whether a value is within the bounds of its variable; if not, a message with this status. */
Status check_bounds(Simulation *s, Status status, unsigned reference, double value);
Status check_parameters(Simulation *s);

/* Lead a simulation whose bytes are all zero to before its start, with the start values. */
void put_before_start(Simulation *s);

/* Whether a communication step may begin at a time: from the communication point, forwards, and not beyond the stop. */
Status check_step(Simulation *s, double time, double step);

/* Take over what was read from bytes, if it is good: a state in which a simulation of this FMU can be. */
Status take_over(Simulation *s, Simulation *read, int phase, bool is_good);

/* Copy to bytes or from bytes; return where the next ones are. */
unsigned char *put(unsigned char *to, const void *from, size_t size);
const unsigned char *take(void *to, const unsigned char *from, size_t size);

#endif
