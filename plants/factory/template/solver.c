#include "solver.h"

#include <stddef.h>

#include "model.h"

enum { MAX_STAGES = 7 };

/* A Runge-Kutta method in Butcher's notation: stage i at time + c[i]*step uses the slopes j < i with weights a[i][j];
 * the step takes all slopes with weights b[i], and errs by about what weights e[i] give, if there are any. */
typedef struct {
    int stages;
    bool has_error;
    double c[MAX_STAGES];
    double a[MAX_STAGES][MAX_STAGES];
    double b[MAX_STAGES];
    double e[MAX_STAGES];
} Tableau;

static const Tableau tableaus[] = {
    [SOLVER_EULER] = {.stages = 1, .b = {1.0}},
    [SOLVER_RUNGE_KUTTA_4] = {.stages = 4,
                              .c = {0.0, 1.0 / 2.0, 1.0 / 2.0, 1.0},
                              .a = {{0.0}, {1.0 / 2.0}, {0.0, 1.0 / 2.0}, {0.0, 0.0, 1.0}},
                              .b = {1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0}},
    /* J. R. Dormand, P. J. Prince: A family of embedded Runge-Kutta formulae.
     * Journal of Computational and Applied Mathematics 6 (1980), 19-26. The step is the one of order 5. */
    [SOLVER_DORMAND_PRINCE_45] =
        {.stages = 7,
         .has_error = true,
         .c = {0.0, 1.0 / 5.0, 3.0 / 10.0, 4.0 / 5.0, 8.0 / 9.0, 1.0, 1.0},
         .a = {{0.0},
               {1.0 / 5.0},
               {3.0 / 40.0, 9.0 / 40.0},
               {44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0},
               {19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0},
               {9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0},
               {35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0}},
         .b = {35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0, 0.0},
         .e = {71.0 / 57600.0, 0.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339200.0, 22.0 / 525.0, -1.0 / 40.0}},
};

bool solver_is_adaptive(int solver)
{
    return tableaus[solver].has_error;
}

/* base + step * (weights' slopes) */
static void advance(const double base[], double step, int n_slopes, const double weights[], double slopes[][N_STATES],
                    double result[])
{
    for (int i = 0; i < N_STATES; i++) {
        double slope = 0.0;
        for (int j = 0; j < n_slopes; j++) {
            slope += weights[j] * slopes[j][i];
        }
        result[i] = base[i] + step * slope;
    }
}

static void get_derivatives(const Drive *drive, double time, const double *states, double *derivatives)
{
    if (drive->slopes == NULL) {
        model_get_derivatives(time, states, drive->inputs, drive->parameters, drive->enumerations, derivatives);
        return;
    }
    double inputs[ROOM(N_INPUTS)];
    for (int i = 0; i < N_INPUTS; i++) {
        inputs[i] = drive->inputs[i] + drive->slopes[i] * (time - drive->start);
    }
    model_get_derivatives(time, states, inputs, drive->parameters, drive->enumerations, derivatives);
}

void solver_step(int solver, const Drive *drive, double time, double step, const double *states, double *next,
                 double *error)
{
    const Tableau *const method = &tableaus[solver];
    double slopes[MAX_STAGES][N_STATES];
    double stage[N_STATES];

    for (int i = 0; i < method->stages; i++) {
        advance(states, step, i, method->a[i], slopes, stage);
        get_derivatives(drive, time + method->c[i] * step, stage, slopes[i]);
    }
    advance(states, step, method->stages, method->b, slopes, next);
    if (error != NULL && method->has_error) {
        const double zero[N_STATES] = {0.0};
        advance(zero, step, method->stages, method->e, slopes, error);
    }
}
