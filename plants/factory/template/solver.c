#include "solver.h"

#include "model.h"

enum { MAX_STAGES = 4 };

/* A Runge-Kutta method in Butcher's notation: stage i at time + c[i]*step uses the slopes j < i with weights a[i][j];
 * the step takes all slopes with weights b[i]. */
typedef struct {
    int stages;
    double c[MAX_STAGES];
    double a[MAX_STAGES][MAX_STAGES];
    double b[MAX_STAGES];
} Tableau;

static const Tableau tableaus[] = {
    [SOLVER_EULER] = {.stages = 1, .b = {1.0}},
    [SOLVER_RUNGE_KUTTA_4] = {.stages = 4,
                              .c = {0.0, 1.0 / 2.0, 1.0 / 2.0, 1.0},
                              .a = {{0.0}, {1.0 / 2.0}, {0.0, 1.0 / 2.0}, {0.0, 0.0, 1.0}},
                              .b = {1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0}},
};

/* base + step * (weights' slopes) */
static void advance(const double base[], double step, int n_slopes, const double weights[],
                    double slopes[][N_STATES], double result[])
{
    for (int i = 0; i < N_STATES; i++) {
        double slope = 0.0;
        for (int j = 0; j < n_slopes; j++) {
            slope += weights[j] * slopes[j][i];
        }
        result[i] = base[i] + step * slope;
    }
}

void solver_step(int solver, double time, double step, double *states, const double *inputs, const double *parameters,
                 const int *enumerations)
{
    const Tableau *const method = &tableaus[solver];
    double slopes[MAX_STAGES][N_STATES];
    double stage[N_STATES];

    for (int i = 0; i < method->stages; i++) {
        advance(states, step, i, method->a[i], slopes, stage);
        model_derivatives(time + method->c[i] * step, stage, inputs, parameters, enumerations, slopes[i]);
    }
    advance(states, step, method->stages, method->b, slopes, states);
}
