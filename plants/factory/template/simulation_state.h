/* An instance of a plant. Methods of fixed step divide a communication step into the fewest equal internal steps that
 * are no longer than solver_step; an adaptive one takes steps as the tolerance asks for, none longer than that. */
#ifndef SIMULATION_STATE_H
#define SIMULATION_STATE_H

typedef struct {
    Phase phase;
    double time;      /* of the last communication point, s */
    double stop_time; /* INFINITY unless set */
    double values[N_REALS];
    double slopes[ROOM(N_INPUTS)]; /* time derivatives of the inputs, for the next step */
    bool ramps;                    /* any of them is not zero */
    int integers[N_INTEGERS];
    bool outside[ROOM(N_LIMITS)]; /* which limits are left */
    bool current;                 /* derivatives and outputs belong to the other values */
    char message[MESSAGE_SIZE];
} Simulation;

enum {
    SERIALIZED_SIZE = sizeof(int) + 2 * sizeof(double) + sizeof(double) * (2 * N_INPUTS + N_STATES + N_PARAMETERS)
    + sizeof(int) * N_INTEGERS + N_LIMITS
};

#endif
