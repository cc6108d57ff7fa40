/* FMI 3.0 for Co-Simulation and Model Exchange, for any model: each function says when it may be called (FMI 3.0.1,
 * sections 2.3, 3.2 and 4.2) and hands over to instance.h. All variables are scalars. */
#include "fmi3Functions.h"

#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "instance.h"

/* The types that instance.h takes for granted. */
static_assert(sizeof(fmi3ValueReference) == sizeof(unsigned), "value references are unsigned");
static_assert((int)fmi3OK == STATUS_OK && (int)fmi3Warning == STATUS_WARNING && (int)fmi3Discard == STATUS_DISCARD
                  && (int)fmi3Error == STATUS_ERROR,
              "both number a status alike");

enum {
    SETTABLE = INSTANTIATED | INITIALIZATION | EVENT_MODE | CONTINUOUS_TIME | STEP_MODE,
    SETTABLE_DISCRETE = INSTANTIATED | INITIALIZATION | EVENT_MODE | STEP_MODE,
    EVALUABLE = INITIALIZATION | STARTED
};

typedef struct {
    Instance base; /* first, so that a pointer to one is a pointer to the other */
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
    char name[]; /* allocated together with the rest */
} Fmi3Instance;

static void log_message(const Instance *base, Status status, const char *category, const char *text)
{
    const Fmi3Instance *const instance = (const Fmi3Instance *)base;
    if (instance->log != NULL) {
        instance->log(instance->environment, (fmi3Status)status, category, text);
    }
}

/* Refuses what the model description says this FMU does not offer, whatever the rest of the arguments is. */
static fmi3Status lacks(fmi3Instance c, const char *function_name, const char *reason, ...)
{
    return (fmi3Status)instance_lacks(c, function_name, reason);
}

/* Refuses to name any of n things of a kind that this FMU has none of, whatever the rest of the arguments is. */
static fmi3Status has_none(fmi3Instance c, const Function *function, size_t n, ...)
{
    return (fmi3Status)instance_has_none(c, function, n);
}

/* ---- general ---- */

const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean loggingOn, size_t nCategories, const fmi3String names[])
{
    static const Function function = {"fmi3SetDebugLogging", ANY_MODE, ANY_MODE};
    return (fmi3Status)instance_set_logging(c, &function, loggingOn, nCategories, names);
}

static Fmi3Instance *instantiate(const Function *function, Interface interface, fmi3String name, fmi3String token,
                                 fmi3String resources, fmi3Boolean is_logging, fmi3InstanceEnvironment environment,
                                 fmi3LogMessageCallback log)
{
    Fmi3Instance made = {
        .base = {.now = {.interface = interface, .mode = INSTANTIATED},
                 .name = name == NULL ? "?" : name,
                 .logged = LOG_PROBLEMS, /* why there is no instance is said in any case */
                 .log = log_message,
                 .allocate = calloc,
                 .release = free},
        .environment = environment,
        .log = log,
    };
    if (name == NULL || name[0] == '\0') {
        instance_refuse(&made.base, function, "the instance has no name");
        return NULL;
    }
    if (!instance_may_start(&made.base, function, token)) return NULL;
    Fmi3Instance *const instance = calloc(1, sizeof(Fmi3Instance) + strlen(name) + 1);
    if (instance == NULL) {
        instance_refuse(&made.base, function, "out of memory");
        return NULL;
    }
    memcpy(instance, &made, sizeof made);
    strcpy(instance->name, name);
    instance->base.name = instance->name;
    if (!instance_open(&instance->base, function, resources)) {
        fmi3FreeInstance(instance);
        return NULL;
    }
    instance->base.logged = is_logging ? LOG_PROBLEMS : 0;
    return instance;
}

/* No instance, for an interface that this FMU does not offer. */
static fmi3Instance not_offered(const char *function_name, fmi3InstanceEnvironment environment,
                                fmi3LogMessageCallback log)
{
    if (log != NULL) {
        char text[LOG_SIZE];
        snprintf(text, sizeof text, "%s: this FMU is for " INTERFACES " only", function_name);
        log(environment, fmi3Error, "logStatusError", text);
    }
    return NULL;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String instanceName, fmi3String instantiationToken,
                                          fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                          fmi3InstanceEnvironment instanceEnvironment,
                                          fmi3LogMessageCallback logMessage)
{
    static const Function function = {"fmi3InstantiateModelExchange", ANY_MODE, ANY_MODE};
    (void)visible;
    if (!OFFERS_MODEL_EXCHANGE) return not_offered(function.name, instanceEnvironment, logMessage);
    return instantiate(&function, MODEL_EXCHANGE, instanceName, instantiationToken, resourcePath, loggingOn,
                       instanceEnvironment, logMessage);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String instanceName, fmi3String instantiationToken,
                                         fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                         fmi3Boolean eventModeUsed, fmi3Boolean earlyReturnAllowed,
                                         const fmi3ValueReference requiredIntermediateVariables[],
                                         size_t nRequiredIntermediateVariables,
                                         fmi3InstanceEnvironment instanceEnvironment, fmi3LogMessageCallback logMessage,
                                         fmi3IntermediateUpdateCallback intermediateUpdate)
{
    static const Function function = {"fmi3InstantiateCoSimulation", ANY_MODE, ANY_MODE};
    (void)visible;
    (void)earlyReturnAllowed; /* never made use of */
    (void)requiredIntermediateVariables;
    (void)intermediateUpdate;
    const char *const refusal = eventModeUsed ? "there is no event mode: hasEventMode is false"
                                : nRequiredIntermediateVariables > 0
                                    ? "there are no intermediate updates: providesIntermediateUpdate is false"
                                    : NULL;
    Fmi3Instance *const instance = instantiate(&function, CO_SIMULATION, instanceName, instantiationToken, resourcePath,
                                               loggingOn || refusal != NULL, instanceEnvironment, logMessage);
    if (instance != NULL && refusal != NULL) {
        instance_refuse(&instance->base, &function, refusal);
        fmi3FreeInstance(instance);
        return NULL;
    }
    return instance;
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String instanceName, fmi3String instantiationToken,
                                               fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                               fmi3InstanceEnvironment instanceEnvironment,
                                               fmi3LogMessageCallback logMessage, fmi3ClockUpdateCallback clockUpdate,
                                               fmi3LockPreemptionCallback lockPreemption,
                                               fmi3UnlockPreemptionCallback unlockPreemption)
{
    (void)instanceName;
    (void)instantiationToken;
    (void)resourcePath;
    (void)visible;
    (void)loggingOn;
    (void)clockUpdate;
    (void)lockPreemption;
    (void)unlockPreemption;
    return not_offered("fmi3InstantiateScheduledExecution", instanceEnvironment, logMessage);
}

void fmi3FreeInstance(fmi3Instance c)
{
    if (c != NULL) instance_close(c);
    free(c);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean toleranceDefined, fmi3Float64 tolerance,
                                       fmi3Float64 startTime, fmi3Boolean stopTimeDefined, fmi3Float64 stopTime)
{
    static const Function function = {"fmi3EnterInitializationMode", INSTANTIATED, INSTANTIATED};
    const Status status =
        instance_setup(c, &function, toleranceDefined, tolerance, startTime, stopTimeDefined, stopTime);
    return (fmi3Status)(status == STATUS_OK ? instance_change_mode(c, &function, INITIALIZATION) : status);
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c)
{
    static const Function function = {"fmi3ExitInitializationMode", INITIALIZATION, INITIALIZATION};
    return (fmi3Status)instance_start(c, &function);
}

fmi3Status fmi3Terminate(fmi3Instance c)
{
    static const Function function = {"fmi3Terminate", EVENT_MODE | CONTINUOUS_TIME | FAILED, STEP_MODE | FAILED};
    return (fmi3Status)instance_terminate(c, &function);
}

fmi3Status fmi3Reset(fmi3Instance c)
{
    static const Function function = {"fmi3Reset", ANY_MODE, ANY_MODE};
    return (fmi3Status)instance_reset(c, &function);
}

/* ---- values ---- */

static const char *const wrong_count = "there must be as many values as value references: all variables are scalars";

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                          fmi3Float64 values[], size_t nValues)
{
    static const Function function = {"fmi3GetFloat64", ANY_MODE, ANY_MODE};
    if (nValues != nValueReferences) return lacks(c, function.name, wrong_count);
    return (fmi3Status)instance_get_reals(c, &function, valueReferences, nValueReferences, values);
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                          const fmi3Float64 values[], size_t nValues)
{
    static const Function function = {"fmi3SetFloat64", SETTABLE, SETTABLE};
    if (nValues != nValueReferences) return lacks(c, function.name, wrong_count);
    return (fmi3Status)instance_set_reals(c, &function, valueReferences, nValueReferences, values);
}

/* Enumerations are read and written as integers of 64 bits, too. */
fmi3Status fmi3GetInt64(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                        fmi3Int64 values[], size_t nValues)
{
    static const Function function = {"fmi3GetInt64", ANY_MODE, ANY_MODE};
    Instance *const instance = instance_enter(c, &function);
    if (instance == NULL) return fmi3Error;
    if (nValues != nValueReferences) return (fmi3Status)instance_refuse(instance, &function, wrong_count);
    if (nValues > 0 && (valueReferences == NULL || values == NULL)) {
        return (fmi3Status)instance_refuse_null(instance, &function);
    }
    for (size_t i = 0; i < nValues; i++) {
        int value = 0;
        const Status status = simulation_get_integer(&instance->now.simulation, valueReferences[i], &value);
        if (status != STATUS_OK) return (fmi3Status)instance_report(instance, &function, status);
        values[i] = value;
    }
    return fmi3OK;
}

fmi3Status fmi3SetInt64(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                        const fmi3Int64 values[], size_t nValues)
{
    static const Function function = {"fmi3SetInt64", SETTABLE_DISCRETE, SETTABLE_DISCRETE};
    Instance *const instance = instance_enter(c, &function);
    if (instance == NULL) return fmi3Error;
    if (nValues != nValueReferences) return (fmi3Status)instance_refuse(instance, &function, wrong_count);
    if (nValues > 0 && (valueReferences == NULL || values == NULL)) {
        return (fmi3Status)instance_refuse_null(instance, &function);
    }
    for (size_t i = 0; i < nValues; i++) {
        const Status status = simulation_set_integer(&instance->now.simulation, valueReferences[i], values[i]);
        if (status != STATUS_OK) return (fmi3Status)instance_report(instance, &function, status);
    }
    return fmi3OK;
}

/* There are no variables of these types: an empty list of them is all right. */
#define NO_VARIABLES(TYPE)                                                                                             \
    fmi3Status fmi3Get##TYPE(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences,      \
                             fmi3##TYPE values[], size_t nValues)                                                      \
    {                                                                                                                  \
        static const Function function = {"fmi3Get" #TYPE, ANY_MODE, ANY_MODE};                                        \
        return has_none(c, &function, nValueReferences + nValues, valueReferences, values);                            \
    }                                                                                                                  \
    fmi3Status fmi3Set##TYPE(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences,      \
                             const fmi3##TYPE values[], size_t nValues)                                                \
    {                                                                                                                  \
        static const Function function = {"fmi3Set" #TYPE, SETTABLE_DISCRETE, SETTABLE_DISCRETE};                      \
        return has_none(c, &function, nValueReferences + nValues, valueReferences, values);                            \
    }

NO_VARIABLES(Float32)
NO_VARIABLES(Int8)
NO_VARIABLES(UInt8)
NO_VARIABLES(Int16)
NO_VARIABLES(UInt16)
NO_VARIABLES(Int32)
NO_VARIABLES(UInt32)
NO_VARIABLES(UInt64)
NO_VARIABLES(Boolean)
NO_VARIABLES(String)

fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                         size_t valueSizes[], fmi3Binary values[], size_t nValues)
{
    static const Function function = {"fmi3GetBinary", ANY_MODE, ANY_MODE};
    return has_none(c, &function, nValueReferences + nValues, valueReferences, valueSizes, values);
}

fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                         const size_t valueSizes[], const fmi3Binary values[], size_t nValues)
{
    static const Function function = {"fmi3SetBinary", SETTABLE_DISCRETE, SETTABLE_DISCRETE};
    return has_none(c, &function, nValueReferences + nValues, valueReferences, valueSizes, values);
}

fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                        fmi3Clock values[])
{
    static const Function function = {"fmi3GetClock", ANY_MODE, ANY_MODE};
    return has_none(c, &function, nValueReferences, valueReferences, values);
}

fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                        const fmi3Clock values[])
{
    static const Function function = {"fmi3SetClock", SETTABLE_DISCRETE, SETTABLE_DISCRETE};
    return has_none(c, &function, nValueReferences, valueReferences, values);
}

/* ---- saved states ---- */

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *FMUState)
{
    static const Function function = {"fmi3GetFMUState", ANY_MODE, ANY_MODE};
    return (fmi3Status)instance_get_state(c, &function, FMUState);
}

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState FMUState)
{
    static const Function function = {"fmi3SetFMUState", ANY_MODE, ANY_MODE};
    return (fmi3Status)instance_set_state(c, &function, FMUState);
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *FMUState)
{
    static const Function function = {"fmi3FreeFMUState", ANY_MODE, ANY_MODE};
    return (fmi3Status)instance_free_state(c, &function, FMUState);
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState FMUState, size_t *size)
{
    static const Function function = {"fmi3SerializedFMUStateSize", ANY_MODE, ANY_MODE};
    return (fmi3Status)instance_get_serialized_size(c, &function, FMUState, size);
}

fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState FMUState, fmi3Byte serializedState[], size_t size)
{
    static const Function function = {"fmi3SerializeFMUState", ANY_MODE, ANY_MODE};
    return (fmi3Status)instance_serialize(c, &function, FMUState, serializedState, size);
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte serializedState[], size_t size,
                                   fmi3FMUState *FMUState)
{
    static const Function function = {"fmi3DeserializeFMUState", ANY_MODE, ANY_MODE};
    return (fmi3Status)instance_deserialize(c, &function, serializedState, size, FMUState);
}

/* ---- derivatives ---- */

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t nUnknowns,
                                        const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[],
                                        size_t nSeed, fmi3Float64 sensitivity[], size_t nSensitivity)
{
    static const Function function = {"fmi3GetDirectionalDerivative", EVALUABLE, EVALUABLE};
    if (nSeed != nKnowns || nSensitivity != nUnknowns) {
        return lacks(c, function.name, "there must be a seed for each known, a result for each unknown");
    }
    return (fmi3Status)instance_differentiate(c, &function, false, unknowns, nUnknowns, knowns, nKnowns, seed,
                                              sensitivity);
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t nUnknowns,
                                    const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[],
                                    size_t nSeed, fmi3Float64 sensitivity[], size_t nSensitivity)
{
    static const Function function = {"fmi3GetAdjointDerivative", EVALUABLE, EVALUABLE};
    if (nSeed != nUnknowns || nSensitivity != nKnowns) {
        return lacks(c, function.name, "there must be a seed for each unknown, a result for each known");
    }
    return (fmi3Status)instance_differentiate(c, &function, true, unknowns, nUnknowns, knowns, nKnowns, seed,
                                              sensitivity);
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                                    const fmi3Int32 orders[], fmi3Float64 values[], size_t nValues)
{
    return lacks(c, "fmi3GetOutputDerivatives", "not offered: maxOutputDerivativeOrder is 0", valueReferences,
                 nValueReferences, orders, values, nValues);
}

/* ---- Co-Simulation ---- */

fmi3Status fmi3EnterStepMode(fmi3Instance c)
{
    return lacks(c, "fmi3EnterStepMode", "there is no event mode to come from: hasEventMode is false");
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 currentCommunicationPoint, fmi3Float64 communicationStepSize,
                      fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean *eventHandlingNeeded,
                      fmi3Boolean *terminateSimulation, fmi3Boolean *earlyReturn, fmi3Float64 *lastSuccessfulTime)
{
    static const Function function = {"fmi3DoStep", NEVER, STEP_MODE};
    (void)noSetFMUStatePriorToCurrentPoint;
    const Instance *const instance = instance_enter(c, &function);
    if (instance == NULL) return fmi3Error;
    if (eventHandlingNeeded == NULL || terminateSimulation == NULL || earlyReturn == NULL
        || lastSuccessfulTime == NULL) {
        return (fmi3Status)instance_refuse_null(instance, &function);
    }
    const Status status = instance_step(c, &function, currentCommunicationPoint, communicationStepSize);
    *eventHandlingNeeded = fmi3False;
    *terminateSimulation = fmi3False;
    *earlyReturn = fmi3False;
    *lastSuccessfulTime = instance->now.simulation.time;
    return (fmi3Status)status;
}

/* ---- Model Exchange ---- */

fmi3Status fmi3EnterEventMode(fmi3Instance c)
{
    static const Function function = {"fmi3EnterEventMode", CONTINUOUS_TIME, NEVER};
    return (fmi3Status)instance_change_mode(c, &function, EVENT_MODE);
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *discreteStatesNeedUpdate,
                                    fmi3Boolean *terminateSimulation, fmi3Boolean *nominalsOfContinuousStatesChanged,
                                    fmi3Boolean *valuesOfContinuousStatesChanged, fmi3Boolean *nextEventTimeDefined,
                                    fmi3Float64 *nextEventTime)
{
    static const Function function = {"fmi3UpdateDiscreteStates", EVENT_MODE, NEVER};
    const Instance *const instance = instance_enter(c, &function);
    if (instance == NULL) return fmi3Error;
    if (discreteStatesNeedUpdate == NULL || terminateSimulation == NULL || nominalsOfContinuousStatesChanged == NULL
        || valuesOfContinuousStatesChanged == NULL || nextEventTimeDefined == NULL || nextEventTime == NULL) {
        return (fmi3Status)instance_refuse_null(instance, &function);
    }
    /* There are no events. */
    *discreteStatesNeedUpdate = fmi3False;
    *terminateSimulation = fmi3False;
    *nominalsOfContinuousStatesChanged = fmi3False;
    *valuesOfContinuousStatesChanged = fmi3False;
    *nextEventTimeDefined = fmi3False;
    *nextEventTime = 0.0;
    return fmi3OK;
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance c)
{
    static const Function function = {"fmi3EnterContinuousTimeMode", EVENT_MODE, NEVER};
    return (fmi3Status)instance_change_mode(c, &function, CONTINUOUS_TIME);
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi3Boolean *enterEventMode, fmi3Boolean *terminateSimulation)
{
    static const Function function = {"fmi3CompletedIntegratorStep", CONTINUOUS_TIME, NEVER};
    (void)noSetFMUStatePriorToCurrentPoint;
    const Instance *const instance = instance_enter(c, &function);
    if (instance == NULL) return fmi3Error;
    if (enterEventMode == NULL || terminateSimulation == NULL)
        return (fmi3Status)instance_refuse_null(instance, &function);
    *enterEventMode = fmi3False;
    *terminateSimulation = fmi3False;
    return (fmi3Status)instance_complete_step(c, &function);
}

fmi3Status fmi3SetTime(fmi3Instance c, fmi3Float64 time)
{
    static const Function function = {"fmi3SetTime", EVENT_MODE | CONTINUOUS_TIME, NEVER};
    return (fmi3Status)instance_set_time(c, &function, time);
}

fmi3Status fmi3SetContinuousStates(fmi3Instance c, const fmi3Float64 continuousStates[], size_t nContinuousStates)
{
    static const Function function = {"fmi3SetContinuousStates", CONTINUOUS_TIME, NEVER};
    return (fmi3Status)instance_set_states(c, &function, continuousStates, nContinuousStates);
}

fmi3Status fmi3GetContinuousStates(fmi3Instance c, fmi3Float64 continuousStates[], size_t nContinuousStates)
{
    static const Function function = {"fmi3GetContinuousStates", EVALUABLE, NEVER};
    return (fmi3Status)instance_get_states(c, &function, continuousStates, nContinuousStates);
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance c, fmi3Float64 derivatives[], size_t nContinuousStates)
{
    static const Function function = {"fmi3GetContinuousStateDerivatives", EVALUABLE, NEVER};
    return (fmi3Status)instance_get_derivatives(c, &function, derivatives, nContinuousStates);
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance c, fmi3Float64 nominals[], size_t nContinuousStates)
{
    static const Function function = {"fmi3GetNominalsOfContinuousStates", EVALUABLE, NEVER};
    return (fmi3Status)instance_get_nominals(c, &function, nominals, nContinuousStates);
}

fmi3Status fmi3GetEventIndicators(fmi3Instance c, fmi3Float64 eventIndicators[], size_t nEventIndicators)
{
    static const Function function = {"fmi3GetEventIndicators", EVALUABLE, NEVER};
    return has_none(c, &function, nEventIndicators, eventIndicators);
}

static fmi3Status count(fmi3Instance c, const Function *function, size_t n, size_t *result)
{
    const Instance *const instance = instance_enter(c, function);
    if (instance == NULL) return fmi3Error;
    if (result == NULL) return (fmi3Status)instance_refuse_null(instance, function);
    *result = n;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t *nContinuousStates)
{
    static const Function function = {"fmi3GetNumberOfContinuousStates", ANY_MODE, NEVER};
    return count(c, &function, N_STATES, nContinuousStates);
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t *nEventIndicators)
{
    static const Function function = {"fmi3GetNumberOfEventIndicators", ANY_MODE, NEVER};
    return count(c, &function, 0, nEventIndicators);
}

/* ---- what the model description says this FMU does not offer ---- */

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance c)
{
    return lacks(c, "fmi3EvaluateDiscreteStates", "not offered: providesEvaluateDiscreteStates is false");
}

fmi3Status fmi3EnterConfigurationMode(fmi3Instance c)
{
    return lacks(c, "fmi3EnterConfigurationMode", "not offered: there are no structural parameters");
}

fmi3Status fmi3ExitConfigurationMode(fmi3Instance c)
{
    return lacks(c, "fmi3ExitConfigurationMode", "not offered: there are no structural parameters");
}

static const char *const no_element_dependencies = "not offered: providesPerElementDependencies is false";

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance c, fmi3ValueReference valueReference, size_t *nDependencies)
{
    return lacks(c, "fmi3GetNumberOfVariableDependencies", no_element_dependencies, valueReference, nDependencies);
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance c, fmi3ValueReference dependent, size_t elementIndicesOfDependent[],
                                       fmi3ValueReference independents[], size_t elementIndicesOfIndependents[],
                                       fmi3DependencyKind dependencyKinds[], size_t nDependencies)
{
    return lacks(c, "fmi3GetVariableDependencies", no_element_dependencies, dependent, elementIndicesOfDependent,
                 independents, elementIndicesOfIndependents, dependencyKinds, nDependencies);
}

static const char *const no_clocks = "not offered: there are no clocks";

fmi3Status fmi3GetIntervalDecimal(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                                  fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
{
    return lacks(c, "fmi3GetIntervalDecimal", no_clocks, valueReferences, nValueReferences, intervals, qualifiers);
}

fmi3Status fmi3GetIntervalFraction(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                                   fmi3UInt64 counters[], fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[])
{
    return lacks(c, "fmi3GetIntervalFraction", no_clocks, valueReferences, nValueReferences, counters, resolutions,
                 qualifiers);
}

fmi3Status fmi3GetShiftDecimal(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                               fmi3Float64 shifts[])
{
    return lacks(c, "fmi3GetShiftDecimal", no_clocks, valueReferences, nValueReferences, shifts);
}

fmi3Status fmi3GetShiftFraction(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                                fmi3UInt64 counters[], fmi3UInt64 resolutions[])
{
    return lacks(c, "fmi3GetShiftFraction", no_clocks, valueReferences, nValueReferences, counters, resolutions);
}

fmi3Status fmi3SetIntervalDecimal(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                                  const fmi3Float64 intervals[])
{
    return lacks(c, "fmi3SetIntervalDecimal", no_clocks, valueReferences, nValueReferences, intervals);
}

fmi3Status fmi3SetIntervalFraction(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                                   const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
{
    return lacks(c, "fmi3SetIntervalFraction", no_clocks, valueReferences, nValueReferences, counters, resolutions);
}

fmi3Status fmi3SetShiftDecimal(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                               const fmi3Float64 shifts[])
{
    return lacks(c, "fmi3SetShiftDecimal", no_clocks, valueReferences, nValueReferences, shifts);
}

fmi3Status fmi3SetShiftFraction(fmi3Instance c, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                                const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
{
    return lacks(c, "fmi3SetShiftFraction", no_clocks, valueReferences, nValueReferences, counters, resolutions);
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance c, fmi3ValueReference clockReference, fmi3Float64 activationTime)
{
    return lacks(c, "fmi3ActivateModelPartition", no_clocks, clockReference, activationTime);
}
