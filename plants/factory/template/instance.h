/* An instance as FMI sees it, whatever the version of FMI: its mode, its log, its saved states, and what may be called
 * when. fmi2.c and fmi3.c translate the calls of their version to these functions. */
#ifndef INSTANCE_H
#define INSTANCE_H

#include "simulation.h"

typedef enum { MODEL_EXCHANGE, CO_SIMULATION } Interface;

/* The modes of an instance, as bits of the masks below. */
typedef enum {
    INSTANTIATED = 1 << 0,
    INITIALIZATION = 1 << 1,
    EVENT_MODE = 1 << 2,      /* Model Exchange */
    CONTINUOUS_TIME = 1 << 3, /* Model Exchange */
    STEP_MODE = 1 << 4,       /* Co-Simulation: a step is complete */
    FAILED = 1 << 5,          /* by a step */
    TERMINATED = 1 << 6
} Mode;

enum {
    NEVER = 0,
    STARTED = EVENT_MODE | CONTINUOUS_TIME | STEP_MODE | FAILED | TERMINATED,
    ANY_MODE = INSTANTIATED | INITIALIZATION | STARTED
};

/* A function of FMI: its name, and the modes in which each interface allows it. */
typedef struct {
    const char *name;
    unsigned model_exchange;
    unsigned co_simulation;
} Function;

/* Log categories, by the names that FMI 2.0 section 2.2.4 proposes, as bits. */
typedef enum {
    LOG_EVENTS = 1 << 0,  /* logEvents */
    LOG_WARNING = 1 << 1, /* logStatusWarning */
    LOG_DISCARD = 1 << 2, /* logStatusDiscard */
    LOG_ERROR = 1 << 3,   /* logStatusError */
    LOG_PROBLEMS = LOG_WARNING | LOG_DISCARD | LOG_ERROR,
    LOG_ALL = LOG_EVENTS | LOG_PROBLEMS /* logAll */
} LogCategory;

enum { LOG_SIZE = 2 * MESSAGE_SIZE + 128 }; /* a message, escaped, with the function's name before it */

/* All that changes over an instance's life, but the log's settings. */
typedef struct {
    Interface interface;
    Mode mode;
    Simulation simulation;
} Snapshot;

typedef struct Instance {
    Snapshot now;
    const char *name;
    unsigned logged;       /* categories */
    unsigned logged_least; /* those that the debug switch does not switch off */
    void (*log)(const struct Instance *instance, Status status, const char *category, const char *text);
    void *(*allocate)(size_t count, size_t size);
    void (*release)(void *memory);
} Instance;

/* Whether an instance may be made: an error is logged for `instance`, which needs no more than its name and log. */
bool instance_may_start(const Instance *instance, const Function *function, const char *guid);

/* What an instance needs beside its memory: found, or an error is logged; and given back. */
bool instance_open(Instance *instance, const Function *function, const char *resources);
void instance_close(Instance *instance);

/* The instance, or NULL, with a message, if the function must not be called now. */
Instance *instance_enter(void *component, const Function *function);

/* Log why a function is refused. */
Status instance_refuse(const Instance *instance, const Function *function, const char *reason);
Status instance_refuse_null(const Instance *instance, const Function *function);

/* Refuse what the model description says this FMU does not offer. */
Status instance_lacks(void *component, const char *function_name, const char *reason);

Status instance_set_logging(void *component, const Function *function, bool on, size_t n,
                            const char *const categories[]);
Status instance_setup(void *component, const Function *function, bool has_tolerance, double tolerance,
                      double start_time, bool has_stop_time, double stop_time);
Status instance_change_mode(void *component, const Function *function, Mode mode);
Status instance_start(void *component, const Function *function);
Status instance_terminate(void *component, const Function *function);
Status instance_reset(void *component, const Function *function);

Status instance_get_reals(void *component, const Function *function, const unsigned references[], size_t n,
                          double values[]);
Status instance_set_reals(void *component, const Function *function, const unsigned references[], size_t n,
                          const double values[]);
Status instance_set_slopes(void *component, const Function *function, const unsigned references[], size_t n,
                           const int orders[], const double values[]);
/* There is nothing of the kind asked for: asking for none of it is all right. */
Status instance_has_none(void *component, const Function *function, size_t n);
/* The status of a call to the simulation: its message is logged and emptied. */
Status instance_report(Instance *instance, const Function *function, Status status);

Status instance_get_state(void *component, const Function *function, void **state);
Status instance_set_state(void *component, const Function *function, const void *state);
Status instance_free_state(void *component, const Function *function, void **state);
Status instance_get_serialized_size(void *component, const Function *function, const void *state, size_t *size);
Status instance_serialize(void *component, const Function *function, const void *state, unsigned char bytes[],
                          size_t size);
Status instance_deserialize(void *component, const Function *function, const unsigned char bytes[], size_t size,
                            void **state);

Status instance_differentiate(void *component, const Function *function, bool adjoint, const unsigned unknowns[],
                              size_t n_unknowns, const unsigned knowns[], size_t n_knowns, const double seed[],
                              double sensitivity[]);

/* Co-Simulation */
Status instance_step(void *component, const Function *function, double time, double step);

/* Model Exchange; n is the number of states that the caller believes there are. */
Status instance_set_time(void *component, const Function *function, double time);
Status instance_set_states(void *component, const Function *function, const double states[], size_t n);
Status instance_get_states(void *component, const Function *function, double states[], size_t n);
Status instance_get_derivatives(void *component, const Function *function, double derivatives[], size_t n);
Status instance_get_nominals(void *component, const Function *function, double nominals[], size_t n);
Status instance_complete_step(void *component, const Function *function);

#endif
