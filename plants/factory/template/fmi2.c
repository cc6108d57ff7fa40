/* FMI 2.0 for Co-Simulation, for any model. */
#include "fmi2Functions.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "simulation.h"

/* States of an instance, FMI 2.0.4 figure 11, as bits of the masks below. */
typedef enum {
    INSTANTIATED = 1 << 0,
    INITIALIZATION = 1 << 1,
    STEP_COMPLETE = 1 << 2,
    STEP_FAILED = 1 << 3,
    TERMINATED = 1 << 4
} State;

enum {
    SETTABLE = INSTANTIATED | INITIALIZATION | STEP_COMPLETE,
    READABLE = INITIALIZATION | STEP_COMPLETE | STEP_FAILED | TERMINATED,
    ANY_STATE = INSTANTIATED | READABLE,
    NO_STATE = 0
};

typedef struct {
    Simulation simulation;
    State state;
} Snapshot;

typedef struct {
    Snapshot now; /* all that changes over an instance's life */
    fmi2CallbackFunctions callbacks;
    char name[]; /* allocated together with the rest */
} Instance;

typedef struct {
    const char *name;
    unsigned states; /* in which it may be called, FMI 2.0.4 section 4.2.4 */
} Function;

static const Function set_debug_logging = {"fmi2SetDebugLogging", ANY_STATE};
static const Function setup_experiment = {"fmi2SetupExperiment", INSTANTIATED};
static const Function enter_initialization = {"fmi2EnterInitializationMode", INSTANTIATED};
static const Function exit_initialization = {"fmi2ExitInitializationMode", INITIALIZATION};
static const Function terminate = {"fmi2Terminate", STEP_COMPLETE | STEP_FAILED};
static const Function reset = {"fmi2Reset", ANY_STATE};
static const Function get_real = {"fmi2GetReal", READABLE};
static const Function get_integer = {"fmi2GetInteger", READABLE};
static const Function get_boolean = {"fmi2GetBoolean", READABLE};
static const Function get_string = {"fmi2GetString", READABLE};
static const Function set_real = {"fmi2SetReal", SETTABLE};
static const Function set_integer = {"fmi2SetInteger", SETTABLE};
static const Function set_boolean = {"fmi2SetBoolean", SETTABLE};
static const Function set_string = {"fmi2SetString", SETTABLE};
static const Function get_state = {"fmi2GetFMUstate", ANY_STATE};
static const Function set_state = {"fmi2SetFMUstate", ANY_STATE};
static const Function free_state = {"fmi2FreeFMUstate", ANY_STATE};
static const Function serialized_size = {"fmi2SerializedFMUstateSize", ANY_STATE};
static const Function serialize_state = {"fmi2SerializeFMUstate", ANY_STATE};
static const Function deserialize_state = {"fmi2DeSerializeFMUstate", ANY_STATE};
static const Function do_step = {"fmi2DoStep", STEP_COMPLETE};
static const Function cancel_step = {"fmi2CancelStep", NO_STATE};
static const Function get_status = {"fmi2Get...Status", STEP_COMPLETE | STEP_FAILED | TERMINATED};

static const char *name_of(State state)
{
    switch (state) {
    case INSTANTIATED: return "instantiated";
    case INITIALIZATION: return "in initialization mode";
    case STEP_COMPLETE: return "running (step complete)";
    case STEP_FAILED: return "stopped by a failed step";
    case TERMINATED: return "terminated";
    }
    return "in no known state";
}

/* ---- messages ---- */

enum { LOG_SIZE = MESSAGE_SIZE + 64 }; /* a message with the function's name before it */

static void log_error(const fmi2CallbackFunctions *callbacks, const char *instance_name, const char *message)
{
    if (callbacks->logger == NULL) {
        return;
    }
    /* The importer takes the message for a printf format: a percent sign must be doubled. */
    char format[2 * LOG_SIZE];
    size_t length = 0;
    for (const char *c = message; *c != '\0' && length + 2 < sizeof format; c++) {
        if (*c == '%') {
            format[length++] = '%';
        }
        format[length++] = *c;
    }
    format[length] = '\0';
    callbacks->logger(callbacks->componentEnvironment, instance_name, fmi2Error, "logStatusError", format);
}

static fmi2Status fail(Instance *instance, const Function *function, const char *reason)
{
    char message[LOG_SIZE];
    snprintf(message, sizeof message, "%s: %s", function->name, reason);
    log_error(&instance->callbacks, instance->name, message);
    return fmi2Error;
}

/* The status of a call to the simulation, whose message is logged if it failed. */
static fmi2Status status_of(Instance *instance, const Function *function, bool succeeded)
{
    return succeeded ? fmi2OK : fail(instance, function, instance->now.simulation.message);
}

/* The instance, or NULL if the function must not be called now. */
static Instance *enter(fmi2Component component, const Function *function)
{
    Instance *const instance = component;
    if (instance != NULL && !(instance->now.state & function->states)) {
        char reason[128];
        snprintf(reason, sizeof reason, "must not be called while the instance is %s", name_of(instance->now.state));
        fail(instance, function, reason);
        return NULL;
    }
    return instance;
}

static fmi2Status need_pointer(Instance *instance, const Function *function)
{
    return fail(instance, function, "an argument is a null pointer");
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

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t nCategories, const fmi2String categories[])
{
    (void)loggingOn; /* errors are always reported, and there is nothing else to log */
    Instance *const instance = enter(c, &set_debug_logging);
    if (instance == NULL) return fmi2Error;
    if (nCategories > 0 && categories == NULL) return need_pointer(instance, &set_debug_logging);
    for (size_t i = 0; i < nCategories; i++) {
        if (categories[i] == NULL || strcmp(categories[i], "logStatusError") != 0) {
            return fail(instance, &set_debug_logging, "there is no such log category: logStatusError is the only one");
        }
    }
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID, fmi2String fmuResourceLocation,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean loggingOn)
{
    (void)fmuResourceLocation;
    (void)visible;
    (void)loggingOn;
    if (functions == NULL) {
        return NULL;
    }
    if (instanceName == NULL || instanceName[0] == '\0') {
        log_error(functions, "?", "fmi2Instantiate: the instance has no name");
        return NULL;
    }
    if (fmuType != fmi2CoSimulation) {
        log_error(functions, instanceName, "fmi2Instantiate: this FMU is for Co-Simulation only");
        return NULL;
    }
    if (fmuGUID == NULL || strcmp(fmuGUID, MODEL_GUID) != 0) {
        char message[LOG_SIZE];
        snprintf(message, sizeof message, "fmi2Instantiate: wrong GUID: expected %s, received %s", MODEL_GUID,
                 fmuGUID == NULL ? "none" : fmuGUID);
        log_error(functions, instanceName, message);
        return NULL;
    }

    fmi2CallbackFunctions callbacks = *functions;
    if (callbacks.allocateMemory == NULL || callbacks.freeMemory == NULL) {
        callbacks.allocateMemory = calloc;
        callbacks.freeMemory = free;
    }
    Instance *const instance = callbacks.allocateMemory(1, sizeof(Instance) + strlen(instanceName) + 1);
    if (instance == NULL) {
        log_error(functions, instanceName, "fmi2Instantiate: out of memory");
        return NULL;
    }
    instance->callbacks = callbacks;
    strcpy(instance->name, instanceName);
    instance->now.state = INSTANTIATED;
    simulation_reset(&instance->now.simulation);
    return instance;
}

void fmi2FreeInstance(fmi2Component c)
{
    Instance *const instance = c;
    if (instance != NULL) {
        instance->callbacks.freeMemory(instance);
    }
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance, fmi2Real startTime,
                               fmi2Boolean stopTimeDefined, fmi2Real stopTime)
{
    (void)toleranceDefined; /* the solvers have a fixed step */
    (void)tolerance;
    Instance *const instance = enter(c, &setup_experiment);
    if (instance == NULL) return fmi2Error;
    return status_of(instance, &setup_experiment,
                     simulation_setup(&instance->now.simulation, startTime, stopTimeDefined ? stopTime : INFINITY));
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    Instance *const instance = enter(c, &enter_initialization);
    if (instance == NULL) return fmi2Error;
    instance->now.state = INITIALIZATION;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    Instance *const instance = enter(c, &exit_initialization);
    if (instance == NULL) return fmi2Error;
    if (!simulation_start(&instance->now.simulation)) return status_of(instance, &exit_initialization, false);
    instance->now.state = STEP_COMPLETE;
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    Instance *const instance = enter(c, &terminate);
    if (instance == NULL) return fmi2Error;
    instance->now.state = TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c)
{
    Instance *const instance = enter(c, &reset);
    if (instance == NULL) return fmi2Error;
    instance->now.state = INSTANTIATED;
    simulation_reset(&instance->now.simulation);
    return fmi2OK;
}

/* ---- values ---- */

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[])
{
    Instance *const instance = enter(c, &get_real);
    if (instance == NULL) return fmi2Error;
    if (nvr > 0 && (vr == NULL || value == NULL)) return need_pointer(instance, &get_real);
    for (size_t i = 0; i < nvr; i++) {
        if (!simulation_get_real(&instance->now.simulation, vr[i], &value[i])) return status_of(instance, &get_real, false);
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[])
{
    Instance *const instance = enter(c, &set_real);
    if (instance == NULL) return fmi2Error;
    if (nvr > 0 && (vr == NULL || value == NULL)) return need_pointer(instance, &set_real);
    for (size_t i = 0; i < nvr; i++) {
        if (!simulation_set_real(&instance->now.simulation, vr[i], value[i])) return status_of(instance, &set_real, false);
    }
    return fmi2OK;
}

/* Enumerations are read and written as integers. */
fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Integer value[])
{
    Instance *const instance = enter(c, &get_integer);
    if (instance == NULL) return fmi2Error;
    if (nvr > 0 && (vr == NULL || value == NULL)) return need_pointer(instance, &get_integer);
    for (size_t i = 0; i < nvr; i++) {
        if (!simulation_get_enumeration(&instance->now.simulation, vr[i], &value[i])) {
            return status_of(instance, &get_integer, false);
        }
    }
    return fmi2OK;
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer value[])
{
    Instance *const instance = enter(c, &set_integer);
    if (instance == NULL) return fmi2Error;
    if (nvr > 0 && (vr == NULL || value == NULL)) return need_pointer(instance, &set_integer);
    for (size_t i = 0; i < nvr; i++) {
        if (!simulation_set_enumeration(&instance->now.simulation, vr[i], value[i])) {
            return status_of(instance, &set_integer, false);
        }
    }
    return fmi2OK;
}

/* There are neither Boolean nor String variables: an empty list of them is all right. */
static fmi2Status none_of_this_type(fmi2Component c, const Function *function, size_t nvr)
{
    Instance *const instance = enter(c, function);
    if (instance == NULL) return fmi2Error;
    return nvr == 0 ? fmi2OK : fail(instance, function, "there are no variables of this type");
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Boolean value[])
{
    (void)vr;
    (void)value;
    return none_of_this_type(c, &get_boolean, nvr);
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2String value[])
{
    (void)vr;
    (void)value;
    return none_of_this_type(c, &get_string, nvr);
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Boolean value[])
{
    (void)vr;
    (void)value;
    return none_of_this_type(c, &set_boolean, nvr);
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2String value[])
{
    (void)vr;
    (void)value;
    return none_of_this_type(c, &set_string, nvr);
}

/* ---- saved states: a copy of all that changes; serialised, the GUID goes before it ---- */

enum { GUID_SIZE = sizeof MODEL_GUID };

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    Instance *const instance = enter(c, &get_state);
    if (instance == NULL) return fmi2Error;
    if (FMUstate == NULL) return need_pointer(instance, &get_state);
    if (*FMUstate == NULL) {
        *FMUstate = instance->callbacks.allocateMemory(1, sizeof(Snapshot));
        if (*FMUstate == NULL) return fail(instance, &get_state, "out of memory");
    }
    memcpy(*FMUstate, &instance->now, sizeof(Snapshot));
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate)
{
    Instance *const instance = enter(c, &set_state);
    if (instance == NULL) return fmi2Error;
    if (FMUstate == NULL) return need_pointer(instance, &set_state);
    memcpy(&instance->now, FMUstate, sizeof(Snapshot));
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    Instance *const instance = enter(c, &free_state);
    if (instance == NULL) return fmi2Error;
    if (FMUstate != NULL && *FMUstate != NULL) {
        instance->callbacks.freeMemory(*FMUstate);
        *FMUstate = NULL;
    }
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size)
{
    Instance *const instance = enter(c, &serialized_size);
    if (instance == NULL) return fmi2Error;
    if (FMUstate == NULL || size == NULL) return need_pointer(instance, &serialized_size);
    *size = GUID_SIZE + sizeof(Snapshot);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte serializedState[], size_t size)
{
    Instance *const instance = enter(c, &serialize_state);
    if (instance == NULL) return fmi2Error;
    if (FMUstate == NULL || serializedState == NULL) return need_pointer(instance, &serialize_state);
    if (size < GUID_SIZE + sizeof(Snapshot)) {
        return fail(instance, &serialize_state, "the buffer is too small: ask fmi2SerializedFMUstateSize");
    }
    memcpy(serializedState, MODEL_GUID, GUID_SIZE);
    memcpy(serializedState + GUID_SIZE, FMUstate, sizeof(Snapshot));
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte serializedState[], size_t size, fmi2FMUstate *FMUstate)
{
    Instance *const instance = enter(c, &deserialize_state);
    if (instance == NULL) return fmi2Error;
    if (serializedState == NULL || FMUstate == NULL) return need_pointer(instance, &deserialize_state);
    if (size < GUID_SIZE + sizeof(Snapshot) || memcmp(serializedState, MODEL_GUID, GUID_SIZE) != 0) {
        return fail(instance, &deserialize_state, "these bytes are not a state of this FMU");
    }
    const fmi2Status status = fmi2GetFMUstate(c, FMUstate);
    if (status == fmi2OK) {
        memcpy(*FMUstate, serializedState + GUID_SIZE, sizeof(Snapshot));
    }
    return status;
}

/* ---- steps ---- */

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
                      fmi2Boolean noSetFMUStatePriorToCurrentPoint)
{
    (void)noSetFMUStatePriorToCurrentPoint;
    Instance *const instance = enter(c, &do_step);
    if (instance == NULL) return fmi2Error;
    const bool succeeded = simulation_step(&instance->now.simulation, currentCommunicationPoint, communicationStepSize);
    if (!succeeded) {
        instance->now.state = STEP_FAILED;
    }
    return status_of(instance, &do_step, succeeded);
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    /* Steps do not run in the background, so there is never one to cancel. */
    enter(c, &cancel_step);
    return fmi2Error;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind s, fmi2Real *value)
{
    Instance *const instance = enter(c, &get_status);
    if (instance == NULL) return fmi2Error;
    if (value == NULL) return need_pointer(instance, &get_status);
    if (s != fmi2LastSuccessfulTime) return fmi2Discard;
    *value = instance->now.simulation.time;
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value)
{
    Instance *const instance = enter(c, &get_status);
    if (instance == NULL) return fmi2Error;
    if (value == NULL) return need_pointer(instance, &get_status);
    if (s != fmi2Terminated) return fmi2Discard;
    *value = fmi2False; /* the model never asks to end the simulation */
    return fmi2OK;
}

/* The other kinds of status belong to steps in the background. */
static fmi2Status no_such_status(fmi2Component c)
{
    return enter(c, &get_status) == NULL ? fmi2Error : fmi2Discard;
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

/* ---- what the model description says this FMU cannot do ---- */

static fmi2Status unsupported(fmi2Component c, const char *name, const char *flag)
{
    const Function function = {name, ANY_STATE};
    Instance *const instance = enter(c, &function);
    return instance == NULL ? fmi2Error : fail(instance, &function, flag);
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference vUnknown_ref[], size_t nUnknown,
                                        const fmi2ValueReference vKnown_ref[], size_t nKnown, const fmi2Real dvKnown[],
                                        fmi2Real dvUnknown[])
{
    (void)vUnknown_ref;
    (void)nUnknown;
    (void)vKnown_ref;
    (void)nKnown;
    (void)dvKnown;
    (void)dvUnknown;
    return unsupported(c, "fmi2GetDirectionalDerivative", "not offered: providesDirectionalDerivative is false");
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer order[],
                                       const fmi2Real value[])
{
    (void)vr;
    (void)nvr;
    (void)order;
    (void)value;
    return unsupported(c, "fmi2SetRealInputDerivatives", "not offered: canInterpolateInputs is false");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer order[],
                                        fmi2Real value[])
{
    (void)vr;
    (void)nvr;
    (void)order;
    (void)value;
    return unsupported(c, "fmi2GetRealOutputDerivatives", "not offered: maxOutputDerivativeOrder is 0");
}
