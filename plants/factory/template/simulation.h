/* One running instance of a model: its values, its clock, its steps. Knows no FMI: the layers above translate. What an
 * instance holds, and how it steps, depends on the kind of model: simulation_state.h and simulation.c.
 *
 * Whatever fails has changed nothing but `message`, which then says why; only a failed simulation_step may have moved
 * the instance, which then stands at the last good point on the way. A message may also come with STATUS_WARNING, or
 * with STATUS_OK as a note. Who reads a message empties it. */
#ifndef SIMULATION_H
#define SIMULATION_H

#include <stdbool.h>
#include <stddef.h>

#include "model.h"

enum { MESSAGE_SIZE = 384 };

typedef enum {
    STATUS_OK,
    STATUS_WARNING, /* done, but look at it */
    STATUS_DISCARD, /* not here: a smaller step may do */
    STATUS_ERROR
} Status;

typedef enum { BEFORE_START, RUNNING } Phase;

#include "simulation_state.h" /* the type Simulation, and SERIALIZED_SIZE */

/* What an instance needs beside its struct, which is zero before: it is found, and given back. */
Status simulation_open(Simulation *s, const char *resources);
void simulation_close(Simulation *s);

/* No step will follow, unless after a reset. */
void simulation_end(Simulation *s);

/* Everything to its start value. */
void simulation_reset(Simulation *s);

/* Whether a Real may be set to a value now; tunable parameters may change at an event, once the simulation runs. */
Status simulation_check_real(Simulation *s, unsigned reference, double value, bool at_event);
/* Set what has been checked. */
void simulation_set_real(Simulation *s, unsigned reference, double value);
Status simulation_get_real(Simulation *s, unsigned reference, double *value);
Status simulation_set_integer(Simulation *s, unsigned reference, long long value);
Status simulation_get_integer(Simulation *s, unsigned reference, int *value);

/* The experiment: start and stop time in s. */
Status simulation_setup(Simulation *s, double start_time, double stop_time);

/* Check start values, parameters and limits, and fix all but inputs and tunable parameters. */
Status simulation_start(Simulation *s);

/* One communication step. */
Status simulation_step(Simulation *s, double time, double step);

/* Functions for features that the description may lack; they then refuse.
 *
 * Let an input ramp during the next step, by its first time derivative. */
Status simulation_set_slope(Simulation *s, unsigned reference, double slope);

/* For a solver outside: place the model, evaluate it, and say that an integrator's step is accepted. */
Status simulation_set_time(Simulation *s, double time);
Status simulation_set_states(Simulation *s, const double states[]);
Status simulation_get_derivatives(Simulation *s, double derivatives[]);
Status simulation_complete_step(Simulation *s);

/* Directional derivatives, sensitivity[i] = sum over j of d unknown[i] / d known[j] * seed[j], or the adjoint ones,
 * sensitivity[j] = sum over i of seed[i] * d unknown[i] / d known[j]. */
Status simulation_differentiate(Simulation *s, bool adjoint, const unsigned unknowns[], size_t n_unknowns,
                                const unsigned knowns[], size_t n_knowns, const double seed[], double sensitivity[]);

/* All that a simulation needs to go on, as SERIALIZED_SIZE bytes, for the same FMU on the same kind of machine. */
void simulation_serialize(const Simulation *s, unsigned char bytes[]);

/* Back from bytes, which may come from anywhere: refused if they are no simulation's. */
Status simulation_deserialize(Simulation *s, const unsigned char bytes[]);

#endif
