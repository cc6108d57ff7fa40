#include "instance.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static const char *name_of(Mode mode)
{
    switch (mode) {
    case INSTANTIATED: return "instantiated";
    case INITIALIZATION: return "in initialization mode";
    case EVENT_MODE: return "in event mode";
    case CONTINUOUS_TIME: return "in continuous-time mode";
    case STEP_MODE: return "running (step complete)";
    case FAILED: return "stopped by a failed step";
    case TERMINATED: return "terminated";
    }
    return "in no known mode";
}

/* ---- the log ---- */

static const struct {
    LogCategory category;
    const char *name;
} categories[] = {
    {LOG_EVENTS, "logEvents"},
    {LOG_WARNING, "logStatusWarning"},
    {LOG_DISCARD, "logStatusDiscard"},
    {LOG_ERROR, "logStatusError"},
    {LOG_ALL, "logAll"},
};
enum { N_CATEGORIES = sizeof categories / sizeof categories[0] };

static const LogCategory category_of[] = {
    [STATUS_OK] = LOG_EVENTS,
    [STATUS_WARNING] = LOG_WARNING,
    [STATUS_DISCARD] = LOG_DISCARD,
    [STATUS_ERROR] = LOG_ERROR,
};

static void write_log(const Instance *instance, const Function *function, Status status, const char *message)
{
    const LogCategory category = category_of[status];
    if (instance->log == NULL || !(instance->logged & (unsigned)category)) return;
    const char *category_name = "";
    for (int i = 0; i < N_CATEGORIES; i++) {
        if (categories[i].category == category) category_name = categories[i].name;
    }
    char text[LOG_SIZE];
    int length = snprintf(text, sizeof text, "%s: ", function->name);
    /* A number sign begins a value reference in messages of FMI: it must be doubled. */
    for (const char *c = message; *c != '\0' && length + 2 < LOG_SIZE; c++) {
        if (*c == '#') text[length++] = '#';
        text[length++] = *c;
    }
    text[length] = '\0';
    instance->log(instance, status, category_name, text);
}

Status instance_refuse(const Instance *instance, const Function *function, const char *reason)
{
    write_log(instance, function, STATUS_ERROR, reason);
    return STATUS_ERROR;
}

Status instance_report(Instance *instance, const Function *function, Status status)
{
    char *const message = instance->now.simulation.message;
    if (message[0] != '\0') {
        write_log(instance, function, status, message);
        message[0] = '\0';
    }
    return status;
}

Status instance_refuse_null(const Instance *instance, const Function *function)
{
    return instance_refuse(instance, function, "an argument is a null pointer");
}

Status instance_set_logging(void *component, const Function *function, bool on, size_t n, const char *const names[])
{
    Instance *const instance = instance_enter(component, function);
    if (instance == NULL) return STATUS_ERROR;
    if (n > 0 && names == NULL) return instance_refuse_null(instance, function);
    unsigned chosen = n == 0 ? LOG_ALL : 0;
    for (size_t i = 0; i < n; i++) {
        unsigned found = 0;
        for (int j = 0; j < N_CATEGORIES; j++) {
            if (names[i] != NULL && strcmp(names[i], categories[j].name) == 0) found = categories[j].category;
        }
        if (found == 0) {
            return instance_refuse(instance, function,
                                   "there is no such log category: there are logEvents, logStatusWarning, "
                                   "logStatusDiscard, logStatusError and logAll");
        }
        chosen |= found;
    }
    instance->logged = instance->logged_least | (on ? chosen : 0);
    return STATUS_OK;
}

/* ---- entry ---- */

Instance *instance_enter(void *component, const Function *function)
{
    Instance *const instance = component;
    if (instance == NULL) return NULL;
    const bool is_model_exchange = instance->now.interface == MODEL_EXCHANGE;
    const unsigned modes = is_model_exchange ? function->model_exchange : function->co_simulation;
    if ((unsigned)instance->now.mode & modes) return instance;

    char reason[128];
    if (modes == NEVER && (function->model_exchange | function->co_simulation) != NEVER) {
        snprintf(reason, sizeof reason, "must not be called in %s",
                 is_model_exchange ? "Model Exchange" : "Co-Simulation");
    } else {
        snprintf(reason, sizeof reason, "must not be called while the instance is %s", name_of(instance->now.mode));
    }
    instance_refuse(instance, function, reason);
    return NULL;
}

bool instance_may_start(const Instance *instance, const Function *function, const char *guid)
{
    if (guid != NULL && strcmp(guid, MODEL_GUID) == 0) return true;
    char reason[MESSAGE_SIZE];
    snprintf(reason, sizeof reason, "wrong GUID: expected %s, received %s", MODEL_GUID, guid == NULL ? "none" : guid);
    instance_refuse(instance, function, reason);
    return false;
}

bool instance_open(Instance *instance, const Function *function, const char *resources)
{
    simulation_reset(&instance->now.simulation);
    const Status status = simulation_open(&instance->now.simulation, resources);
    return instance_report(instance, function, status) == STATUS_OK;
}

void instance_close(Instance *instance)
{
    simulation_close(&instance->now.simulation);
}

Status instance_lacks(void *component, const char *function_name, const char *reason)
{
    const Function function = {function_name, ANY_MODE, ANY_MODE};
    const Instance *const instance = instance_enter(component, &function);
    return instance == NULL ? STATUS_ERROR : instance_refuse(instance, &function, reason);
}

/* ---- modes ---- */

static void enter_mode(Instance *instance, const Function *function, Mode mode)
{
    if (instance->logged & LOG_EVENTS) {
        char event[128];
        snprintf(event, sizeof event, "now %s, at time %.16g s", name_of(mode), instance->now.simulation.time);
        write_log(instance, function, STATUS_OK, event);
    }
    instance->now.mode = mode;
}

Status instance_setup(void *component, const Function *function, bool has_tolerance, double tolerance,
                      double start_time, bool has_stop_time, double stop_time)
{
    Instance *const instance = instance_enter(component, function);
    if (instance == NULL) return STATUS_ERROR;
    /* How exact an adaptive method is, its own parameter says: the same results in every importer. */
    if (has_tolerance && !(tolerance > 0.0 && isfinite(tolerance))) {
        return instance_refuse(instance, function, "the tolerance must be a positive number");
    }
    return instance_report(
        instance, function,
        simulation_setup(&instance->now.simulation, start_time, has_stop_time ? stop_time : (double)INFINITY));
}

Status instance_change_mode(void *component, const Function *function, Mode mode)
{
    Instance *const instance = instance_enter(component, function);
    if (instance == NULL) return STATUS_ERROR;
    enter_mode(instance, function, mode);
    return STATUS_OK;
}

Status instance_start(void *component, const Function *function)
{
    Instance *const instance = instance_enter(component, function);
    if (instance == NULL) return STATUS_ERROR;
    const Status status = instance_report(instance, function, simulation_start(&instance->now.simulation));
    if (status != STATUS_ERROR) {
        enter_mode(instance, function, instance->now.interface == MODEL_EXCHANGE ? EVENT_MODE : STEP_MODE);
    }
    return status;
}

Status instance_terminate(void *component, const Function *function)
{
    const Status status = instance_change_mode(component, function, TERMINATED);
    if (status == STATUS_OK) simulation_end(&((Instance *)component)->now.simulation);
    return status;
}

Status instance_reset(void *component, const Function *function)
{
    Instance *const instance = instance_enter(component, function);
    if (instance == NULL) return STATUS_ERROR;
    simulation_reset(&instance->now.simulation);
    enter_mode(instance, function, INSTANTIATED);
    return STATUS_OK;
}

/* ---- values ---- */

Status instance_get_reals(void *component, const Function *function, const unsigned references[], size_t n,
                          double values[])
{
    Instance *const instance = instance_enter(component, function);
    if (instance == NULL) return STATUS_ERROR;
    if (n > 0 && (references == NULL || values == NULL)) return instance_refuse_null(instance, function);
    for (size_t i = 0; i < n; i++) {
        const Status status = simulation_get_real(&instance->now.simulation, references[i], &values[i]);
        if (status != STATUS_OK) return instance_report(instance, function, status);
    }
    return STATUS_OK;
}

Status instance_set_reals(void *component, const Function *function, const unsigned references[], size_t n,
                          const double values[])
{
    Instance *const instance = instance_enter(component, function);
    if (instance == NULL) return STATUS_ERROR;
    if (n > 0 && (references == NULL || values == NULL)) return instance_refuse_null(instance, function);
    /* FMI 2.0 and 3.0: tunable parameters change in event mode or, without one, at communication points. */
    const bool at_event = instance->now.mode != CONTINUOUS_TIME;
    Simulation *const simulation = &instance->now.simulation;
    for (size_t i = 0; i < n; i++) {
        const Status status = simulation_check_real(simulation, references[i], values[i], at_event);
        if (status != STATUS_OK) return instance_report(instance, function, status);
    }
    for (size_t i = 0; i < n; i++) {
        simulation_set_real(simulation, references[i], values[i]);
    }
    return STATUS_OK;
}

Status instance_set_slopes(void *component, const Function *function, const unsigned references[], size_t n,
                           const int orders[], const double values[])
{
    Instance *const instance = instance_enter(component, function);
    if (instance == NULL) return STATUS_ERROR;
    if (n > 0 && (references == NULL || orders == NULL || values == NULL))
        return instance_refuse_null(instance, function);
    for (size_t i = 0; i < n; i++) {
        if (orders[i] != 1) {
            return instance_refuse(instance, function, "only first time derivatives of inputs can be set: order 1");
        }
        const Status status = simulation_set_slope(&instance->now.simulation, references[i], values[i]);
        if (status != STATUS_OK) return instance_report(instance, function, status);
    }
    return STATUS_OK;
}

Status instance_has_none(void *component, const Function *function, size_t n)
{
    const Instance *const instance = instance_enter(component, function);
    if (instance == NULL) return STATUS_ERROR;
    return n == 0 ? STATUS_OK : instance_refuse(instance, function, "there are no variables of this type");
}

/* ---- saved states, where they are offered: a snapshot; as bytes, the GUID goes before it ---- */

static const char no_states[] = "states of this FMU cannot be saved: the description says so";

enum { GUID_SIZE = sizeof MODEL_GUID, BYTES_SIZE = GUID_SIZE + 2 * (int)sizeof(int) + SERIALIZED_SIZE };

Status instance_get_state(void *component, const Function *function, void **state)
{
    Instance *const instance = instance_enter(component, function);
    if (instance == NULL) return STATUS_ERROR;
    if (!OFFERS_STATES) return instance_refuse(instance, function, no_states);
    if (state == NULL) return instance_refuse_null(instance, function);
    if (*state == NULL) {
        *state = instance->allocate(1, sizeof(Snapshot));
        if (*state == NULL) return instance_refuse(instance, function, "out of memory");
    }
    memcpy(*state, &instance->now, sizeof(Snapshot));
    return STATUS_OK;
}

Status instance_set_state(void *component, const Function *function, const void *state)
{
    Instance *const instance = instance_enter(component, function);
    if (instance == NULL) return STATUS_ERROR;
    if (!OFFERS_STATES) return instance_refuse(instance, function, no_states);
    if (state == NULL) return instance_refuse_null(instance, function);
    const Snapshot *const snapshot = state;
    if (snapshot->interface != instance->now.interface) {
        return instance_refuse(
            instance, function,
            "this state comes from an instance with the other interface: a state of Model Exchange is "
            "none of Co-Simulation");
    }
    instance->now = *snapshot;
    return STATUS_OK;
}

Status instance_free_state(void *component, const Function *function, void **state)
{
    Instance *const instance = instance_enter(component, function);
    if (instance == NULL) return STATUS_ERROR;
    if (state != NULL && *state != NULL) {
        instance->release(*state);
        *state = NULL;
    }
    return STATUS_OK;
}

Status instance_get_serialized_size(void *component, const Function *function, const void *state, size_t *size)
{
    Instance *const instance = instance_enter(component, function);
    if (instance == NULL) return STATUS_ERROR;
    if (!OFFERS_STATES) return instance_refuse(instance, function, no_states);
    if (state == NULL || size == NULL) return instance_refuse_null(instance, function);
    *size = BYTES_SIZE;
    return STATUS_OK;
}

Status instance_serialize(void *component, const Function *function, const void *state, unsigned char bytes[],
                          size_t size)
{
    Instance *const instance = instance_enter(component, function);
    if (instance == NULL) return STATUS_ERROR;
    if (!OFFERS_STATES) return instance_refuse(instance, function, no_states);
    if (state == NULL || bytes == NULL) return instance_refuse_null(instance, function);
    if (size < BYTES_SIZE)
        return instance_refuse(instance, function, "the buffer is too small: ask for the size first");
    const Snapshot *const snapshot = state;
    const int header[2] = {(int)snapshot->interface, (int)snapshot->mode};
    memcpy(bytes, MODEL_GUID, GUID_SIZE);
    memcpy(bytes + GUID_SIZE, header, sizeof header);
    simulation_serialize(&snapshot->simulation, bytes + GUID_SIZE + sizeof header);
    return STATUS_OK;
}

/* Whether an instance of this interface can be in this mode, with its simulation in this phase. */
static bool is_possible(Interface interface, int mode, Phase phase)
{
    const int running = interface == MODEL_EXCHANGE ? EVENT_MODE | CONTINUOUS_TIME : STEP_MODE;
    const int modes = phase == BEFORE_START ? INSTANTIATED | INITIALIZATION : running | FAILED | TERMINATED;
    const bool is_one_bit = mode > 0 && (mode & (mode - 1)) == 0;
    return is_one_bit && (mode & modes) != 0;
}

Status instance_deserialize(void *component, const Function *function, const unsigned char bytes[], size_t size,
                            void **state)
{
    Instance *const instance = instance_enter(component, function);
    if (instance == NULL) return STATUS_ERROR;
    if (!OFFERS_STATES) return instance_refuse(instance, function, no_states);
    if (bytes == NULL || state == NULL) return instance_refuse_null(instance, function);
    if (size != BYTES_SIZE || memcmp(bytes, MODEL_GUID, GUID_SIZE) != 0) {
        return instance_refuse(instance, function, "these bytes are not a state of this FMU");
    }
    int header[2];
    Snapshot read = instance->now;
    memcpy(header, bytes + GUID_SIZE, sizeof header);
    const Status status = simulation_deserialize(&read.simulation, bytes + GUID_SIZE + sizeof header);
    if (status != STATUS_OK) return instance_refuse(instance, function, read.simulation.message);
    if (header[0] != (int)instance->now.interface) {
        return instance_refuse(instance, function, "these bytes come from an instance with the other interface");
    }
    if (!is_possible(instance->now.interface, header[1], read.simulation.phase)) {
        return instance_refuse(instance, function, "these bytes are not a state of this FMU: no instance can be in it");
    }
    read.mode = (Mode)header[1];
    if (*state == NULL) {
        *state = instance->allocate(1, sizeof(Snapshot));
        if (*state == NULL) return instance_refuse(instance, function, "out of memory");
    }
    memcpy(*state, &read, sizeof read);
    return STATUS_OK;
}

/* ---- partial derivatives ---- */

Status instance_differentiate(void *component, const Function *function, bool adjoint, const unsigned unknowns[],
                              size_t n_unknowns, const unsigned knowns[], size_t n_knowns, const double seed[],
                              double sensitivity[])
{
    Instance *const instance = instance_enter(component, function);
    if (instance == NULL) return STATUS_ERROR;
    const size_t n_seed = adjoint ? n_unknowns : n_knowns, n_sensitivity = adjoint ? n_knowns : n_unknowns;
    if ((n_unknowns > 0 && unknowns == NULL) || (n_knowns > 0 && knowns == NULL) || (n_seed > 0 && seed == NULL)
        || (n_sensitivity > 0 && sensitivity == NULL)) {
        return instance_refuse_null(instance, function);
    }
    return instance_report(instance, function,
                           simulation_differentiate(&instance->now.simulation, adjoint, unknowns, n_unknowns, knowns,
                                                    n_knowns, seed, sensitivity));
}

/* ---- Co-Simulation ---- */

Status instance_step(void *component, const Function *function, double time, double step)
{
    Instance *const instance = instance_enter(component, function);
    if (instance == NULL) return STATUS_ERROR;
    const Status status = simulation_step(&instance->now.simulation, time, step);
    if (status == STATUS_ERROR) {
        instance->now.mode = FAILED;
    }
    return instance_report(instance, function, status);
}

/* ---- Model Exchange ---- */

/* The instance if it may be called with an array of n states, or NULL. */
static Instance *enter_with_states(void *component, const Function *function, const double states[], size_t n)
{
    Instance *const instance = instance_enter(component, function);
    if (instance == NULL) return NULL;
    if (states == NULL) {
        instance_refuse_null(instance, function);
        return NULL;
    }
    if (n != N_STATES) {
        char reason[128];
        snprintf(reason, sizeof reason, "there are %d continuous states, not %zu", N_STATES, n);
        instance_refuse(instance, function, reason);
        return NULL;
    }
    return instance;
}

Status instance_set_time(void *component, const Function *function, double time)
{
    Instance *const instance = instance_enter(component, function);
    if (instance == NULL) return STATUS_ERROR;
    return instance_report(instance, function, simulation_set_time(&instance->now.simulation, time));
}

Status instance_set_states(void *component, const Function *function, const double states[], size_t n)
{
    Instance *const instance = enter_with_states(component, function, states, n);
    if (instance == NULL) return STATUS_ERROR;
    return instance_report(instance, function, simulation_set_states(&instance->now.simulation, states));
}

Status instance_get_states(void *component, const Function *function, double states[], size_t n)
{
    const Instance *const instance = enter_with_states(component, function, states, n);
    if (instance == NULL) return STATUS_ERROR;
    memcpy(states, &instance->now.simulation.values[FIRST_STATE], N_STATES * sizeof(double));
    return STATUS_OK;
}

Status instance_get_derivatives(void *component, const Function *function, double derivatives[], size_t n)
{
    Instance *const instance = enter_with_states(component, function, derivatives, n);
    if (instance == NULL) return STATUS_ERROR;
    return instance_report(instance, function, simulation_get_derivatives(&instance->now.simulation, derivatives));
}

Status instance_get_nominals(void *component, const Function *function, double nominals[], size_t n)
{
    const Instance *const instance = enter_with_states(component, function, nominals, n);
    if (instance == NULL) return STATUS_ERROR;
    for (int i = 0; i < N_STATES; i++) {
        nominals[i] = model_variables[FIRST_STATE + i].nominal;
    }
    return STATUS_OK;
}

Status instance_complete_step(void *component, const Function *function)
{
    Instance *const instance = instance_enter(component, function);
    if (instance == NULL) return STATUS_ERROR;
    const Status status = simulation_complete_step(&instance->now.simulation);
    if (status == STATUS_ERROR) {
        instance->now.mode = FAILED;
    }
    return instance_report(instance, function, status);
}
