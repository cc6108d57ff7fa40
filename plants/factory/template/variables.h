/* The variables of an FMU, of whatever kind: value references, and what is stated of each. Sizes and names come from
 * the generated config.h. */
#ifndef VARIABLES_H
#define VARIABLES_H

#include <stdbool.h>

#include "config.h"

/* Value references. Reals first, in the order of an instance's array of values, then the whole numbers, which are
 * enumerations or Integers, then the time. */
enum {
    FIRST_STATE = 0,
    FIRST_DERIVATIVE = FIRST_STATE + N_STATES,
    FIRST_INPUT = FIRST_DERIVATIVE + N_STATES,
    FIRST_PARAMETER = FIRST_INPUT + N_INPUTS,
    FIRST_OUTPUT = FIRST_PARAMETER + N_PARAMETERS,
    N_REALS = FIRST_OUTPUT + N_OUTPUTS,
    FIRST_INTEGER = N_REALS,
    TIME = FIRST_INTEGER + N_INTEGERS,
    N_VARIABLES
};

/* C has no empty arrays. */
#define ROOM(n) ((n) > 0 ? (n) : 1)

typedef struct {
    const char *name;
    const char *unit; /* of an enumeration: its items, for messages */
    double start;
    double min;
    double max;
    double nominal;
    bool tunable; /* a parameter that may change between two steps */
    bool above;   /* must be greater than min, not equal to it */
    bool below;   /* must be less than max */
} Variable;

extern const Variable model_variables[N_VARIABLES]; /* by value reference */

#endif
