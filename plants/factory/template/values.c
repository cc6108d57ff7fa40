#include "values.h"

#include <float.h>
#include <limits.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

Status say(Simulation *s, Status status, const char *format, ...)
{
    /* Several notes may come together before they are read. */
    size_t length = strlen(s->message);
    if (length > 0 && length + 3 < sizeof s->message) {
        memcpy(&s->message[length], "; ", 3);
        length += 2;
    }
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(&s->message[length], sizeof s->message - length, format, arguments);
    va_end(arguments);
    return status;
}

static const char *kind(unsigned reference)
{
    if (is_state(reference)) return "state";
    if (is_derivative(reference)) return "derivative";
    if (is_input(reference)) return "input";
    if (is_output(reference)) return "output";
    return reference == TIME ? "independent variable" : "parameter";
}

Status no_real(Simulation *s, unsigned reference)
{
    return say(s, STATUS_ERROR, "there is no Real variable with value reference %u: they are 0 to %d, and %d",
               reference, N_REALS - 1, TIME);
}

static Status no_integer(Simulation *s, unsigned reference)
{
    return say(s, STATUS_ERROR, "there is no enumeration or Integer with value reference %u: they are %d to %d",
               reference, FIRST_INTEGER, TIME - 1);
}

/* Whether a variable may be set now: inputs always, states and parameters until the start, then those parameters that
 * are tunable at events, results never. */
static Status check_settable(Simulation *s, unsigned reference, bool at_event)
{
    const char *const name = model_variables[reference].name;
    if (is_derivative(reference) || is_output(reference) || reference == TIME) {
        return say(s, STATUS_ERROR, "%s %s is computed: it cannot be set", kind(reference), name);
    }
    if (s->phase == BEFORE_START || is_input(reference)) return STATUS_OK;
    if (!model_variables[reference].tunable) {
        return say(s, STATUS_ERROR, "%s %s is fixed: set at time %.16g s, it can be set before the simulation starts",
                   kind(reference), name, s->time);
    }
    if (!at_event) {
        return say(s, STATUS_ERROR, "%s %s is set at time %.16g s in continuous-time mode: it can be set in event mode",
                   kind(reference), name, s->time);
    }
    return STATUS_OK;
}

Status check_bounds(Simulation *s, Status status, unsigned reference, double value)
{
    const Variable *const variable = &model_variables[reference];
    const bool is_low = value < variable->min || (variable->above && value <= variable->min);
    const bool is_high = !(value <= variable->max) || (variable->below && value >= variable->max);
    if (!is_low && !is_high) return STATUS_OK;
    const char *const bound =
        is_low ? (variable->above ? "greater than" : "at least") : (variable->below ? "less than" : "at most");
    return say(s, status, "%s %s is %.16g %s at time %.16g s: must be %s %g %s", kind(reference), variable->name, value,
               variable->unit, s->time, bound, is_low ? variable->min : variable->max, variable->unit);
}

Status simulation_check_real(Simulation *s, unsigned reference, double value, bool at_event)
{
    if (reference >= N_REALS && reference != TIME) return no_real(s, reference);
    const Status settable = check_settable(s, reference, at_event);
    if (settable != STATUS_OK) return settable;
    if (!isfinite(value)) {
        return say(s, STATUS_ERROR, "%s %s is set to %g at time %.16g s: must be a finite number", kind(reference),
                   model_variables[reference].name, value, s->time);
    }
    /* The bounds of what is set before the start are checked there. */
    return s->phase == RUNNING && is_real_parameter(reference) ? check_bounds(s, STATUS_DISCARD, reference, value)
                                                               : STATUS_OK;
}

/* An enumeration has its items where others have their unit. */
static Status check_integer(Simulation *s, unsigned reference, long long value)
{
    const Variable *const variable = &model_variables[reference];
    if (variable->unit[0] == '\0') return check_bounds(s, STATUS_ERROR, reference, (double)value);
    if (value >= (int)variable->min && value <= (int)variable->max) return STATUS_OK;
    return say(s, STATUS_ERROR, "parameter %s is %lld at time %.16g s: must be one of %s", variable->name, value,
               s->time, variable->unit);
}

Status simulation_set_integer(Simulation *s, unsigned reference, long long value)
{
    if (!is_integer(reference)) return no_integer(s, reference);
    const Status settable = check_settable(s, reference, false);
    if (settable != STATUS_OK) return settable;
    if (value < INT_MIN || value > INT_MAX) return check_integer(s, reference, value);
    s->integers[reference - FIRST_INTEGER] = (int)value;
    s->current = false;
    return STATUS_OK;
}

Status simulation_get_integer(Simulation *s, unsigned reference, int *value)
{
    if (!is_integer(reference)) return no_integer(s, reference);
    *value = s->integers[reference - FIRST_INTEGER];
    return STATUS_OK;
}

Status check_parameters(Simulation *s)
{
    for (unsigned i = FIRST_PARAMETER; i < FIRST_OUTPUT; i++) {
        const Status status = check_bounds(s, STATUS_ERROR, i, s->values[i]);
        if (status != STATUS_OK) return status;
    }
    for (int i = 0; i < N_INTEGERS; i++) {
        const Status status = check_integer(s, (unsigned)(FIRST_INTEGER + i), s->integers[i]);
        if (status != STATUS_OK) return status;
    }
    return STATUS_OK;
}

/* ---- start and steps ---- */

void put_before_start(Simulation *s)
{
    s->phase = BEFORE_START;
    s->stop_time = INFINITY;
    for (int i = 0; i < N_REALS; i++) {
        s->values[i] = model_variables[i].start;
    }
    for (int i = 0; i < N_INTEGERS; i++) {
        s->integers[i] = (int)model_variables[FIRST_INTEGER + i].start;
    }
}

Status simulation_setup(Simulation *s, double start_time, double stop_time)
{
    if (!isfinite(start_time) || !(stop_time >= start_time)) {
        return say(s, STATUS_ERROR,
                   "start time %.16g s, stop time %.16g s: the start must be finite and not after the stop", start_time,
                   stop_time);
    }
    s->time = start_time;
    s->stop_time = stop_time;
    s->current = false;
    return STATUS_OK;
}

Status check_step(Simulation *s, double time, double step)
{
    if (!(step > 0.0) || !isfinite(step)) {
        return say(s, STATUS_ERROR, "the communication step at time %.16g s is %.16g s: must be positive", s->time,
                   step);
    }
    /* Masters that add up their time arrive some rounding errors off. */
    const double tolerance = 1e-6 * step + 16.0 * DBL_EPSILON * fabs(s->time);
    if (!(fabs(time - s->time) <= tolerance)) {
        return say(s, STATUS_ERROR, "wrong communication point: expected %.16g s, received %.16g s", s->time, time);
    }
    if (time + step > s->stop_time + tolerance) {
        return say(s, STATUS_ERROR, "a step from %.16g s to %.16g s goes beyond the stop time %.16g s", time,
                   time + step, s->stop_time);
    }
    return STATUS_OK;
}

/* ---- as bytes ---- */

unsigned char *put(unsigned char *to, const void *from, size_t size)
{
    memcpy(to, from, size);
    return to + size;
}

const unsigned char *take(void *to, const unsigned char *from, size_t size)
{
    memcpy(to, from, size);
    return from + size;
}

Status take_over(Simulation *s, Simulation *read, int phase, bool is_good)
{
    if (!is_good) return say(s, STATUS_ERROR, "these bytes are not a state of this FMU: they hold impossible values");
    read->phase = (Phase)phase;
    if (read->phase == RUNNING) {
        const Status status = check_parameters(read);
        if (status != STATUS_OK) {
            memcpy(s->message, read->message, sizeof s->message);
            return status;
        }
    }
    *s = *read;
    return STATUS_OK;
}
