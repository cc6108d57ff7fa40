/* An instance of a sampled model.
 *
 * The ticks are the communication points, counted from the start. A tick belongs to the inputs that are set at its
 * communication point. Its outputs are computed when they are asked for, anew if inputs have changed, and what the
 * model remembers of the tick is kept when a step leads on from there. A step may lead over several ticks with the same
 * inputs. After a step, until an input is set, the outputs are those of the tick before: a master that asks for outputs
 * before it sets inputs gets each output one step late.
 *
 * Where LATE is set, the outputs of a tick come with the step that leads on from it, and are zero before the first one:
 * then every master gets each output one step late. The first tick takes the inputs as they were at the end of the
 * initialisation, as some masters exchange nothing before their first step. */
#ifndef SIMULATION_STATE_H
#define SIMULATION_STATE_H

typedef struct {
    Phase phase;
    double time;      /* of the last communication point, s */
    double stop_time; /* INFINITY unless set */
    long long tick;   /* of the last communication point */
    double values[N_REALS];
    int integers[ROOM(N_INTEGERS)];
    bool given[ROOM(N_INPUTS)];   /* which inputs have ever been set */
    double first[ROOM(N_INPUTS)]; /* the inputs at the end of the initialisation */
    bool fresh;                   /* inputs have been set at this communication point, or there are none */
    bool current;                 /* outputs and `after` belong to this tick and the other values */
    Memory before;                /* of the model, before this tick */
    Memory after;                 /* and after it */
    struct Tool *tool;            /* NULL unless NEEDS_TOOL is set */
    char message[MESSAGE_SIZE];
} Simulation;

enum {
    SERIALIZED_SIZE = sizeof(int) + 2 * sizeof(double) + sizeof(long long) + sizeof(double) * N_REALS
    + sizeof(int) * N_INTEGERS + N_INPUTS + 1 + sizeof(double) * N_INPUTS + sizeof(Memory)
};

#endif
