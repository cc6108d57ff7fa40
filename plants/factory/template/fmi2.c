/* FMI 2.0 for Co-Simulation and Model Exchange, for any model: each function says when it may be called (FMI 2.0.4,
 * sections 3.2.3 and 4.2.4) and hands over to instance.h. */
#include "fmi2Functions.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "instance.h"

/* The types that instance.h takes for granted. */
static_assert(sizeof(fmi2ValueReference) == sizeof(unsigned), "value references are unsigned");
static_assert((int)fmi2OK == STATUS_OK && (int)fmi2Warning == STATUS_WARNING && (int)fmi2Discard == STATUS_DISCARD
                  && (int)fmi2Error == STATUS_ERROR,
              "both number a status alike");

enum {
    SETTABLE = INSTANTIATED | INITIALIZATION | EVENT_MODE | CONTINUOUS_TIME | STEP_MODE,
    SETTABLE_DISCRETE = INSTANTIATED | INITIALIZATION | EVENT_MODE | STEP_MODE,
    READABLE = INITIALIZATION | STARTED,
    STEPPED = STEP_MODE | FAILED | TERMINATED
};

typedef struct {
    Instance base; /* first, so that a pointer to one is a pointer to the other */
    fmi2CallbackFunctions callbacks;
    char name[]; /* allocated together with the rest */
} Fmi2Instance;

static void log_message(const Instance *base, Status status, const char *category, const char *text)
{
    const Fmi2Instance *const instance = (const Fmi2Instance *)base;
    if (instance->callbacks.logger == NULL) return;
    /* The importer takes the message for a printf format: a percent sign must be doubled. */
    char format[2 * LOG_SIZE];
    size_t length = 0;
    for (const char *c = text; *c != '\0'; c++) {
        if (*c == '%') format[length++] = '%';
        format[length++] = *c;
    }
    format[length] = '\0';
    instance->callbacks.logger(instance->callbacks.componentEnvironment, base->name, (fmi2Status)status, category,
                               format);
}

/* ---- general ---- */

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t nCategories, const fmi2String names[])
{
    static const Function function = {"fmi2SetDebugLogging", ANY_MODE, ANY_MODE};
    return (fmi2Status)instance_set_logging(c, &function, loggingOn, nCategories, names);
}

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                              fmi2String fmuResourceLocation, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean loggingOn)
{
    static const Function function = {"fmi2Instantiate", ANY_MODE, ANY_MODE};
    (void)visible;
    if (functions == NULL) return NULL;

    /* Problems are always reported; the debug switch is for the rest. */
    Fmi2Instance made = {
        .base = {.now = {.interface = fmuType == fmi2ModelExchange ? MODEL_EXCHANGE : CO_SIMULATION,
                         .mode = INSTANTIATED},
                 .name = instanceName == NULL ? "?" : instanceName,
                 .logged_least = LOG_PROBLEMS,
                 .logged = loggingOn ? LOG_ALL : LOG_PROBLEMS,
                 .log = log_message,
                 .allocate = functions->allocateMemory,
                 .release = functions->freeMemory},
        .callbacks = *functions,
    };
    if (instanceName == NULL || instanceName[0] == '\0') {
        instance_refuse(&made.base, &function, "the instance has no name");
        return NULL;
    }
    if (fmuType != fmi2CoSimulation && !(fmuType == fmi2ModelExchange && OFFERS_MODEL_EXCHANGE)) {
        instance_refuse(&made.base, &function, "this FMU is for " INTERFACES " only");
        return NULL;
    }
    if (!instance_may_start(&made.base, &function, fmuGUID)) return NULL;
    if (made.base.allocate == NULL || made.base.release == NULL) {
        made.base.allocate = calloc;
        made.base.release = free;
    }
    Fmi2Instance *const instance = made.base.allocate(1, sizeof(Fmi2Instance) + strlen(instanceName) + 1);
    if (instance == NULL) {
        instance_refuse(&made.base, &function, "out of memory");
        return NULL;
    }
    memcpy(instance, &made, sizeof made);
    strcpy(instance->name, instanceName);
    instance->base.name = instance->name;
    if (!instance_open(&instance->base, &function, fmuResourceLocation)) {
        fmi2FreeInstance(instance);
        return NULL;
    }
    return instance;
}

void fmi2FreeInstance(fmi2Component c)
{
    Instance *const instance = c;
    if (instance != NULL) {
        instance_close(instance);
        instance->release(instance);
    }
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance, fmi2Real startTime,
                               fmi2Boolean stopTimeDefined, fmi2Real stopTime)
{
    static const Function function = {"fmi2SetupExperiment", INSTANTIATED, INSTANTIATED};
    return (fmi2Status)instance_setup(c, &function, toleranceDefined, tolerance, startTime, stopTimeDefined, stopTime);
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    static const Function function = {"fmi2EnterInitializationMode", INSTANTIATED, INSTANTIATED};
    return (fmi2Status)instance_change_mode(c, &function, INITIALIZATION);
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    static const Function function = {"fmi2ExitInitializationMode", INITIALIZATION, INITIALIZATION};
    return (fmi2Status)instance_start(c, &function);
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    static const Function function = {"fmi2Terminate", EVENT_MODE | CONTINUOUS_TIME | FAILED, STEP_MODE | FAILED};
    return (fmi2Status)instance_terminate(c, &function);
}

fmi2Status fmi2Reset(fmi2Component c)
{
    static const Function function = {"fmi2Reset", ANY_MODE, ANY_MODE};
    return (fmi2Status)instance_reset(c, &function);
}

/* ---- values ---- */

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[])
{
    static const Function function = {"fmi2GetReal", READABLE, READABLE};
    return (fmi2Status)instance_get_reals(c, &function, vr, nvr, value);
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[])
{
    static const Function function = {"fmi2SetReal", SETTABLE, SETTABLE};
    return (fmi2Status)instance_set_reals(c, &function, vr, nvr, value);
}

/* Enumerations are read and written as integers, too. */
fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Integer value[])
{
    static const Function function = {"fmi2GetInteger", READABLE, READABLE};
    Instance *const instance = instance_enter(c, &function);
    if (instance == NULL) return fmi2Error;
    if (nvr > 0 && (vr == NULL || value == NULL)) return (fmi2Status)instance_refuse_null(instance, &function);
    for (size_t i = 0; i < nvr; i++) {
        const Status status = simulation_get_integer(&instance->now.simulation, vr[i], &value[i]);
        if (status != STATUS_OK) return (fmi2Status)instance_report(instance, &function, status);
    }
    return fmi2OK;
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer value[])
{
    static const Function function = {"fmi2SetInteger", SETTABLE_DISCRETE, SETTABLE_DISCRETE};
    Instance *const instance = instance_enter(c, &function);
    if (instance == NULL) return fmi2Error;
    if (nvr > 0 && (vr == NULL || value == NULL)) return (fmi2Status)instance_refuse_null(instance, &function);
    for (size_t i = 0; i < nvr; i++) {
        const Status status = simulation_set_integer(&instance->now.simulation, vr[i], value[i]);
        if (status != STATUS_OK) return (fmi2Status)instance_report(instance, &function, status);
    }
    return fmi2OK;
}

/* There are neither Boolean nor String variables: an empty list of them is all right. */
fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Boolean value[])
{
    static const Function function = {"fmi2GetBoolean", READABLE, READABLE};
    (void)vr;
    (void)value;
    return (fmi2Status)instance_has_none(c, &function, nvr);
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Boolean value[])
{
    static const Function function = {"fmi2SetBoolean", SETTABLE_DISCRETE, SETTABLE_DISCRETE};
    (void)vr;
    (void)value;
    return (fmi2Status)instance_has_none(c, &function, nvr);
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2String value[])
{
    static const Function function = {"fmi2GetString", READABLE, READABLE};
    (void)vr;
    (void)value;
    return (fmi2Status)instance_has_none(c, &function, nvr);
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2String value[])
{
    static const Function function = {"fmi2SetString", SETTABLE_DISCRETE, SETTABLE_DISCRETE};
    (void)vr;
    (void)value;
    return (fmi2Status)instance_has_none(c, &function, nvr);
}

/* ---- saved states ---- */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    static const Function function = {"fmi2GetFMUstate", ANY_MODE, ANY_MODE};
    return (fmi2Status)instance_get_state(c, &function, FMUstate);
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate)
{
    static const Function function = {"fmi2SetFMUstate", ANY_MODE, ANY_MODE};
    return (fmi2Status)instance_set_state(c, &function, FMUstate);
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    static const Function function = {"fmi2FreeFMUstate", ANY_MODE, ANY_MODE};
    return (fmi2Status)instance_free_state(c, &function, FMUstate);
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size)
{
    static const Function function = {"fmi2SerializedFMUstateSize", ANY_MODE, ANY_MODE};
    return (fmi2Status)instance_get_serialized_size(c, &function, FMUstate, size);
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte serializedState[], size_t size)
{
    static const Function function = {"fmi2SerializeFMUstate", ANY_MODE, ANY_MODE};
    return (fmi2Status)instance_serialize(c, &function, FMUstate, (unsigned char *)serializedState, size);
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte serializedState[], size_t size,
                                   fmi2FMUstate *FMUstate)
{
    static const Function function = {"fmi2DeSerializeFMUstate", ANY_MODE, ANY_MODE};
    return (fmi2Status)instance_deserialize(c, &function, (const unsigned char *)serializedState, size, FMUstate);
}

/* ---- derivatives ---- */

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference vUnknown_ref[], size_t nUnknown,
                                        const fmi2ValueReference vKnown_ref[], size_t nKnown, const fmi2Real dvKnown[],
                                        fmi2Real dvUnknown[])
{
    static const Function function = {"fmi2GetDirectionalDerivative", READABLE, READABLE};
    return (fmi2Status)instance_differentiate(c, &function, false, vUnknown_ref, nUnknown, vKnown_ref, nKnown, dvKnown,
                                              dvUnknown);
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                       const fmi2Integer order[], const fmi2Real value[])
{
    static const Function function = {"fmi2SetRealInputDerivatives", NEVER, INSTANTIATED | INITIALIZATION | STEP_MODE};
    return (fmi2Status)instance_set_slopes(c, &function, vr, nvr, order, value);
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                        const fmi2Integer order[], fmi2Real value[])
{
    (void)vr;
    (void)nvr;
    (void)order;
    (void)value;
    return (fmi2Status)instance_lacks(c, "fmi2GetRealOutputDerivatives", "not offered: maxOutputDerivativeOrder is 0");
}

/* ---- Co-Simulation ---- */

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
                      fmi2Boolean noSetFMUStatePriorToCurrentPoint)
{
    static const Function function = {"fmi2DoStep", NEVER, STEP_MODE};
    (void)noSetFMUStatePriorToCurrentPoint;
    return (fmi2Status)instance_step(c, &function, currentCommunicationPoint, communicationStepSize);
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    /* Steps do not run in the background, so there is never one to cancel. */
    static const Function function = {"fmi2CancelStep", NEVER, NEVER};
    instance_enter(c, &function);
    return fmi2Error;
}

static const Function get_status = {"fmi2Get...Status", NEVER, STEPPED};

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind s, fmi2Real *value)
{
    const Instance *const instance = instance_enter(c, &get_status);
    if (instance == NULL) return fmi2Error;
    if (value == NULL) return (fmi2Status)instance_refuse_null(instance, &get_status);
    if (s != fmi2LastSuccessfulTime) return fmi2Discard;
    *value = instance->now.simulation.time;
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value)
{
    const Instance *const instance = instance_enter(c, &get_status);
    if (instance == NULL) return fmi2Error;
    if (value == NULL) return (fmi2Status)instance_refuse_null(instance, &get_status);
    if (s != fmi2Terminated) return fmi2Discard;
    *value = fmi2False; /* the model never asks to end the simulation */
    return fmi2OK;
}

/* The other kinds of status belong to steps in the background. */
static fmi2Status no_such_status(fmi2Component c)
{
    return instance_enter(c, &get_status) == NULL ? fmi2Error : fmi2Discard;
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind s, fmi2Status *value)
{
    (void)s;
    (void)value;
    return no_such_status(c);
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind s, fmi2Integer *value)
{
    (void)s;
    (void)value;
    return no_such_status(c);
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind s, fmi2String *value)
{
    (void)s;
    (void)value;
    return no_such_status(c);
}

/* ---- Model Exchange ---- */

fmi2Status fmi2EnterEventMode(fmi2Component c)
{
    static const Function function = {"fmi2EnterEventMode", EVENT_MODE | CONTINUOUS_TIME, NEVER};
    return (fmi2Status)instance_change_mode(c, &function, EVENT_MODE);
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *eventInfo)
{
    static const Function function = {"fmi2NewDiscreteStates", EVENT_MODE, NEVER};
    const Instance *const instance = instance_enter(c, &function);
    if (instance == NULL) return fmi2Error;
    if (eventInfo == NULL) return (fmi2Status)instance_refuse_null(instance, &function);
    *eventInfo = (fmi2EventInfo){0}; /* there are no events */
    return fmi2OK;
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c)
{
    static const Function function = {"fmi2EnterContinuousTimeMode", EVENT_MODE, NEVER};
    return (fmi2Status)instance_change_mode(c, &function, CONTINUOUS_TIME);
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi2Boolean *enterEventMode, fmi2Boolean *terminateSimulation)
{
    static const Function function = {"fmi2CompletedIntegratorStep", CONTINUOUS_TIME, NEVER};
    (void)noSetFMUStatePriorToCurrentPoint;
    const Instance *const instance = instance_enter(c, &function);
    if (instance == NULL) return fmi2Error;
    if (enterEventMode == NULL || terminateSimulation == NULL)
        return (fmi2Status)instance_refuse_null(instance, &function);
    *enterEventMode = fmi2False;
    *terminateSimulation = fmi2False;
    return (fmi2Status)instance_complete_step(c, &function);
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time)
{
    static const Function function = {"fmi2SetTime", EVENT_MODE | CONTINUOUS_TIME, NEVER};
    return (fmi2Status)instance_set_time(c, &function, time);
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t nx)
{
    static const Function function = {"fmi2SetContinuousStates", CONTINUOUS_TIME, NEVER};
    return (fmi2Status)instance_set_states(c, &function, x, nx);
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t nx)
{
    static const Function function = {"fmi2GetContinuousStates", READABLE, NEVER};
    return (fmi2Status)instance_get_states(c, &function, x, nx);
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real derivatives[], size_t nx)
{
    static const Function function = {"fmi2GetDerivatives", READABLE, NEVER};
    return (fmi2Status)instance_get_derivatives(c, &function, derivatives, nx);
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real x_nominal[], size_t nx)
{
    static const Function function = {"fmi2GetNominalsOfContinuousStates", ANY_MODE, NEVER};
    return (fmi2Status)instance_get_nominals(c, &function, x_nominal, nx);
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real eventIndicators[], size_t ni)
{
    static const Function function = {"fmi2GetEventIndicators", READABLE, NEVER};
    (void)eventIndicators;
    return (fmi2Status)instance_has_none(c, &function, ni);
}
