#include "simulation.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "elementary.h"
#include "solver.h"
#include "values.h"

/* ---- values ---- */

Status simulation_open(Simulation *s, const char *resources)
{
    (void)s;
    (void)resources;
    return STATUS_OK;
}

void simulation_close(Simulation *s)
{
    (void)s;
}

void simulation_end(Simulation *s)
{
    (void)s;
}

void simulation_reset(Simulation *s)
{
    memset(s, 0, sizeof *s);
    put_before_start(s);
}

void simulation_set_real(Simulation *s, unsigned reference, double value)
{
    s->values[reference] = value;
    s->current = false;
}

Status simulation_set_slope(Simulation *s, unsigned reference, double slope)
{
    if (!is_input(reference)) {
        return say(s, STATUS_ERROR,
                   "value reference %u is not an input: only inputs have time derivatives that can be set", reference);
    }
    if (!isfinite(slope)) {
        return say(s, STATUS_ERROR,
                   "the time derivative of input %s is set to %g at time %.16g s: must be a finite number",
                   model_variables[reference].name, slope, s->time);
    }
    s->slopes[reference - FIRST_INPUT] = slope;
    s->ramps = s->ramps || slope != 0.0;
    return STATUS_OK;
}

static void evaluate(Simulation *s)
{
    double *const v = s->values;
    const double *const x = &v[FIRST_STATE], *const u = &v[FIRST_INPUT], *const p = &v[FIRST_PARAMETER];
    model_get_derivatives(s->time, x, u, p, s->integers, &v[FIRST_DERIVATIVE]);
    model_get_outputs(s->time, x, u, p, s->integers, &v[FIRST_OUTPUT]);
    s->current = true;
}

Status simulation_get_real(Simulation *s, unsigned reference, double *value)
{
    if (reference == TIME) {
        *value = s->time;
        return STATUS_OK;
    }
    if (reference >= N_REALS) return no_real(s, reference);
    /* States, inputs and parameters are always there; the rest is computed when asked for. */
    if (!s->current && (is_derivative(reference) || is_output(reference))) {
        evaluate(s);
    }
    *value = s->values[reference];
    return STATUS_OK;
}

/* ---- start ---- */

/* Whether the equations hold for these states: a message when a limit is left or kept again, a warning as long as it
 * is left, or an error with nothing changed if the simulation is to stop there. */
static Status check_limits(Simulation *s, double time, const double *states, const double *inputs)
{
    if (N_LIMITS == 0) return STATUS_OK;
    double limited[ROOM(N_LIMITS)];
    model_get_limited(time, states, inputs, &s->values[FIRST_PARAMETER], s->integers, limited);
    Status status = STATUS_OK;
    for (int i = 0; i < N_LIMITS; i++) {
        const Limit *const limit = &model_limits[i];
        const bool is_low = limited[i] < limit->min;
        const bool is_outside = is_low || !(limited[i] <= limit->max);
        const bool must_stop = is_outside && s->integers[ENUMERATION_at_singularity] == AT_SINGULARITY_STOP;
        if (must_stop || (is_outside && !s->outside[i])) {
            say(s, STATUS_WARNING, "%s is %.16g %s at time %.16g s, %s its limit of %.16g %s: %s", limit->name,
                limited[i], limit->unit, time, is_low ? "below" : "above", is_low ? limit->min : limit->max,
                limit->unit, limit->reason);
        } else if (!is_outside && s->outside[i]) {
            say(s, STATUS_OK, "%s is %.16g %s at time %.16g s, within its limits again", limit->name, limited[i],
                limit->unit, time);
        }
        if (must_stop) return STATUS_ERROR;
        if (is_outside) status = STATUS_WARNING;
        s->outside[i] = is_outside;
    }
    return status;
}

Status simulation_start(Simulation *s)
{
    for (unsigned i = FIRST_STATE; i < FIRST_PARAMETER; i++) {
        const Status status = is_derivative(i) ? STATUS_OK : check_bounds(s, STATUS_ERROR, i, s->values[i]);
        if (status != STATUS_OK) return status;
    }
    Status status = check_parameters(s);
    if (status != STATUS_OK) return status;
    status = check_limits(s, s->time, &s->values[FIRST_STATE], &s->values[FIRST_INPUT]);
    if (status == STATUS_ERROR) return status;
    s->phase = RUNNING;
    return status;
}

/* ---- steps ---- */

/* The inputs at a time within a step. */
static void move_inputs(const Simulation *s, double since_start, double inputs[])
{
    for (int i = 0; i < N_INPUTS; i++) {
        inputs[i] = s->values[FIRST_INPUT + i] + s->slopes[i] * since_start;
    }
}

/* Take over the states after an internal step that began at `time`, unless they are no good. */
static Status accept(Simulation *s, const Drive *drive, double time, double step, const double next[])
{
    for (int i = 0; i < N_STATES; i++) {
        if (!isfinite(next[i])) {
            return say(s, STATUS_ERROR, "state %s becomes %g after time %.16g s: the simulation diverges",
                       model_variables[i].name, next[i], time);
        }
    }
    double moved[ROOM(N_INPUTS)];
    if (s->ramps) {
        move_inputs(s, time + step - drive->start, moved);
    }
    const Status status = check_limits(s, time + step, next, s->ramps ? moved : drive->inputs);
    if (status != STATUS_ERROR) {
        for (int i = 0; i < N_STATES; i++) {
            s->values[FIRST_STATE + i] = next[i];
        }
    }
    return status;
}

static Status take_fixed_steps(Simulation *s, const Drive *drive, double time, double step, int n)
{
    const int solver = s->integers[ENUMERATION_solver];
    const double internal_step = n == 1 ? step : step / n;
    Status worst = STATUS_OK;
    for (int k = 0; k < n; k++) {
        const double now = time + k * internal_step;
        double next[N_STATES];
        solver_step(solver, drive, now, internal_step, &s->values[FIRST_STATE], next, NULL);
        const Status status = accept(s, drive, now, internal_step, next);
        if (status == STATUS_ERROR) {
            s->time = now;
            return status;
        }
        worst = status > worst ? status : worst;
    }
    return worst;
}

/* The largest error of a state relative to what is tolerated, and which state that is; NaN and infinity are larger. */
static double error_ratio(const Simulation *s, const double next[], const double error[], int *worst)
{
    const double tolerance = s->values[FIRST_PARAMETER + PARAMETER_tolerance];
    double largest = 0.0;
    *worst = 0;
    for (int i = 0; i < N_STATES; i++) {
        const double magnitude = fmax(fabs(s->values[FIRST_STATE + i]), fabs(next[i]));
        const double ratio = fabs(error[i]) / (tolerance * (model_variables[i].nominal + magnitude));
        if (!isfinite(next[i]) || !isfinite(ratio)) {
            *worst = i;
            return INFINITY;
        }
        if (ratio > largest) {
            *worst = i;
            largest = ratio;
        }
    }
    return largest;
}

/* E. Hairer, S. P. Norsett, G. Wanner: Solving Ordinary Differential Equations I, section II.4. Each communication step
 * begins with the largest step allowed, so that its result depends on nothing but where it begins. */
static Status take_adaptive_steps(Simulation *s, const Drive *drive, double time, double step)
{
    const int solver = s->integers[ENUMERATION_solver];
    const double largest = s->values[FIRST_PARAMETER + PARAMETER_solver_step];
    double done = 0.0, trial = largest;
    Status worst = STATUS_OK;
    while (done < step) {
        const double now = time + done, remaining = step - done;
        const bool is_last = remaining <= trial * (1.0 + 1e-6);
        const double internal_step = is_last ? remaining : trial;
        double next[N_STATES], error[N_STATES];
        int worst_state;
        solver_step(solver, drive, now, internal_step, &s->values[FIRST_STATE], next, error);
        const double ratio = error_ratio(s, next, error, &worst_state);
        if (ratio <= 1.0) {
            const Status status = accept(s, drive, now, internal_step, next);
            if (status == STATUS_ERROR) {
                s->time = now;
                return status;
            }
            worst = status > worst ? status : worst;
            done = is_last ? step : done + internal_step;
        }
        /* The error goes with the fifth power of the step: aim a little below what is tolerated. */
        trial = internal_step * fmin(5.0, fmax(0.2, 0.9 * elementary_pow(ratio, -1.0 / 5.0)));
        trial = fmin(trial, largest);
        if (ratio > 1.0 && trial <= 16.0 * DBL_EPSILON * fmax(fabs(now), step)) {
            s->time = now;
            return say(
                s, STATUS_ERROR,
                "the step size underflows after time %.16g s: state %s cannot be kept within a tolerance of %g, the "
                "simulation diverges",
                now, model_variables[worst_state].name, s->values[FIRST_PARAMETER + PARAMETER_tolerance]);
        }
    }
    return worst;
}

Status simulation_step(Simulation *s, double time, double step)
{
    static const double max_internal_steps = 1e9; /* fits into an int */
    const double solver_step_max = s->values[FIRST_PARAMETER + PARAMETER_solver_step];
    const Drive drive = {.inputs = &s->values[FIRST_INPUT],
                         .slopes = s->ramps ? s->slopes : NULL,
                         .start = time,
                         .parameters = &s->values[FIRST_PARAMETER],
                         .enumerations = s->integers};

    const Status allowed = check_step(s, time, step);
    if (allowed != STATUS_OK) return allowed;
    const double ratio = step <= solver_step_max ? 1.0 : ceil(step / solver_step_max - 1e-6);
    if (ratio > max_internal_steps) {
        return say(s, STATUS_ERROR,
                   "the communication step of %.16g s needs %g internal steps of %.16g s: at most %g are allowed", step,
                   ratio, solver_step_max, max_internal_steps);
    }

    s->current = false;
    const Status status = solver_is_adaptive(s->integers[ENUMERATION_solver])
                              ? take_adaptive_steps(s, &drive, time, step)
                              : take_fixed_steps(s, &drive, time, step, ratio < 1.0 ? 1 : (int)ratio);
    if (status == STATUS_ERROR) return status;
    if (s->ramps) {
        /* The inputs have arrived where they were going, and stay there unless they are set again. */
        move_inputs(s, step, &s->values[FIRST_INPUT]);
        memset(s->slopes, 0, sizeof s->slopes);
        s->ramps = false;
    }
    s->time = time + step;
    return status;
}

Status simulation_set_time(Simulation *s, double time)
{
    if (!isfinite(time)) return say(s, STATUS_ERROR, "the time is set to %g: must be a finite number", time);
    s->time = time;
    s->current = false;
    return STATUS_OK;
}

Status simulation_set_states(Simulation *s, const double states[])
{
    for (int i = 0; i < N_STATES; i++) {
        if (!isfinite(states[i])) {
            return say(s, STATUS_ERROR, "state %s is set to %g at time %.16g s: must be a finite number",
                       model_variables[i].name, states[i], s->time);
        }
    }
    memcpy(&s->values[FIRST_STATE], states, N_STATES * sizeof(double));
    s->current = false;
    return STATUS_OK;
}

Status simulation_get_derivatives(Simulation *s, double derivatives[])
{
    if (!s->current) {
        evaluate(s);
    }
    for (int i = 0; i < N_STATES; i++) {
        const double derivative = s->values[FIRST_DERIVATIVE + i];
        if (!isfinite(derivative)) {
            return say(s, STATUS_DISCARD, "the derivative of state %s is %g at time %.16g s: try a smaller step",
                       model_variables[i].name, derivative, s->time);
        }
        derivatives[i] = derivative;
    }
    /* A trial beyond a limit where the simulation must stop is no use; otherwise only accepted states count. */
    const bool must_stop = N_LIMITS > 0 && s->integers[ENUMERATION_at_singularity] == AT_SINGULARITY_STOP;
    return must_stop && simulation_complete_step(s) == STATUS_ERROR ? STATUS_DISCARD : STATUS_OK;
}

Status simulation_complete_step(Simulation *s)
{
    return check_limits(s, s->time, &s->values[FIRST_STATE], &s->values[FIRST_INPUT]);
}

/* ---- partial derivatives ---- */

static Status check_differentiable(Simulation *s, const unsigned unknowns[], size_t n_unknowns, const unsigned knowns[],
                                   size_t n_knowns)
{
    for (size_t i = 0; i < n_unknowns; i++) {
        const unsigned r = unknowns[i];
        if (!(is_state(r) || is_derivative(r) || is_output(r))) {
            return say(s, STATUS_ERROR,
                       "the variable with value reference %u is no unknown: derivatives and outputs are", r);
        }
    }
    for (size_t j = 0; j < n_knowns; j++) {
        const unsigned r = knowns[j];
        const bool is_known = is_state(r) || is_input(r) || r == TIME
                              || (is_real_parameter(r) && (s->phase == BEFORE_START || model_variables[r].tunable));
        if (!is_known) {
            return say(
                s, STATUS_ERROR,
                "the variable with value reference %u is no known: states, inputs, the time and tunable parameters "
                "are, and until the simulation starts all parameters that are numbers",
                r);
        }
    }
    return STATUS_OK;
}

static void add_products(bool adjoint, const Partial table[], const double partials[], int n, const double seeds[],
                         double sums[])
{
    for (int k = 0; k < n; k++) {
        const unsigned from = adjoint ? table[k].unknown : table[k].known;
        const unsigned to = adjoint ? table[k].known : table[k].unknown;
        if (seeds[from] != 0.0) sums[to] += partials[k] * seeds[from]; /* a partial that is not finite may not count */
    }
}

Status simulation_differentiate(Simulation *s, bool adjoint, const unsigned unknowns[], size_t n_unknowns,
                                const unsigned knowns[], size_t n_knowns, const double seed[], double sensitivity[])
{
    const Status status = check_differentiable(s, unknowns, n_unknowns, knowns, n_knowns);
    if (status != STATUS_OK) return status;
    const unsigned *const from = adjoint ? unknowns : knowns, *const to = adjoint ? knowns : unknowns;
    const size_t n_from = adjoint ? n_unknowns : n_knowns, n_to = adjoint ? n_knowns : n_unknowns;

    double seeds[N_VARIABLES] = {0.0}, sums[N_VARIABLES] = {0.0};
    bool has_parameters = false;
    for (size_t i = 0; i < n_from; i++) {
        seeds[from[i]] += seed[i];
    }
    for (size_t j = 0; j < n_knowns; j++) {
        has_parameters = has_parameters || is_real_parameter(knowns[j]);
    }

    const double *const x = &s->values[FIRST_STATE], *const u = &s->values[FIRST_INPUT];
    const double *const p = &s->values[FIRST_PARAMETER];
    double partials[ROOM(N_PARTIALS)];
    model_get_partials(s->time, x, u, p, s->integers, partials);
    add_products(adjoint, model_partials, partials, N_PARTIALS, seeds, sums);
    if (has_parameters) {
        double by_parameter[ROOM(N_PARAMETER_PARTIALS)];
        model_get_parameter_partials(s->time, x, u, p, s->integers, by_parameter);
        add_products(adjoint, model_parameter_partials, by_parameter, N_PARAMETER_PARTIALS, seeds, sums);
    }
    for (size_t i = 0; i < n_to; i++) {
        sensitivity[i] = sums[to[i]];
    }
    return STATUS_OK;
}

/* ---- as bytes ---- */

void simulation_serialize(const Simulation *s, unsigned char bytes[])
{
    const int phase = (int)s->phase;
    unsigned char *to = put(bytes, &phase, sizeof phase);
    to = put(to, &s->time, sizeof s->time);
    to = put(to, &s->stop_time, sizeof s->stop_time);
    to = put(to, &s->values[FIRST_STATE], sizeof(double) * N_STATES);
    to = put(to, &s->values[FIRST_INPUT], sizeof(double) * (N_INPUTS + N_PARAMETERS));
    to = put(to, s->slopes, sizeof(double) * N_INPUTS);
    to = put(to, s->integers, sizeof(int) * N_INTEGERS);
    for (int i = 0; i < N_LIMITS; i++) {
        *to++ = s->outside[i] ? 1 : 0;
    }
}

Status simulation_deserialize(Simulation *s, const unsigned char bytes[])
{
    Simulation read;
    simulation_reset(&read);
    int phase;
    const unsigned char *from = take(&phase, bytes, sizeof phase);
    from = take(&read.time, from, sizeof read.time);
    from = take(&read.stop_time, from, sizeof read.stop_time);
    from = take(&read.values[FIRST_STATE], from, sizeof(double) * N_STATES);
    from = take(&read.values[FIRST_INPUT], from, sizeof(double) * (N_INPUTS + N_PARAMETERS));
    from = take(read.slopes, from, sizeof(double) * N_INPUTS);
    from = take(read.integers, from, sizeof(int) * N_INTEGERS);
    bool is_good = (phase == BEFORE_START || phase == RUNNING) && isfinite(read.time) && !isnan(read.stop_time);
    for (int i = 0; i < N_LIMITS; i++) {
        is_good = is_good && *from <= 1;
        read.outside[i] = *from++ != 0;
    }
    for (unsigned i = 0; i < FIRST_OUTPUT; i++) {
        is_good = is_good && (is_derivative(i) || isfinite(read.values[i]));
    }
    for (int i = 0; i < N_INPUTS; i++) {
        is_good = is_good && isfinite(read.slopes[i]);
        read.ramps = read.ramps || read.slopes[i] != 0.0;
    }
    return take_over(s, &read, phase, is_good);
}
