#include "simulation.h"

#include <float.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>

#include "solver.h"

static bool refuse(Simulation *s, const char *format, ...)
#ifdef __GNUC__
    __attribute__((format(printf, 2, 3)))
#endif
    ;

static bool refuse(Simulation *s, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(s->message, sizeof s->message, format, arguments);
    va_end(arguments);
    return false;
}

static const char *kind(unsigned reference)
{
    if (reference < FIRST_DERIVATIVE) return "state";
    if (reference < FIRST_INPUT) return "derivative";
    if (reference < FIRST_PARAMETER) return "input";
    if (reference < FIRST_OUTPUT) return "parameter";
    if (reference < FIRST_ENUMERATION) return "output";
    return "parameter";
}

void simulation_reset(Simulation *s)
{
    s->phase = BEFORE_START;
    s->time = 0.0;
    s->stop_time = INFINITY;
    for (int i = 0; i < N_REALS; i++) {
        s->values[i] = model_variables[i].start;
    }
    for (int i = 0; i < N_ENUMERATIONS; i++) {
        s->enumerations[i] = (int)model_variables[FIRST_ENUMERATION + i].start;
    }
    s->current = false;
    s->message[0] = '\0';
}

/* Whether a variable may be set now: inputs always, states and parameters until the start, results never. */
static bool is_settable(Simulation *s, unsigned reference)
{
    const char *const kind_name = kind(reference);
    const bool is_result = (reference >= FIRST_DERIVATIVE && reference < FIRST_INPUT)
        || (reference >= FIRST_OUTPUT && reference < FIRST_ENUMERATION);
    if (is_result) {
        return refuse(s, "%s %s is computed: it cannot be set", kind_name, model_variables[reference].name);
    }
    const bool is_input = reference >= FIRST_INPUT && reference < FIRST_PARAMETER;
    if (s->phase == RUNNING && !is_input) {
        return refuse(s, "%s %s is fixed: set at time %.16g s, it can be set before the simulation starts", kind_name,
                      model_variables[reference].name, s->time);
    }
    return true;
}

bool simulation_set_real(Simulation *s, unsigned reference, double value)
{
    if (reference >= N_REALS) {
        return refuse(s, "there is no Real variable with value reference %u: the last is %u", reference, N_REALS - 1U);
    }
    if (!is_settable(s, reference)) {
        return false;
    }
    if (!isfinite(value)) {
        return refuse(s, "%s %s is set to %g at time %.16g s: must be a finite number", kind(reference),
                      model_variables[reference].name, value, s->time);
    }
    s->values[reference] = value;
    s->current = false;
    return true;
}

static void evaluate(Simulation *s)
{
    double *const v = s->values;
    model_derivatives(s->time, &v[FIRST_STATE], &v[FIRST_INPUT], &v[FIRST_PARAMETER], s->enumerations,
                      &v[FIRST_DERIVATIVE]);
    model_outputs(s->time, &v[FIRST_STATE], &v[FIRST_INPUT], &v[FIRST_PARAMETER], s->enumerations, &v[FIRST_OUTPUT]);
    s->current = true;
}

bool simulation_get_real(Simulation *s, unsigned reference, double *value)
{
    if (reference >= N_REALS) {
        return refuse(s, "there is no Real variable with value reference %u: the last is %u", reference, N_REALS - 1U);
    }
    /* States, inputs and parameters are always there; the rest is computed when asked for. */
    if (!s->current && reference >= FIRST_DERIVATIVE) {
        evaluate(s);
    }
    *value = s->values[reference];
    return true;
}

bool simulation_set_enumeration(Simulation *s, unsigned reference, int value)
{
    if (reference < FIRST_ENUMERATION || reference >= N_VARIABLES) {
        return refuse(s, "there is no enumeration with value reference %u: they are %d to %d", reference,
                      FIRST_ENUMERATION, N_VARIABLES - 1);
    }
    if (!is_settable(s, reference)) {
        return false;
    }
    s->enumerations[reference - FIRST_ENUMERATION] = value;
    s->current = false;
    return true;
}

bool simulation_get_enumeration(Simulation *s, unsigned reference, int *value)
{
    if (reference < FIRST_ENUMERATION || reference >= N_VARIABLES) {
        return refuse(s, "there is no enumeration with value reference %u: they are %d to %d", reference,
                      FIRST_ENUMERATION, N_VARIABLES - 1);
    }
    *value = s->enumerations[reference - FIRST_ENUMERATION];
    return true;
}

bool simulation_setup(Simulation *s, double start_time, double stop_time)
{
    if (!isfinite(start_time) || !(stop_time >= start_time)) {
        return refuse(s, "start time %.16g s, stop time %.16g s: the start must be finite and not after the stop",
                      start_time, stop_time);
    }
    s->time = start_time;
    s->stop_time = stop_time;
    s->current = false;
    return true;
}

static bool check_bounds(Simulation *s, unsigned reference)
{
    const Variable *const variable = &model_variables[reference];
    const char *const kind_name = kind(reference);
    const double value = s->values[reference];
    if (value < variable->min) {
        return refuse(s, "%s %s is %.16g %s: must be at least %g %s", kind_name, variable->name, value, variable->unit,
                      variable->min, variable->unit);
    }
    if (value > variable->max) {
        return refuse(s, "%s %s is %.16g %s: must be at most %g %s", kind_name, variable->name, value, variable->unit,
                      variable->max, variable->unit);
    }
    return true;
}

bool simulation_start(Simulation *s)
{
    for (unsigned i = FIRST_STATE; i < FIRST_OUTPUT; i++) {
        const bool is_derivative = i >= FIRST_DERIVATIVE && i < FIRST_INPUT;
        if (!is_derivative && !check_bounds(s, i)) {
            return false;
        }
    }
    for (unsigned i = 0; i < N_ENUMERATIONS; i++) {
        const Variable *const variable = &model_variables[FIRST_ENUMERATION + i];
        if (s->enumerations[i] < (int)variable->min || s->enumerations[i] > (int)variable->max) {
            return refuse(s, "parameter %s is %d: must be one of %s", variable->name, s->enumerations[i], variable->unit);
        }
    }
    s->phase = RUNNING;
    return true;
}

bool simulation_step(Simulation *s, double time, double step)
{
    enum { MAX_INTERNAL_STEPS = 1000000000 };
    double *const states = &s->values[FIRST_STATE];
    const double *const inputs = &s->values[FIRST_INPUT];
    const double *const parameters = &s->values[FIRST_PARAMETER];
    const double solver_step_max = parameters[PARAMETER_solver_step];
    const int solver = s->enumerations[ENUMERATION_solver];

    if (!(step > 0.0) || !isfinite(step)) {
        return refuse(s, "the communication step at time %.16g s is %.16g s: must be positive", s->time, step);
    }
    /* Masters that add up their time arrive some rounding errors off. */
    const double tolerance = 1e-6 * step + 16.0 * DBL_EPSILON * fabs(s->time);
    if (!(fabs(time - s->time) <= tolerance)) {
        return refuse(s, "wrong communication point: expected %.16g s, received %.16g s", s->time, time);
    }
    if (time + step > s->stop_time + tolerance) {
        return refuse(s, "a step from %.16g s to %.16g s goes beyond the stop time %.16g s", time, time + step,
                      s->stop_time);
    }
    const double ratio = ceil(step / solver_step_max - 1e-6);
    if (ratio > MAX_INTERNAL_STEPS) {
        return refuse(s, "the communication step of %.16g s needs %g internal steps of %.16g s: at most %d are allowed",
                      step, ratio, solver_step_max, MAX_INTERNAL_STEPS);
    }
    const int n = ratio < 1.0 ? 1 : (int)ratio;
    const double internal_step = n == 1 ? step : step / n;

    s->current = false;
    for (int k = 0; k < n; k++) {
        double next[N_STATES];
        for (int i = 0; i < N_STATES; i++) {
            next[i] = states[i];
        }
        solver_step(solver, time + k * internal_step, internal_step, next, inputs, parameters, s->enumerations);
        for (unsigned i = 0; i < N_STATES; i++) {
            if (!isfinite(next[i])) {
                s->time = time + k * internal_step;
                return refuse(s, "state %s becomes %g after time %.16g s: the simulation diverges",
                              model_variables[i].name, next[i], s->time);
            }
        }
        for (int i = 0; i < N_STATES; i++) {
            states[i] = next[i];
        }
    }
    s->time = time + step;
    return true;
}
