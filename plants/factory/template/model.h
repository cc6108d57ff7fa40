/* The contract between a model and the runtime: what a generated model.c provides. There is no FMI type here and
 * nothing about any particular model: the sizes and names come from the generated config.h. */
#ifndef MODEL_H
#define MODEL_H

#include "variables.h"

#define INTERFACES "Co-Simulation and Model Exchange"
enum { OFFERS_MODEL_EXCHANGE = 1, OFFERS_STATES = 1 };

/* An expression that the equations hold for only between two bounds. */
typedef struct {
    const char *name;
    const char *unit;
    double min;
    double max;
    const char *reason;
} Limit;

/* The partial derivative of one variable with respect to another, by value reference. */
typedef struct {
    unsigned unknown;
    unsigned known;
} Partial;

extern const Limit model_limits[ROOM(N_LIMITS)];
extern const Partial model_partials[ROOM(N_PARTIALS)];                     /* with respect to states, inputs and time */
extern const Partial model_parameter_partials[ROOM(N_PARAMETER_PARTIALS)]; /* with respect to parameters */

/* der(x) = f(time, x, u, p) */
void model_get_derivatives(double time, const double *states, const double *inputs, const double *parameters,
                           const int *enumerations, double *derivatives);

/* y = g(time, x, u, p) */
void model_get_outputs(double time, const double *states, const double *inputs, const double *parameters,
                       const int *enumerations, double *outputs);

/* The expressions that have limits. */
void model_get_limited(double time, const double *states, const double *inputs, const double *parameters,
                       const int *enumerations, double *limited);

/* The partial derivatives of f, g and of states that are outputs: those that are not listed are zero. */
void model_get_partials(double time, const double *states, const double *inputs, const double *parameters,
                        const int *enumerations, double *partials);
void model_get_parameter_partials(double time, const double *states, const double *inputs, const double *parameters,
                                  const int *enumerations, double *partials);

#endif
