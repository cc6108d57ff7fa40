/* One running instance of the model: its values, its clock, its steps. Knows no FMI: the FMI layers translate.
 *
 * A function that returns false has changed nothing but `message`, which then says why; only after a failed
 * simulation_step may the instance have moved: it then stands at the last good internal step. */
#ifndef SIMULATION_H
#define SIMULATION_H

#include <stdbool.h>

#include "model.h"

enum { MESSAGE_SIZE = 256 };

typedef enum { BEFORE_START, RUNNING } Phase;

typedef struct {
    Phase phase;
    double time;      /* of the last communication point, s */
    double stop_time; /* INFINITY unless set */
    double values[N_REALS];
    int enumerations[N_ENUMERATIONS];
    bool current; /* derivatives and outputs belong to the other values */
    char message[MESSAGE_SIZE];
} Simulation;

/* Everything to its start value. */
void simulation_reset(Simulation *s);

bool simulation_set_real(Simulation *s, unsigned reference, double value);
bool simulation_get_real(Simulation *s, unsigned reference, double *value);
bool simulation_set_enumeration(Simulation *s, unsigned reference, int value);
bool simulation_get_enumeration(Simulation *s, unsigned reference, int *value);

/* The experiment: start and stop time in s. */
bool simulation_setup(Simulation *s, double start_time, double stop_time);

/* Check start values and parameters against their bounds, and fix them. */
bool simulation_start(Simulation *s);

/* One communication step: n equal internal steps, n the smallest number that makes them no longer than solver_step. */
bool simulation_step(Simulation *s, double time, double step);

#endif
