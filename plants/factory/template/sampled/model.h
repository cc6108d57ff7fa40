/* The contract between a sampled model and the runtime: what a model provides. A sampled model computes its outputs
 * once a communication point, a tick, from its inputs, its parameters and its memory. There is no FMI type here and
 * nothing about any particular model: sizes and names come from the generated config.h. */
#ifndef MODEL_H
#define MODEL_H

#include "memory.h" /* by the model: the type Memory, a struct without pointers, whose bytes are all of its state */
#include "variables.h"

#define INTERFACES "Co-Simulation"
enum { OFFERS_MODEL_EXCHANGE = 0, OFFERS_STATES = !NEEDS_TOOL };

/* Fill the memory, whose bytes are zero, before the first tick. */
void model_start(const double *parameters, const int *integers, Memory *memory);

struct Tool; /* the program beside a model; there is none unless NEEDS_TOOL is set */

/* Compute the outputs of a tick, and what the memory is after it. Returns NULL, or why that is not possible: a clause
 * without its end, "the law fails". */
const char *model_tick(long long tick, const double *inputs, const double *parameters, const int *integers,
                       Memory *memory, struct Tool *tool, double *outputs);

#if NEEDS_TOOL
/* The program beside the model, which belongs to an instance. Faults are clauses as above. */

/* The program of an instance, which does not run yet; NULL, and why. The resources are a path or a URI of the FMU's. */
struct Tool *model_open(const char *resources, const char **fault);

/* Let it run, if it does not, and lead it back to before the first tick. */
const char *model_begin(struct Tool *tool, const double *parameters, const int *integers);

/* End the program, if it runs. */
void model_end(struct Tool *tool);

/* End it, and give back what model_open has given. */
void model_close(struct Tool *tool);
#endif

#endif
