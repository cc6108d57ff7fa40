/* FMI 3.0 for Co-Simulation and Model Exchange. */
#include "stub_model.h"

#include "fmi3Functions.h"

enum {
    ANY = ~0,
    BEFORE = 1 << CREATED | 1 << INITIALIZATION,
    ACTIVE = 1 << EVENT_MODE | 1 << CONTINUOUS_TIME | 1 << STEP_MODE,
    ME_ACTIVE = 1 << EVENT_MODE | 1 << CONTINUOUS_TIME,
    READABLE = 1 << INITIALIZATION | ACTIVE | 1 << TERMINATED,
    SETTABLE = BEFORE | ACTIVE
};

#define REQUIRE(modes) do { if (!allowed(c, __func__, (unsigned)(modes))) return fmi3Error; } while (0)

static void log_message(Stub *s, Status status, const char *category, const char *text, bool as_format)
{
    const fmi3LogMessageCallback logger = (fmi3LogMessageCallback)s->logger;
    (void)as_format; /* in FMI 3 the text is the text */
    if (logger != NULL) logger(s->environment, (fmi3Status)status, category, text);
}

static fmi3Status none(Stub *s, const char *function, size_t n)
{
    if (n == 0) return fmi3OK;
    say(s, ERROR, "%s is not supported", function);
    return fmi3Error;
}

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String names[])
{
    REQUIRE(ANY);
    (void)on, (void)n, (void)names;
    return fmi3OK;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                          fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log)
{
    (void)visible, (void)logging;
    const Stub made = {.log = log_message, .logger = (void (*)(void))log, .environment = environment};
    return create(made, name, token, resources, true);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean event_mode_used, fmi3Boolean early_return_allowed,
                                         const fmi3ValueReference required[], size_t n_required,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update)
{
    (void)visible, (void)logging, (void)required, (void)n_required;
    const Stub made = {.log = log_message, .logger = (void (*)(void))log, .update = (void (*)(void))update,
                       .environment = environment};
    Stub *const s = create(made, name, token, resources, false);
    if (s == NULL) return NULL;
    s->event_mode_used = event_mode_used;
    s->early_allowed = early_return_allowed;
    if (event_mode_used && !s->event_mode) {
        say(s, ERROR, "it has no event mode, but is told that it is used");
        destroy(s);
        return NULL;
    }
    return s;
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                               fmi3Boolean visible, fmi3Boolean logging,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                               fmi3ClockUpdateCallback clock, fmi3LockPreemptionCallback lock,
                                               fmi3UnlockPreemptionCallback unlock)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)environment, (void)log, (void)clock;
    (void)lock, (void)unlock;
    return NULL;
}

void fmi3FreeInstance(fmi3Instance c) { destroy(c); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean has_stop, fmi3Float64 stop)
{
    REQUIRE(1 << CREATED);
    (void)has_stop, (void)stop;
    hear_tolerance(c, has_tolerance, tolerance);
    ((Stub *)c)->car.time = start;
    ((Stub *)c)->car.mode = INITIALIZATION;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c)
{
    REQUIRE(1 << INITIALIZATION);
    const Stub *const s = c;
    return (fmi3Status)finish_initialization(c, s->model_exchange || s->event_mode_used ? EVENT_MODE : STEP_MODE);
}

fmi3Status fmi3EnterEventMode(fmi3Instance c)
{
    REQUIRE(1 << CONTINUOUS_TIME | 1 << STEP_MODE);
    Stub *const s = c;
    if (!s->model_exchange && !s->event_mode_used) return none(s, __func__, 1);
    s->car.mode = EVENT_MODE;
    return fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance c)
{
    REQUIRE(ACTIVE);
    return (fmi3Status)finish(c);
}

fmi3Status fmi3Reset(fmi3Instance c)
{
    REQUIRE(ANY);
    return (fmi3Status)restart(c);
}

/* ---- variables ---- */

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference reference[], size_t n, fmi3Float64 value[],
                          size_t n_values)
{
    REQUIRE(READABLE);
    Status worst = OK;
    size_t at = 0;
    for (size_t i = 0; i < n; at += length(reference[i++])) {
        if (at + length(reference[i]) > n_values) return none(c, "a number of values that does not fit", 1);
        const Status status = get_real(c, reference[i], &value[at]);
        if (status > worst) worst = status;
    }
    return at == n_values ? (fmi3Status)worst : none(c, "a number of values that does not fit", 1);
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference reference[], size_t n, const fmi3Float64 value[],
                          size_t n_values)
{
    REQUIRE(SETTABLE);
    Status worst = OK;
    size_t at = 0;
    for (size_t i = 0; i < n; at += length(reference[i++])) {
        if (at + length(reference[i]) > n_values) return none(c, "a number of values that does not fit", 1);
        const Status status = set_real(c, reference[i], &value[at]);
        if (status > worst) worst = status;
    }
    return at == n_values ? (fmi3Status)worst : none(c, "a number of values that does not fit", 1);
}

/* The enumeration is an Int64. What is real otherwise may be a Float32, or whole: then a number of the units `per_whole`. */

#define GET(name, type) \
    fmi3Status fmi3Get##name(fmi3Instance c, const fmi3ValueReference r[], size_t n, type value[], size_t n_values) \
    { \
        REQUIRE(READABLE); \
        if (n != n_values) return none(c, "fmi3Get" #name " of arrays", 1); \
        for (size_t i = 0; i < n; i++) { \
            int got = 0; \
            if (get_whole(c, r[i], &got) >= DISCARD) return fmi3Error; \
            value[i] = (type)got; \
        } \
        return fmi3OK; \
    }

#define SET(name, type, set) \
    fmi3Status fmi3Set##name(fmi3Instance c, const fmi3ValueReference r[], size_t n, const type value[], size_t n_values) \
    { \
        REQUIRE(SETTABLE); \
        if (n != n_values) return none(c, "fmi3Set" #name " of arrays", 1); \
        for (size_t i = 0; i < n; i++) { \
            if (set(c, r[i], value[i]) >= DISCARD) return fmi3Error; \
        } \
        return fmi3OK; \
    }

fmi3Status fmi3GetFloat32(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Float32 value[], size_t n_values)
{
    REQUIRE(READABLE);
    size_t at = 0;
    for (size_t i = 0; i < n; i++) {
        double wide[4] = {0.0};
        if (at + length(r[i]) > n_values) return none(c, "a number of values that does not fit", 1);
        if (get_real(c, r[i], wide) >= DISCARD) return fmi3Error;
        for (size_t j = 0; j < length(r[i]); j++) value[at++] = (fmi3Float32)wide[j];
    }
    return at == n_values ? fmi3OK : none(c, "a number of values that does not fit", 1);
}

fmi3Status fmi3SetFloat32(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Float32 value[],
                          size_t n_values)
{
    REQUIRE(SETTABLE);
    size_t at = 0;
    for (size_t i = 0; i < n; i++) {
        double wide[4] = {0.0};
        if (at + length(r[i]) > n_values) return none(c, "a number of values that does not fit", 1);
        for (size_t j = 0; j < length(r[i]); j++) wide[j] = value[at++];
        if (set_real(c, r[i], wide) >= DISCARD) return fmi3Error;
    }
    return at == n_values ? fmi3OK : none(c, "a number of values that does not fit", 1);
}

#define WHOLE(name, type) GET(name, type) SET(name, type, set_whole)

WHOLE(Int64, fmi3Int64)
WHOLE(Int32, fmi3Int32)
WHOLE(Int16, fmi3Int16)
WHOLE(UInt64, fmi3UInt64)
SET(Boolean, fmi3Boolean, set_switch)
SET(String, fmi3String, set_text)

/* All other types: there are no variables of them. */

#define NO_GETTER(name, type) \
    fmi3Status fmi3Get##name(fmi3Instance c, const fmi3ValueReference r[], size_t n, type value[], size_t n_values) \
    { \
        (void)r, (void)value, (void)n_values; \
        return none(c, "fmi3Get" #name, n); \
    }

#define NO_SETTER(name, type) \
    fmi3Status fmi3Set##name(fmi3Instance c, const fmi3ValueReference r[], size_t n, const type value[], size_t n_values) \
    { \
        (void)r, (void)value, (void)n_values; \
        return none(c, "fmi3Set" #name, n); \
    }

NO_GETTER(Int8, fmi3Int8)
NO_SETTER(Int8, fmi3Int8)
NO_GETTER(UInt8, fmi3UInt8)
NO_SETTER(UInt8, fmi3UInt8)
NO_GETTER(UInt16, fmi3UInt16)
NO_SETTER(UInt16, fmi3UInt16)
NO_GETTER(UInt32, fmi3UInt32)
NO_SETTER(UInt32, fmi3UInt32)
NO_GETTER(Boolean, fmi3Boolean)
NO_GETTER(String, fmi3String)

fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference r[], size_t n, size_t sizes[], fmi3Binary value[],
                         size_t n_values)
{
    (void)r, (void)sizes, (void)value, (void)n_values;
    return none(c, __func__, n);
}

fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference r[], size_t n, const size_t sizes[],
                         const fmi3Binary value[], size_t n_values)
{
    (void)r, (void)sizes, (void)value, (void)n_values;
    return none(c, __func__, n);
}

fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Clock value[])
{
    (void)r, (void)value;
    return none(c, __func__, n);
}

fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Clock value[])
{
    (void)r, (void)value;
    return none(c, __func__, n);
}

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance c, fmi3ValueReference r, size_t *n)
{
    (void)r, (void)n;
    return none(c, __func__, 1);
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance c, fmi3ValueReference r, size_t elements[],
                                       fmi3ValueReference independents[], size_t elements_of_independents[],
                                       fmi3DependencyKind kinds[], size_t n)
{
    (void)r, (void)elements, (void)independents, (void)elements_of_independents, (void)kinds, (void)n;
    return none(c, __func__, 1);
}

/* ---- the state, saved and restored ---- */

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state)
{
    Stub *const s = c;
    if (!s->save) return none(s, __func__, 1);
    if (*state == NULL) *state = malloc(sizeof(Car));
    memcpy(*state, &s->car, sizeof(Car));
    return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state)
{
    Stub *const s = c;
    if (!s->save) return none(s, __func__, 1);
    memcpy(&s->car, state, sizeof(Car));
    return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size)
{
    (void)state;
    *size = sizeof(Car);
    return none(c, __func__, !((Stub *)c)->save);
}

fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    if (!((Stub *)c)->save || size < sizeof(Car)) return none(c, __func__, 1);
    memcpy(bytes, state, sizeof(Car));
    return fmi3OK;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    if (!((Stub *)c)->save || size < sizeof(Car)) return none(c, __func__, 1);
    if (*state == NULL) *state = malloc(sizeof(Car));
    memcpy(*state, bytes, sizeof(Car));
    return fmi3OK;
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                        const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                        size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity)
{
    (void)unknowns, (void)n_unknowns, (void)knowns, (void)n_knowns, (void)seed, (void)n_seed, (void)sensitivity;
    return none(c, __func__, n_sensitivity);
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                    const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                    size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity)
{
    (void)unknowns, (void)n_unknowns, (void)knowns, (void)n_knowns, (void)seed, (void)n_seed, (void)sensitivity;
    return none(c, __func__, n_sensitivity);
}

fmi3Status fmi3EnterConfigurationMode(fmi3Instance c) { return none(c, __func__, 1); }
fmi3Status fmi3ExitConfigurationMode(fmi3Instance c) { return none(c, __func__, 1); }

/* ---- clocks: there are none ---- */

fmi3Status fmi3GetIntervalDecimal(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Float64 intervals[],
                                  fmi3IntervalQualifier qualifiers[])
{
    (void)r, (void)intervals, (void)qualifiers;
    return none(c, __func__, n);
}

fmi3Status fmi3GetIntervalFraction(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3UInt64 counters[],
                                   fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[])
{
    (void)r, (void)counters, (void)resolutions, (void)qualifiers;
    return none(c, __func__, n);
}

fmi3Status fmi3GetShiftDecimal(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Float64 shifts[])
{
    (void)r, (void)shifts;
    return none(c, __func__, n);
}

fmi3Status fmi3GetShiftFraction(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3UInt64 counters[],
                                fmi3UInt64 resolutions[])
{
    (void)r, (void)counters, (void)resolutions;
    return none(c, __func__, n);
}

fmi3Status fmi3SetIntervalDecimal(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Float64 intervals[])
{
    (void)r, (void)intervals;
    return none(c, __func__, n);
}

fmi3Status fmi3SetIntervalFraction(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3UInt64 counters[],
                                   const fmi3UInt64 resolutions[])
{
    (void)r, (void)counters, (void)resolutions;
    return none(c, __func__, n);
}

fmi3Status fmi3SetShiftDecimal(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Float64 shifts[])
{
    (void)r, (void)shifts;
    return none(c, __func__, n);
}

fmi3Status fmi3SetShiftFraction(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3UInt64 counters[],
                                const fmi3UInt64 resolutions[])
{
    (void)r, (void)counters, (void)resolutions;
    return none(c, __func__, n);
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance c, fmi3ValueReference clock, fmi3Float64 time)
{
    (void)clock, (void)time;
    return none(c, __func__, 1);
}

/* ---- events ---- */

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance c)
{
    REQUIRE(1 << INITIALIZATION | 1 << EVENT_MODE);
    return fmi3OK;
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *need_update, fmi3Boolean *terminate,
                                    fmi3Boolean *nominals_changed, fmi3Boolean *values_changed,
                                    fmi3Boolean *next_event_time_defined, fmi3Float64 *next_event_time)
{
    REQUIRE(1 << EVENT_MODE);
    Stub *const s = c;
    *need_update = *nominals_changed = false;
    *values_changed = handle_events(s);
    *terminate = s->car.terminated;
    *next_event_time_defined = s->time_event && !s->car.braked;
    *next_event_time = *next_event_time_defined ? s->car.when : 0.0;
    return fmi3OK;
}

/* ---- Model Exchange ---- */

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance c)
{
    REQUIRE(1 << EVENT_MODE);
    ((Stub *)c)->car.mode = CONTINUOUS_TIME;
    return fmi3OK;
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean no_set_before, fmi3Boolean *enter_event_mode,
                                       fmi3Boolean *terminate)
{
    REQUIRE(1 << CONTINUOUS_TIME);
    (void)no_set_before;
    *enter_event_mode = step_event_due(c);
    *terminate = ((Stub *)c)->car.terminated;
    return fmi3OK;
}

fmi3Status fmi3SetTime(fmi3Instance c, fmi3Float64 time)
{
    REQUIRE(1 << CONTINUOUS_TIME);
    ((Stub *)c)->car.time = time;
    return fmi3OK;
}

fmi3Status fmi3SetContinuousStates(fmi3Instance c, const fmi3Float64 x[], size_t n)
{
    REQUIRE(1 << CONTINUOUS_TIME);
    Stub *const s = c;
    if (n != STATES) return none(s, "a number of states other than 6", 1);
    for (int i = 0; i < STATES; i++) s->car.state[i] = taken(s, i, x[i]);
    return fmi3OK;
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance c, fmi3Float64 dx[], size_t n)
{
    REQUIRE(ME_ACTIVE | 1 << INITIALIZATION);
    Stub *const s = c;
    if (n != STATES) return none(s, "a number of states other than 6", 1);
    const Status status = act(s, "step");
    derivatives(s, dx);
    for (int i = 0; i < STATES; i++) dx[i] *= s->scale[i];
    return (fmi3Status)status;
}

fmi3Status fmi3GetEventIndicators(fmi3Instance c, fmi3Float64 value[], size_t n)
{
    REQUIRE(ME_ACTIVE | 1 << INITIALIZATION);
    if (n == 2) indicators(c, value);
    return n == 2 || n == 0 ? fmi3OK : fmi3Error;
}

fmi3Status fmi3GetContinuousStates(fmi3Instance c, fmi3Float64 x[], size_t n)
{
    REQUIRE(ME_ACTIVE | 1 << INITIALIZATION);
    Stub *const s = c;
    if (n != STATES) return none(s, "a number of states other than 6", 1);
    for (int i = 0; i < STATES; i++) x[i] = shown(s, i, s->car.state[i]);
    return fmi3OK;
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance c, fmi3Float64 nominal[], size_t n)
{
    REQUIRE(ME_ACTIVE | BEFORE);
    for (size_t i = 0; i < n; i++) nominal[i] = 1.0;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t *n)
{
    REQUIRE(ANY);
    *n = isinf(((Stub *)c)->end_stop) ? 0 : 2;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t *n)
{
    REQUIRE(ANY);
    *n = STATES;
    return fmi3OK;
}

/* ---- Co-Simulation ---- */

fmi3Status fmi3EnterStepMode(fmi3Instance c)
{
    REQUIRE(1 << EVENT_MODE);
    Stub *const s = c;
    if (!s->event_mode_used) return none(s, __func__, 1);
    s->car.mode = STEP_MODE;
    return fmi3OK;
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Int32 orders[],
                                    fmi3Float64 values[], size_t n_values)
{
    (void)r, (void)orders, (void)values, (void)n_values;
    return none(c, __func__, n);
}

#ifndef WITHOUT_DO_STEP
/* A step ends early, where that is allowed: at an event in it; else, every other step, at its half. `early_always` does
 * the latter even where it is not allowed. */
fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 h, fmi3Boolean no_set_before,
                      fmi3Boolean *event_handling_needed, fmi3Boolean *terminate, fmi3Boolean *early_return,
                      fmi3Float64 *last_successful_time)
{
    Stub *const s = c;
    Car *const car = &s->car;
    *event_handling_needed = *terminate = *early_return = false;
    *last_successful_time = time + h;
    if (s->nothing) return fmi3OK;
    REQUIRE(1 << STEP_MODE);
    (void)no_set_before;
    *last_successful_time = time;
    const Status status = begin_step(s, time, h);
    if ((unsigned)status >= DISCARD) return (fmi3Status)status;
    if (car->terminated) {
        *terminate = true;
        return (fmi3Status)status;
    }

    double end = time + h;
    const bool event_within = s->event_mode_used && s->time_event && !car->braked && car->when < end - EPSILON
                              && car->when > time + EPSILON;
    if (event_within && s->early_return && s->early_allowed) {
        end = car->when;
        *early_return = true;
    } else if ((s->early_always || (s->early_return && s->early_allowed)) && car->steps % 2 == 0) {
        end = time + h / 2;
        *early_return = true;
    }
    if (s->intermediate_update && s->update != NULL) {
        const double at = time + (end - time) / 2;
        bool requested = false;
        fmi3Float64 until = end;
        advance(s, at);
        car->steps--;
        ((fmi3IntermediateUpdateCallback)s->update)(s->environment, at, false, true, true, s->early_allowed, &requested,
                                                    &until);
        if (requested && s->early_allowed && until < end - EPSILON) {
            end = fmax(until, at);
            *early_return = true;
        }
    }
    if (end > car->time + EPSILON) advance(s, end);
    double value[2];
    indicators(s, value);
    *event_handling_needed = s->event_mode_used
                             && (time_event_due(s) || step_event_due(s) || value[0] <= 0.0 || value[1] <= 0.0);
    *last_successful_time = car->last_successful_time = car->time;
    return (fmi3Status)status;
}
#endif
