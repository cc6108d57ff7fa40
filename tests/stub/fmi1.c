/* FMI 1.0 for Co-Simulation and Model Exchange. MODEL is the model identifier, with which all names begin. */
#include "stub_model.h"

#include "fmi1Functions.h"

#define JOIN(model, name) model##_##name
#define NAMED(model, name) JOIN(model, name)
#define FMI(name) NAMED(MODEL, name)
#define REQUIRE(name, modes) do { if (!allowed(c, name, (unsigned)(modes))) return fmi1Error; } while (0)

/* Model Exchange of FMI 1.0 has no modes: all is allowed that FMI 2.0 allows in one of two. */
enum { ANY = ~0, BEFORE = 1 << CREATED, ACTIVE = 1 << STEP_MODE | 1 << CONTINUOUS_TIME,
       READABLE = BEFORE | ACTIVE | 1 << TERMINATED, SETTABLE = BEFORE | ACTIVE, ME_ACTIVE = 1 << CONTINUOUS_TIME };

static void log_message(Stub *s, Status status, const char *category, const char *text, bool as_format)
{
    const fmi1CallbackLogger logger = (fmi1CallbackLogger)s->logger;
    if (logger == NULL) return;
    if (as_format) logger(s->environment, s->name, (fmi1Status)status, category, text);
    else logger(s->environment, s->name, (fmi1Status)status, category, "%s", text);
}

#pragma GCC visibility push(default) /* all that is not static, to the end */

const char *FMI(fmiGetTypesPlatform)(void) { return "standard32"; }
const char *FMI(fmiGetVersion)(void) { return "1.0"; }

fmi1Status FMI(fmiSetDebugLogging)(fmi1Component c, fmi1Boolean on)
{
    REQUIRE("fmiSetDebugLogging", ANY);
    (void)on;
    return fmi1OK;
}

fmi1Component FMI(fmiInstantiateSlave)(fmi1String name, fmi1String guid, fmi1String location, fmi1String mime_type,
                                       fmi1Real timeout, fmi1Boolean visible, fmi1Boolean interactive,
                                       fmi1CallbackFunctions functions, fmi1Boolean logging)
{
    (void)mime_type, (void)timeout, (void)visible, (void)interactive, (void)logging;
    char resources[4096];
    snprintf(resources, sizeof resources, "%s/resources", location == NULL ? "" : location);
    const Stub made = {.log = log_message, .logger = (void (*)(void))functions.logger};
    Stub *const s = create(made, name, guid, resources, false);
    if (s != NULL) s->environment = s; /* the logger of FMI 1 is given the component */
    return s;
}

fmi1Status FMI(fmiInitializeSlave)(fmi1Component c, fmi1Real start, fmi1Boolean has_stop, fmi1Real stop)
{
    REQUIRE("fmiInitializeSlave", BEFORE);
    (void)has_stop, (void)stop;
    ((Stub *)c)->car.time = start;
    return (fmi1Status)finish_initialization(c, STEP_MODE);
}

fmi1Status FMI(fmiTerminateSlave)(fmi1Component c)
{
    REQUIRE("fmiTerminateSlave", 1 << STEP_MODE);
    return (fmi1Status)finish(c);
}

fmi1Status FMI(fmiResetSlave)(fmi1Component c)
{
    REQUIRE("fmiResetSlave", ANY);
    return (fmi1Status)restart(c);
}

void FMI(fmiFreeSlaveInstance)(fmi1Component c) { destroy(c); }

#define EACH(name, modes, call) \
    REQUIRE(name, modes); \
    Status worst = OK; \
    for (size_t i = 0; i < n; i++) { \
        const Status status = call; \
        if (status > worst) worst = status; \
    } \
    return (fmi1Status)worst;

fmi1Status FMI(fmiGetReal)(fmi1Component c, const fmi1ValueReference reference[], size_t n, fmi1Real value[])
{
    EACH("fmiGetReal", READABLE, get_real(c, reference[i], &value[i]))
}

fmi1Status FMI(fmiSetReal)(fmi1Component c, const fmi1ValueReference reference[], size_t n, const fmi1Real value[])
{
    EACH("fmiSetReal", SETTABLE, set_real(c, reference[i], &value[i]))
}

fmi1Status FMI(fmiGetInteger)(fmi1Component c, const fmi1ValueReference reference[], size_t n, fmi1Integer value[])
{
    EACH("fmiGetInteger", READABLE, get_whole(c, reference[i], &value[i]))
}

fmi1Status FMI(fmiSetInteger)(fmi1Component c, const fmi1ValueReference reference[], size_t n, const fmi1Integer value[])
{
    EACH("fmiSetInteger", SETTABLE, set_whole(c, reference[i], value[i]))
}

static fmi1Status none(Stub *s, const char *function, size_t n)
{
    if (n == 0) return fmi1OK;
    say(s, ERROR, "%s is not supported", function);
    return fmi1Error;
}

fmi1Status FMI(fmiGetBoolean)(fmi1Component c, const fmi1ValueReference r[], size_t n, fmi1Boolean value[])
{
    (void)r, (void)value;
    return none(c, "fmiGetBoolean", n);
}

fmi1Status FMI(fmiGetString)(fmi1Component c, const fmi1ValueReference r[], size_t n, fmi1String value[])
{
    (void)r, (void)value;
    return none(c, "fmiGetString", n);
}

fmi1Status FMI(fmiSetBoolean)(fmi1Component c, const fmi1ValueReference r[], size_t n, const fmi1Boolean value[])
{
    EACH("fmiSetBoolean", SETTABLE, set_switch(c, r[i], value[i] != 0))
}

fmi1Status FMI(fmiSetString)(fmi1Component c, const fmi1ValueReference r[], size_t n, const fmi1String value[])
{
    EACH("fmiSetString", SETTABLE, set_text(c, r[i], value[i]))
}

fmi1Status FMI(fmiSetRealInputDerivatives)(fmi1Component c, const fmi1ValueReference r[], size_t n,
                                           const fmi1Integer order[], const fmi1Real value[])
{
    (void)r, (void)order, (void)value;
    return none(c, "fmiSetRealInputDerivatives", n);
}

fmi1Status FMI(fmiGetRealOutputDerivatives)(fmi1Component c, const fmi1ValueReference r[], size_t n,
                                            const fmi1Integer order[], fmi1Real value[])
{
    (void)r, (void)order, (void)value;
    return none(c, "fmiGetRealOutputDerivatives", n);
}

#ifndef WITHOUT_DO_STEP
fmi1Status FMI(fmiDoStep)(fmi1Component c, fmi1Real time, fmi1Real h, fmi1Boolean new_step)
{
    Stub *const s = c;
    if (s->nothing) return fmi1OK;
    REQUIRE("fmiDoStep", 1 << STEP_MODE);
    (void)new_step;
    const Status status = begin_step(s, time, h);
    if ((unsigned)status >= DISCARD) return (fmi1Status)status;
    if (s->car.terminated) {
        say(s, DISCARD, "it asks for the end of the simulation at t = %g s", time);
        return fmi1Discard;
    }
    advance(s, time + h);
    s->car.last_successful_time = s->car.time;
    return (fmi1Status)status;
}
#endif

/* ---- Model Exchange ---- */

const char *FMI(fmiGetModelTypesPlatform)(void) { return "standard32"; }

fmi1Component FMI(fmiInstantiateModel)(fmi1String name, fmi1String guid, fmi1CallbackFunctions functions,
                                       fmi1Boolean logging)
{
    (void)logging;
    const Stub made = {.log = log_message, .logger = (void (*)(void))functions.logger};
    Stub *const s = create(made, name, guid, NULL, true);
    if (s != NULL) s->environment = s;
    return s;
}

void FMI(fmiFreeModelInstance)(fmi1Component c) { destroy(c); }

static void handle(Stub *s, fmi1EventInfo *info)
{
    *info = (fmi1EventInfo){.stateValuesChanged = handle_events(s), .terminateSimulation = s->car.terminated};
    info->iterationConverged = true;
    info->upcomingTimeEvent = s->time_event && !s->car.braked;
    info->nextEventTime = info->upcomingTimeEvent ? s->car.when : 0.0;
}

fmi1Status FMI(fmiInitialize)(fmi1Component c, fmi1Boolean has_tolerance, fmi1Real tolerance, fmi1EventInfo *info)
{
    REQUIRE("fmiInitialize", BEFORE);
    (void)has_tolerance, (void)tolerance;
    const Status status = finish_initialization(c, CONTINUOUS_TIME);
    if (status < DISCARD) handle(c, info);
    return (fmi1Status)status;
}

fmi1Status FMI(fmiEventUpdate)(fmi1Component c, fmi1Boolean intermediate_results, fmi1EventInfo *info)
{
    REQUIRE("fmiEventUpdate", ME_ACTIVE);
    (void)intermediate_results;
    handle(c, info);
    return fmi1OK;
}

fmi1Status FMI(fmiCompletedIntegratorStep)(fmi1Component c, fmi1Boolean *event)
{
    REQUIRE("fmiCompletedIntegratorStep", ME_ACTIVE);
    *event = step_event_due(c) || ((Stub *)c)->car.terminated;
    return fmi1OK;
}

fmi1Status FMI(fmiSetTime)(fmi1Component c, fmi1Real time)
{
    REQUIRE("fmiSetTime", BEFORE | ME_ACTIVE);
    ((Stub *)c)->car.time = time;
    return fmi1OK;
}

fmi1Status FMI(fmiSetContinuousStates)(fmi1Component c, const fmi1Real x[], size_t n)
{
    REQUIRE("fmiSetContinuousStates", ME_ACTIVE);
    Stub *const s = c;
    if (n != STATES) return none(s, "a number of states other than 6", 1);
    for (int i = 0; i < STATES; i++) s->car.state[i] = taken(s, i, x[i]);
    return fmi1OK;
}

fmi1Status FMI(fmiGetContinuousStates)(fmi1Component c, fmi1Real x[], size_t n)
{
    REQUIRE("fmiGetContinuousStates", ME_ACTIVE);
    Stub *const s = c;
    if (n != STATES) return none(s, "a number of states other than 6", 1);
    for (int i = 0; i < STATES; i++) x[i] = shown(s, i, s->car.state[i]);
    return fmi1OK;
}

fmi1Status FMI(fmiGetDerivatives)(fmi1Component c, fmi1Real dx[], size_t n)
{
    REQUIRE("fmiGetDerivatives", ME_ACTIVE);
    Stub *const s = c;
    if (n != STATES) return none(s, "a number of states other than 6", 1);
    const Status status = act(s, "step");
    derivatives(s, dx);
    for (int i = 0; i < STATES; i++) dx[i] *= s->scale[i];
    return (fmi1Status)status;
}

fmi1Status FMI(fmiGetEventIndicators)(fmi1Component c, fmi1Real value[], size_t n)
{
    REQUIRE("fmiGetEventIndicators", ME_ACTIVE);
    if (n == 2) indicators(c, value);
    return n == 2 || n == 0 ? fmi1OK : fmi1Error;
}

fmi1Status FMI(fmiGetNominalContinuousStates)(fmi1Component c, fmi1Real nominal[], size_t n)
{
    REQUIRE("fmiGetNominalContinuousStates", BEFORE | ME_ACTIVE);
    for (size_t i = 0; i < n; i++) nominal[i] = 1.0;
    return fmi1OK;
}

fmi1Status FMI(fmiGetStateValueReferences)(fmi1Component c, fmi1ValueReference reference[], size_t n)
{
    REQUIRE("fmiGetStateValueReferences", ANY);
    for (size_t i = 0; i < n; i++) reference[i] = (fmi1ValueReference)i;
    return fmi1OK;
}

fmi1Status FMI(fmiTerminate)(fmi1Component c)
{
    REQUIRE("fmiTerminate", ME_ACTIVE);
    return (fmi1Status)finish(c);
}

/* ---- Co-Simulation ---- */

fmi1Status FMI(fmiCancelStep)(fmi1Component c) { return none(c, "fmiCancelStep", 1); }

fmi1Status FMI(fmiGetStatus)(fmi1Component c, const fmi1StatusKind kind, fmi1Status *value)
{
    (void)c;
    *value = fmi1OK;
    return kind == fmi1DoStepStatus ? fmi1OK : fmi1Discard;
}

fmi1Status FMI(fmiGetRealStatus)(fmi1Component c, const fmi1StatusKind kind, fmi1Real *value)
{
    *value = ((Stub *)c)->car.last_successful_time;
    return kind == fmi1LastSuccessfulTime ? fmi1OK : fmi1Discard;
}

fmi1Status FMI(fmiGetIntegerStatus)(fmi1Component c, const fmi1StatusKind kind, fmi1Integer *value)
{
    (void)c, (void)kind, (void)value;
    return fmi1Discard;
}

fmi1Status FMI(fmiGetBooleanStatus)(fmi1Component c, const fmi1StatusKind kind, fmi1Boolean *value)
{
    (void)c, (void)kind, (void)value;
    return fmi1Discard;
}

fmi1Status FMI(fmiGetStringStatus)(fmi1Component c, const fmi1StatusKind kind, fmi1String *value)
{
    (void)c;
    *value = "";
    return kind == fmi1PendingStatus ? fmi1OK : fmi1Discard;
}
