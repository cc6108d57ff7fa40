#include "simulation.h"

#include <limits.h>
#include <math.h>
#include <string.h>

#include "values.h"

/* ---- the program beside the model ---- */

Status simulation_open(Simulation *s, const char *resources)
{
#if NEEDS_TOOL
    const char *fault = NULL;
    s->tool = model_open(resources, &fault);
    if (s->tool == NULL) return say(s, STATUS_ERROR, "%s", fault);
#else
    (void)s;
    (void)resources;
#endif
    return STATUS_OK;
}

void simulation_end(Simulation *s)
{
#if NEEDS_TOOL
    model_end(s->tool);
#else
    (void)s;
#endif
}

void simulation_close(Simulation *s)
{
#if NEEDS_TOOL
    model_close(s->tool);
    s->tool = NULL;
#else
    (void)s;
#endif
}

/* To before the first tick. */
static Status begin(Simulation *s)
{
    s->current = false; /* a program that begins anew knows no tick */
    memset(&s->before, 0, sizeof s->before);
    model_start(&s->values[FIRST_PARAMETER], s->integers, &s->before);
#if NEEDS_TOOL
    const char *const fault = model_begin(s->tool, &s->values[FIRST_PARAMETER], s->integers);
    if (fault != NULL) return say(s, STATUS_ERROR, "%s", fault);
#endif
    return STATUS_OK;
}

/* ---- values ---- */

void simulation_reset(Simulation *s)
{
    struct Tool *const tool = s->tool;
    memset(s, 0, sizeof *s);
    s->tool = tool;
    s->fresh = true;
    put_before_start(s);
}

void simulation_set_real(Simulation *s, unsigned reference, double value)
{
    s->values[reference] = value;
    s->current = false;
    if (is_input(reference)) {
        s->given[reference - FIRST_INPUT] = true;
        s->fresh = true;
    }
}

/* Compute this tick, if it is not. */
static Status evaluate(Simulation *s)
{
    if (s->current) return STATUS_OK;
    if (LAST_TICK >= 0 && s->tick > LAST_TICK) {
        return say(s, STATUS_DISCARD,
                   "this FMU knows its courses over time up to %.16g s after the start, and no value at time %.16g s",
                   LAST_TICK * SAMPLE_TIME, s->time);
    }
    const double *const parameters = &s->values[FIRST_PARAMETER];
    if (s->phase == BEFORE_START) {
        const Status status = begin(s);
        if (status != STATUS_OK) return status;
    }
    memcpy(&s->after, &s->before, sizeof s->after);
    double outputs[ROOM(N_OUTPUTS)];
    const double *const inputs = LATE && s->tick == 0 ? s->first : &s->values[FIRST_INPUT];
    const char *const fault = model_tick(s->tick, inputs, parameters, s->integers, &s->after, s->tool, outputs);
    if (fault != NULL) return say(s, STATUS_ERROR, "%s at time %.16g s", fault, s->time);
    memcpy(&s->values[FIRST_OUTPUT], outputs, N_OUTPUTS * sizeof(double));
    s->current = true;
    return STATUS_OK;
}

Status simulation_get_real(Simulation *s, unsigned reference, double *value)
{
    if (reference == TIME) {
        *value = s->time;
        return STATUS_OK;
    }
    if (reference >= N_REALS) return no_real(s, reference);
    if (is_output(reference) && s->fresh && !LATE) {
        const Status status = evaluate(s);
        if (status != STATUS_OK) return status;
    }
    *value = s->values[reference];
    return STATUS_OK;
}

/* ---- start ---- */

Status simulation_start(Simulation *s)
{
    Status status = check_parameters(s);
    if (status != STATUS_OK) return status;
    status = begin(s);
    if (status != STATUS_OK) return status;
    memcpy(s->first, &s->values[FIRST_INPUT], sizeof(double) * N_INPUTS);
    s->phase = RUNNING;
    return STATUS_OK;
}

/* ---- steps ---- */

/* A warning if inputs were never set before the first step. */
static Status check_given(Simulation *s)
{
    int missing = 0, first = 0;
    for (int i = N_INPUTS - 1; i >= 0; i--) {
        if (!s->given[i]) {
            missing++;
            first = i;
        }
    }
    if (missing == 0) return STATUS_OK;
    const Variable *const input = &model_variables[FIRST_INPUT + first];
    return say(s, STATUS_WARNING, "%d of %d inputs were never set, and keep their start value: %s stays %.16g %s",
               missing, N_INPUTS, input->name, input->start, input->unit);
}

Status simulation_step(Simulation *s, double time, double step)
{
    const Status allowed = check_step(s, time, step);
    if (allowed != STATUS_OK) return allowed;
    const double count = floor(step / SAMPLE_TIME + 0.5);
    if (count < 1.0 || count > 1e9 || fabs(step - count * SAMPLE_TIME) > 1e-6 * SAMPLE_TIME) {
        return say(
            s, STATUS_ERROR,
            "the communication step at time %.16g s is %.16g s: must be the sample time of this FMU, %.16g s, or a "
            "whole number of them",
            s->time, step, (double)SAMPLE_TIME);
    }
    const double start = s->time;
    Status worst = s->tick == 0 ? check_given(s) : STATUS_OK;
    for (int k = 0; k < (int)count; k++) {
        const Status status = evaluate(s);
        if (status != STATUS_OK) return status;
        memcpy(&s->before, &s->after, sizeof s->before);
        s->tick++;
        s->time = k + 1 == (int)count ? time + step : start + (k + 1) * SAMPLE_TIME;
        s->current = false;
        s->fresh = N_INPUTS == 0; /* here, as the next tick may be refused */
    }
    return worst;
}

/* ---- what there is not ---- */

Status simulation_set_slope(Simulation *s, unsigned reference, double slope)
{
    (void)slope;
    return say(s, STATUS_ERROR, "the time derivative of value reference %u is set: canInterpolateInputs is false",
               reference);
}

static Status no_model_exchange(Simulation *s)
{
    return say(s, STATUS_ERROR, "this FMU is for Co-Simulation only");
}

Status simulation_set_time(Simulation *s, double time)
{
    (void)time;
    return no_model_exchange(s);
}

Status simulation_set_states(Simulation *s, const double states[])
{
    (void)states;
    return no_model_exchange(s);
}

Status simulation_get_derivatives(Simulation *s, double derivatives[])
{
    (void)derivatives;
    return no_model_exchange(s);
}

Status simulation_complete_step(Simulation *s)
{
    return no_model_exchange(s);
}

Status simulation_differentiate(Simulation *s, bool adjoint, const unsigned unknowns[], size_t n_unknowns,
                                const unsigned knowns[], size_t n_knowns, const double seed[], double sensitivity[])
{
    (void)adjoint;
    (void)unknowns;
    (void)n_unknowns;
    (void)knowns;
    (void)n_knowns;
    (void)seed;
    (void)sensitivity;
    return say(s, STATUS_ERROR, "a sampled model has no partial derivatives");
}

/* ---- as bytes ---- */

void simulation_serialize(const Simulation *s, unsigned char bytes[])
{
    const int phase = (int)s->phase;
    unsigned char *to = put(bytes, &phase, sizeof phase);
    to = put(to, &s->time, sizeof s->time);
    to = put(to, &s->stop_time, sizeof s->stop_time);
    to = put(to, &s->tick, sizeof s->tick);
    to = put(to, s->values, sizeof s->values);
    to = put(to, s->integers, sizeof(int) * N_INTEGERS);
    for (int i = 0; i < N_INPUTS; i++) {
        *to++ = s->given[i] ? 1 : 0;
    }
    *to++ = s->fresh ? 1 : 0;
    to = put(to, s->first, sizeof(double) * N_INPUTS);
    put(to, &s->before, sizeof s->before);
}

Status simulation_deserialize(Simulation *s, const unsigned char bytes[])
{
    Simulation read = {.tool = s->tool};
    simulation_reset(&read);
    int phase;
    const unsigned char *from = take(&phase, bytes, sizeof phase);
    from = take(&read.time, from, sizeof read.time);
    from = take(&read.stop_time, from, sizeof read.stop_time);
    from = take(&read.tick, from, sizeof read.tick);
    from = take(read.values, from, sizeof read.values);
    from = take(read.integers, from, sizeof(int) * N_INTEGERS);
    bool is_good = (phase == BEFORE_START || phase == RUNNING) && isfinite(read.time) && !isnan(read.stop_time)
                   && read.tick >= 0 && read.tick < LLONG_MAX / 2 && (phase == RUNNING || read.tick == 0);
    for (int i = 0; i < N_INPUTS; i++) {
        is_good = is_good && *from <= 1;
        read.given[i] = *from++ != 0;
    }
    is_good = is_good && *from <= 1;
    read.fresh = *from++ != 0;
    from = take(read.first, from, sizeof(double) * N_INPUTS);
    take(&read.before, from, sizeof read.before);
    for (unsigned i = 0; i < FIRST_OUTPUT; i++) {
        is_good = is_good && isfinite(read.values[i]);
    }
    for (int i = 0; i < N_INPUTS; i++) {
        is_good = is_good && isfinite(read.first[i]);
    }
    return take_over(s, &read, phase, is_good);
}
