/* The contract between a sampled model and the runtime: what a model provides. A sampled model computes its outputs once
 * a communication point, a tick, from its inputs, its parameters and its memory. There is no FMI type here and nothing
 * about any particular model: sizes and names come from the generated config.h. */
#ifndef MODEL_H
#define MODEL_H

#include "memory.h" /* by the model: the type Memory, a struct without pointers, whose bytes are all of its state */
#include "variables.h"

#define INTERFACES "Co-Simulation"
enum { OFFERS_MODEL_EXCHANGE = 0 };

/* Fill the memory, whose bytes are zero, before the first tick. */
void model_start(const double *parameters, const int *integers, Memory *memory);

/* Compute the outputs of a tick, and what the memory is after it. Returns NULL, or why that is not possible: a clause
 * without its end, "the law fails". */
const char *model_tick(long long tick, const double *inputs, const double *parameters, const int *integers, Memory *memory,
                       double *outputs);

#endif
