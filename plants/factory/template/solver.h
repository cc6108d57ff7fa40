/* Explicit Runge-Kutta methods: one step. */
#ifndef SOLVER_H
#define SOLVER_H

#include <stdbool.h>

/* The methods, numbered as the items of the model's parameter `solver`. */
enum { SOLVER_EULER = 1, SOLVER_RUNGE_KUTTA_4, SOLVER_DORMAND_PRINCE_45 };

/* What the model is driven by: inputs are u = inputs + slopes * (time - start), or held if there are no slopes. */
typedef struct {
    const double *inputs;
    const double *slopes; /* NULL: none */
    double start;
    const double *parameters;
    const int *enumerations;
} Drive;

/* Whether a method estimates its error, so that its step size can be controlled. */
bool solver_is_adaptive(int solver);

/* Advance `states` by one step to `next`, and estimate the error made if `error` is not NULL and the method can. */
void solver_step(int solver, const Drive *drive, double time, double step, const double *states, double *next,
                 double *error);

#endif
