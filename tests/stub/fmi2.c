/* FMI 2.0 for Co-Simulation and Model Exchange. */
#include "stub_model.h"

#include "fmi2Functions.h"

enum {
    ANY = ~0,
    BEFORE = 1 << CREATED | 1 << INITIALIZATION,
    ME_ACTIVE = 1 << EVENT_MODE | 1 << CONTINUOUS_TIME,
    READABLE = 1 << INITIALIZATION | 1 << STEP_MODE | ME_ACTIVE | 1 << TERMINATED,
    SETTABLE = BEFORE | 1 << STEP_MODE | ME_ACTIVE
};

#define REQUIRE(modes) do { if (!allowed(c, __func__, (unsigned)(modes))) return fmi2Error; } while (0)

static void log_message(Stub *s, Status status, const char *category, const char *text, bool as_format)
{
    const fmi2CallbackLogger logger = (fmi2CallbackLogger)s->logger;
    if (logger == NULL) return;
    if (as_format) logger(s->environment, s->name, (fmi2Status)status, category, text);
    else logger(s->environment, s->name, (fmi2Status)status, category, "%s", text);
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[])
{
    REQUIRE(ANY);
    (void)on, (void)n, (void)names;
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)visible, (void)logging;
    const Stub made = {.log = log_message, .logger = (void (*)(void))functions->logger,
                       .environment = functions->componentEnvironment};
    return create(made, name, guid, resources, type == fmi2ModelExchange);
}

void fmi2FreeInstance(fmi2Component c) { destroy(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean has_stop, fmi2Real stop)
{
    REQUIRE(1 << CREATED);
    (void)has_stop, (void)stop;
    ((Stub *)c)->car.time = start;
    hear_tolerance(c, has_tolerance, tolerance);
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    REQUIRE(1 << CREATED);
    ((Stub *)c)->car.mode = INITIALIZATION;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    REQUIRE(1 << INITIALIZATION);
    return (fmi2Status)finish_initialization(c, ((Stub *)c)->model_exchange ? EVENT_MODE : STEP_MODE);
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    REQUIRE(1 << STEP_MODE | ME_ACTIVE);
    return (fmi2Status)finish(c);
}

fmi2Status fmi2Reset(fmi2Component c)
{
    REQUIRE(ANY);
    return (fmi2Status)restart(c);
}

/* ---- variables ---- */

#define EACH(modes, call) \
    REQUIRE(modes); \
    Status worst = OK; \
    for (size_t i = 0; i < n; i++) { \
        const Status status = call; \
        if (status > worst) worst = status; \
    } \
    return (fmi2Status)worst;

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference reference[], size_t n, fmi2Real value[])
{
    EACH(READABLE, get_real(c, reference[i], &value[i]))
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference reference[], size_t n, const fmi2Real value[])
{
    EACH(SETTABLE, set_real(c, reference[i], &value[i]))
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference reference[], size_t n, fmi2Integer value[])
{
    EACH(READABLE, get_whole(c, reference[i], &value[i]))
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference reference[], size_t n, const fmi2Integer value[])
{
    EACH(SETTABLE, set_whole(c, reference[i], value[i]))
}

static fmi2Status none(Stub *s, const char *function, size_t n)
{
    if (n == 0) return fmi2OK;
    say(s, ERROR, "%s is not supported", function);
    return fmi2Error;
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Boolean value[])
{
    (void)r, (void)value;
    return none(c, __func__, n);
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2String value[])
{
    (void)r, (void)value;
    return none(c, __func__, n);
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Boolean value[])
{
    EACH(SETTABLE, set_switch(c, r[i], value[i] != 0))
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2String value[])
{
    EACH(SETTABLE, set_text(c, r[i], value[i]))
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t n_unknown,
                                        const fmi2ValueReference known[], size_t n_known, const fmi2Real d_known[],
                                        fmi2Real d_unknown[])
{
    (void)unknown, (void)n_unknown, (void)known, (void)n_known, (void)d_known, (void)d_unknown;
    return none(c, __func__, 1);
}

/* ---- the state, saved and restored ---- */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    Stub *const s = c;
    if (!s->save) return none(s, __func__, 1);
    if (*state == NULL) *state = malloc(sizeof(Car));
    memcpy(*state, &s->car, sizeof(Car));
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    Stub *const s = c;
    if (!s->save) return none(s, __func__, 1);
    memcpy(&s->car, state, sizeof(Car));
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    (void)state;
    *size = sizeof(Car);
    return none(c, __func__, !((Stub *)c)->save);
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    if (!((Stub *)c)->save || size < sizeof(Car)) return none(c, __func__, 1);
    memcpy(bytes, state, sizeof(Car));
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    if (!((Stub *)c)->save || size < sizeof(Car)) return none(c, __func__, 1);
    if (*state == NULL) *state = malloc(sizeof(Car));
    memcpy(*state, bytes, sizeof(Car));
    return fmi2OK;
}

/* ---- Model Exchange ---- */

fmi2Status fmi2EnterEventMode(fmi2Component c)
{
    REQUIRE(ME_ACTIVE);
    ((Stub *)c)->car.mode = EVENT_MODE;
    return fmi2OK;
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info)
{
    REQUIRE(1 << EVENT_MODE);
    Stub *const s = c;
    *info = (fmi2EventInfo){.valuesOfContinuousStatesChanged = handle_events(s), .terminateSimulation = s->car.terminated};
    info->nextEventTimeDefined = s->time_event && !s->car.braked;
    info->nextEventTime = info->nextEventTimeDefined ? s->car.when : 0.0;
    return fmi2OK;
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c)
{
    REQUIRE(1 << EVENT_MODE);
    ((Stub *)c)->car.mode = CONTINUOUS_TIME;
    return fmi2OK;
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean no_set_before, fmi2Boolean *enter_event_mode,
                                       fmi2Boolean *terminate)
{
    REQUIRE(1 << CONTINUOUS_TIME);
    (void)no_set_before;
    *enter_event_mode = step_event_due(c);
    *terminate = ((Stub *)c)->car.terminated;
    return fmi2OK;
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time)
{
    REQUIRE(ME_ACTIVE);
    ((Stub *)c)->car.time = time;
    return fmi2OK;
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n)
{
    REQUIRE(1 << CONTINUOUS_TIME);
    Stub *const s = c;
    if (n != STATES) return none(s, "a number of states other than 6", 1);
    for (int i = 0; i < STATES; i++) s->car.state[i] = taken(s, i, x[i]);
    return fmi2OK;
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real dx[], size_t n)
{
    REQUIRE(ME_ACTIVE);
    Stub *const s = c;
    if (n != STATES) return none(s, "a number of states other than 6", 1);
    const Status status = act(s, "step");
    derivatives(s, dx);
    for (int i = 0; i < STATES; i++) dx[i] *= s->scale[i];
    return (fmi2Status)status;
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real value[], size_t n)
{
    REQUIRE(ME_ACTIVE);
    if (n == 2) indicators(c, value);
    return n == 2 || n == 0 ? fmi2OK : fmi2Error;
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n)
{
    REQUIRE(ME_ACTIVE | 1 << INITIALIZATION);
    Stub *const s = c;
    if (n != STATES) return none(s, "a number of states other than 6", 1);
    for (int i = 0; i < STATES; i++) x[i] = shown(s, i, s->car.state[i]);
    return fmi2OK;
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominal[], size_t n)
{
    REQUIRE(ME_ACTIVE | BEFORE);
    for (size_t i = 0; i < n; i++) nominal[i] = 1.0;
    return fmi2OK;
}

/* ---- Co-Simulation ---- */

#ifndef WITHOUT_DO_STEP
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real h, fmi2Boolean no_set_before)
{
    Stub *const s = c;
    if (s->nothing) return fmi2OK;
    REQUIRE(1 << STEP_MODE);
    (void)no_set_before;
    const Status status = begin_step(s, time, h);
    if ((unsigned)status >= DISCARD) return (fmi2Status)status;
    if (s->car.terminated) {
        say(s, DISCARD, "it asks for the end of the simulation at t = %g s", time);
        return fmi2Discard;
    }
    advance(s, time + h);
    s->car.last_successful_time = s->car.time;
    return (fmi2Status)status;
}
#endif

fmi2Status fmi2CancelStep(fmi2Component c) { return none(c, __func__, 1); }

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer order[],
                                       const fmi2Real value[])
{
    (void)r, (void)order, (void)value;
    return none(c, __func__, n);
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer order[],
                                        fmi2Real value[])
{
    (void)r, (void)order, (void)value;
    return none(c, __func__, n);
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
    *value = is(c, "pending") ? fmi2Pending : fmi2OK;
    return kind == fmi2DoStepStatus ? fmi2OK : fmi2Discard;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    *value = ((Stub *)c)->car.last_successful_time;
    return kind == fmi2LastSuccessfulTime ? fmi2OK : fmi2Discard;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    *value = ((Stub *)c)->car.terminated;
    return kind == fmi2Terminated ? fmi2OK : fmi2Discard;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{
    *value = "";
    (void)c;
    return kind == fmi2PendingStatus ? fmi2OK : fmi2Discard;
}
