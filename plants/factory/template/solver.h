/* Explicit Runge-Kutta methods with a fixed step. */
#ifndef SOLVER_H
#define SOLVER_H

/* The methods, numbered as the items of the model's parameter `solver`. */
enum { SOLVER_EULER = 1, SOLVER_RUNGE_KUTTA_4 };

/* Advance the states by one step; the inputs are held. */
void solver_step(int solver, double time, double step, double *states, const double *inputs, const double *parameters,
                 const int *enumerations);

#endif
