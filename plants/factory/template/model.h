/* The contract between a model and the runtime: what a generated model.c provides, and how its values are laid out.
 * There is no FMI type here and nothing about any particular model: the sizes and names come from the generated config.h. */
#ifndef MODEL_H
#define MODEL_H

#include "config.h"

/* Value references. Reals first, in the order of an instance's array of values, then the enumerations. */
enum {
    FIRST_STATE = 0,
    FIRST_DERIVATIVE = FIRST_STATE + N_STATES,
    FIRST_INPUT = FIRST_DERIVATIVE + N_STATES,
    FIRST_PARAMETER = FIRST_INPUT + N_INPUTS,
    FIRST_OUTPUT = FIRST_PARAMETER + N_PARAMETERS,
    N_REALS = FIRST_OUTPUT + N_OUTPUTS,
    FIRST_ENUMERATION = N_REALS,
    N_VARIABLES = FIRST_ENUMERATION + N_ENUMERATIONS
};

typedef struct {
    const char *name;
    const char *unit;  /* of an enumeration: its items, for messages */
    double start;
    double min;
    double max;
} Variable;

/* All variables, by value reference. */
extern const Variable model_variables[N_VARIABLES];

/* der(x) = f(time, x, u, p) */
void model_derivatives(double time, const double *states, const double *inputs, const double *parameters,
                       const int *enumerations, double *derivatives);

/* y = g(time, x, u, p) */
void model_outputs(double time, const double *states, const double *inputs, const double *parameters,
                   const int *enumerations, double *outputs);

#endif
