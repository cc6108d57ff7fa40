/* One running instance of a sampled model: its values, its clock, its ticks. Knows no FMI: the layers above translate.
 *
 * The ticks are the communication points, counted from the start. A tick belongs to the inputs that are set at its
 * communication point. Its outputs are computed when they are asked for, anew if inputs have changed, and what the model
 * remembers of the tick is kept when a step leads on from there. After a step, until an input is set, the outputs are
 * those of the tick before: a master that asks for outputs before it sets inputs gets each output one step late.
 *
 * Where LATE is set, the outputs of a tick come with the step that leads on from it, and are zero before the first one:
 * then every master gets each output one step late. The first tick takes the inputs as they were at the end of the
 * initialisation, as some masters exchange nothing before their first step.
 *
 * Whatever fails has changed nothing but `message`, which then says why; only a failed step over several ticks may have
 * come to one of them. A message may also come with STATUS_WARNING. Who reads a message empties it. */
#ifndef SIMULATION_H
#define SIMULATION_H

#include <stdbool.h>
#include <stddef.h>

#include "model.h"

enum { MESSAGE_SIZE = 384 };

typedef enum {
    STATUS_OK,
    STATUS_WARNING, /* done, but look at it */
    STATUS_DISCARD, /* not here */
    STATUS_ERROR
} Status;

typedef enum { BEFORE_START, RUNNING } Phase;

typedef struct {
    Phase phase;
    double time;      /* of the last communication point, s */
    double stop_time; /* INFINITY unless set */
    long long tick;   /* of the last communication point */
    double values[N_REALS];
    int integers[ROOM(N_INTEGERS)];
    bool given[ROOM(N_INPUTS)]; /* which inputs have ever been set */
    double first[ROOM(N_INPUTS)]; /* the inputs at the end of the initialisation */
    bool fresh;                 /* inputs have been set at this communication point, or there are none */
    bool current;               /* outputs and `after` belong to this tick and the other values */
    Memory before;              /* of the model, before this tick */
    Memory after;               /* and after it */
    struct Tool *tool;          /* NULL unless NEEDS_TOOL is set */
    char message[MESSAGE_SIZE];
} Simulation;

/* What an instance needs beside this struct, which is zero: it is found, and given back. */
Status simulation_open(Simulation *s, const char *resources);
void simulation_close(Simulation *s);

/* No step will follow, unless after a reset. */
void simulation_end(Simulation *s);

/* Everything to its start value. */
void simulation_reset(Simulation *s);

/* Whether a Real may be set to a value now; tunable parameters may change between steps. */
Status simulation_check_real(Simulation *s, unsigned reference, double value, bool at_event);
/* Set what has been checked. */
void simulation_set_real(Simulation *s, unsigned reference, double value);
Status simulation_get_real(Simulation *s, unsigned reference, double *value);
Status simulation_set_integer(Simulation *s, unsigned reference, long long value);
Status simulation_get_integer(Simulation *s, unsigned reference, int *value);

/* The experiment: start and stop time in s. The first tick is at the start. */
Status simulation_setup(Simulation *s, double start_time, double stop_time);

/* Check parameters, and fix all but inputs and tunable parameters. */
Status simulation_start(Simulation *s);

/* One communication step over one tick, or over several with the same inputs. */
Status simulation_step(Simulation *s, double time, double step);

/* What the description says that there is not: each refuses. */
Status simulation_set_slope(Simulation *s, unsigned reference, double slope);
Status simulation_set_time(Simulation *s, double time);
Status simulation_set_states(Simulation *s, const double states[]);
Status simulation_get_derivatives(Simulation *s, double derivatives[]);
Status simulation_complete_step(Simulation *s);
Status simulation_differentiate(Simulation *s, bool adjoint, const unsigned unknowns[], size_t n_unknowns,
                                const unsigned knowns[], size_t n_knowns, const double seed[], double sensitivity[]);

/* All that a simulation needs to go on, as bytes, for the same FMU on the same kind of machine. */
enum {
    SERIALIZED_SIZE = sizeof(int) + 2 * sizeof(double) + sizeof(long long) + sizeof(double) * N_REALS
        + sizeof(int) * N_INTEGERS + N_INPUTS + 1 + sizeof(double) * N_INPUTS + sizeof(Memory)
};
void simulation_serialize(const Simulation *s, unsigned char bytes[]);

/* Back from bytes, which may come from anywhere: refused if they are no simulation's. */
Status simulation_deserialize(Simulation *s, const unsigned char bytes[]);

#endif
