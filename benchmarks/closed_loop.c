/* The closed loop of scenarios/clmr_line.xml, written by hand for this scenario alone: what no master can beat in scalar C.
 *
 * In one loop over the ticks: measure, control, saturate, record and step; one follower after the other, then the leader.
 * No call but to the C library, no check, no message, no memory to get. Left out is whatever the scenario does not use:
 * the gains guard and torque_limit, friction, end stops, disturbances, other drives, other solvers than Euler's. Random
 * numbers are handed in.
 *
 * The arithmetic is that of the product, operation by operation, so that all numbers agree to the bit where both call
 * the same sine, cosine, tangent, exponential function and arctangent. The order of the operations between robots, which
 * does not matter, is the one that is fastest here, and a sum that is needed twice is taken once. Numbers in brackets are
 * the paper's equations. benchmarks/closed_loop.py compiles, calls and checks this file.
 */
#include <math.h>

/* A header with functions of the same names behind a prefix, in place of the C library's. */
#ifdef FUNCTIONS
#include FUNCTIONS
#define sin elementary_sin
#define cos elementary_cos
#define tan elementary_tan
#define atan2 elementary_atan2
#define exp elementary_exp
#endif

enum { CENTRES = 9, INPUTS = 13 };

static const double PI = 3.141592653589793;

typedef struct {
    double x, y, psi, gamma;
} Pose;

typedef struct {
    Pose pose;
    double v, omega;
} State;

typedef struct {
    double drive, steer;
} Torque;

typedef struct {
    double range, bearing, range_error, bearing_error;
} Formation;

/* The parameters of (56). */
typedef struct {
    double a, m_c, I_c, I_f, d_x, d_y, d_psi, d_gamma;
} Plant;

typedef struct {
    double K_p[2], Lambda_0[2], Lambda_1[2], k_d, epsilon_t, gamma_theta, theta_m, gamma_w, W_m;
    double centres[CENTRES], widths[CENTRES];
} Gains;

/* What a follower is to do; zero derivatives are handed in, too, as the law takes any. */
typedef struct {
    double q[2], q_dot[2], q_ddot[2];
} Desired;

/* The states of the law of one follower. */
typedef struct {
    double bearing, q_hat[2], p[2], zeta[2], epsilon_hat_integral[2], epsilon_q_tilde_integral[2];
    double W[2][CENTRES], theta;
    double trace; /* tr(W'W) */
} Memory;

typedef struct {
    double range_estimate, bearing_estimate, range_rate_estimate, bearing_rate_estimate;
    double speed_estimate, steering_rate_estimate, weight_norm, gain_estimate, torque_command[2];
    double drive_gain, det_R, relative_range, cos_bearing, cos_steering, guarded, held;
} Telemetry;

/* ---- the plant ---- */

/* One step by Euler's method of (56), reduced by (3). */
static inline void step_plant(const Plant *p, double h, Torque tau, State *s)
{
    const double v = s->v, omega = s->omega, aa = p->a * p->a, I = p->I_c + p->I_f;
    const double c = cos(s->pose.psi), sn = sin(s->pose.psi), t = tan(s->pose.gamma), c_gamma = cos(s->pose.gamma);
    const double tt = t * t, cc_gamma = c_gamma * c_gamma;
    const double M_11 = p->m_c + tt * I / aa, M_12 = p->I_f * t / p->a, M_22 = p->I_f;
    const double D_11 = c * c * p->d_x + p->d_y * (sn * sn) + p->d_psi * tt / aa;
    const double C_v_1 = omega * t * v * I / (aa * cc_gamma), C_v_2 = p->I_f * omega * v / (p->a * cc_gamma);
    const double f_1 = (sn * t + 1.0) * tau.drive - C_v_1 - D_11 * v;
    const double f_2 = -C_v_2 - p->d_gamma * omega + tau.steer;
    const double det = M_11 * M_22 - M_12 * M_12;

    s->pose.x += h * (c * v);
    s->pose.y += h * (sn * v);
    s->pose.psi += h * (t / p->a * v);
    s->pose.gamma += h * omega;
    s->v += h * ((-M_12 * f_2 + M_22 * f_1) / det);
    s->omega += h * ((M_11 * f_2 - M_12 * f_1) / det);
}

/* ---- the law ---- */

static inline double unwrapped(double angle, double previous)
{
    return angle - 2.0 * PI * floor((angle - previous + PI) / (2.0 * PI));
}

/* Range and angle of the leader, (4) and (7). */
static inline void look(double a, const Pose *own, const Pose *leader, double c, double s, double e[2], double *rho, double *phi)
{
    const double dx = leader->x - own->x, dy = leader->y - own->y;
    e[0] = c * dx + s * dy;
    e[1] = c * dy - s * dx;
    const double forward = e[0] - a;
    *rho = sqrt(forward * forward + e[1] * e[1]);
    *phi = atan2(e[1], forward);
}

static void start_law(double a, const Pose *own, const Pose *leader, const Desired *d, Memory *m)
{
    static const Memory zero;
    double e[2], rho, phi;
    look(a, own, leader, cos(own->psi), sin(own->psi), e, &rho, &phi);
    *m = zero;
    m->q_hat[0] = rho;
    m->q_hat[1] = m->bearing = unwrapped(phi - own->gamma, d->q[1]);
}

static inline double trace_of(double W[2][CENTRES])
{
    double total = 0.0;
    for (int m = 0; m < 2; m++) {
        for (int k = 0; k < CENTRES; k++) total += W[m][k] * W[m][k];
    }
    return total;
}

/* Adaptation of the weights, (28) and (29): an Euler step, and back onto the ball. */
static inline void step_weights(const Gains *g, double h, const double s[2], const double sigma[CENTRES], Memory *m)
{
    double outward = 0.0;
    if (!(m->trace < g->W_m * (1.0 - 1e-9))) {
        double growth = 0.0;
        for (int i = 0; i < 2; i++) {
            for (int k = 0; k < CENTRES; k++) growth += s[i] * m->W[i][k] * sigma[k];
        }
        outward = growth > 0.0 ? growth / m->trace : 0.0;
    }
    for (int i = 0; i < 2; i++) {
        for (int k = 0; k < CENTRES; k++) m->W[i][k] += h * g->gamma_w * (s[i] * sigma[k] - outward * m->W[i][k]);
    }
    m->trace = trace_of(m->W);
    if (m->trace > g->W_m) {
        const double shrink = sqrt(g->W_m / m->trace);
        for (int i = 0; i < 2; i++) {
            for (int k = 0; k < CENTRES; k++) m->W[i][k] *= shrink;
        }
        m->trace = trace_of(m->W);
    }
}

/* One tick of (24) to (34) for one follower. */
static inline Torque step_law(const Gains *g, double h, double a, const Pose *own, const State *leader, const Desired *d,
                              Memory *m, Telemetry *out)
{
    const double c = cos(own->psi), sn = sin(own->psi), t = tan(own->gamma), c_gamma = cos(own->gamma);
    double e[2], rho, phi;
    look(a, own, &leader->pose, c, sn, e, &rho, &phi);
    const double e_3 = leader->pose.psi - own->psi, e_4 = leader->pose.gamma - own->gamma;
    const double q[2] = {rho, unwrapped(phi - own->gamma, m->bearing)};

    /* R and delta, (8); B2, (3) */
    const double c_phi = cos(phi), s_phi = sin(phi);
    const double R_11 = -c_phi - s_phi * t, R_21 = (s_phi - c_phi * t) / rho - t / a;
    const double delta[2] = {leader->v * cos(e_3 - phi), leader->v * sin(e_3 - phi) / rho};
    const double drive_gain = 1.0 + t * sn;

    /* Observer, (32), and errors, (25) */
    double q_tilde[2], q_hat_dot[2], epsilon_hat[2], epsilon_q_tilde[2], s[2], pid[2];
    for (int j = 0; j < 2; j++) {
        q_tilde[j] = q[j] - m->q_hat[j];
        q_hat_dot[j] = m->p[j] + (g->Lambda_0[j] + g->k_d) * q_tilde[j];
        epsilon_hat[j] = m->q_hat[j] - d->q[j];
        epsilon_q_tilde[j] = q[j] - d->q[j] + q_tilde[j];
        s[j] = q_hat_dot[j] - d->q_dot[j] + g->Lambda_0[j] * epsilon_q_tilde[j]
            + g->Lambda_1[j] * m->epsilon_q_tilde_integral[j];
        pid[j] = q_hat_dot[j] - d->q_dot[j] + g->Lambda_0[j] * epsilon_hat[j] + g->Lambda_1[j] * m->epsilon_hat_integral[j];
    }

    /* Network, (11) */
    const double x[INPUTS] = {e[0],         e[1],         e_3,         e_4,         leader->pose.gamma, leader->v, leader->omega,
                              q_hat_dot[0], q_hat_dot[1], d->q_dot[0], d->q_dot[1], d->q_ddot[0],       d->q_ddot[1]};
    double sigma[CENTRES] = {0.0}, network[2] = {0.0, 0.0};
    for (int i = 0; i < INPUTS; i++) {
        for (int k = 0; k < CENTRES; k++) {
            const double difference = x[i] - g->centres[k];
            sigma[k] += difference * difference;
        }
    }
    for (int k = 0; k < CENTRES; k++) sigma[k] = exp(-sigma[k] / (g->widths[k] * g->widths[k]));
    for (int k = 0; k < CENTRES; k++) {
        network[0] += m->W[0][k] * sigma[k];
        network[1] += m->W[1][k] * sigma[k];
    }

    /* Torque, (24) */
    const double s_norm = sqrt(s[0] * s[0] + s[1] * s[1]);
    const double robust = m->theta * m->theta / (m->theta * s_norm + g->epsilon_t);
    double u[2];
    for (int j = 0; j < 2; j++) u[j] = -g->K_p[j] * pid[j] - network[j] - robust * s[j];
    /* The product solves with B2 = diag(drive_gain, 1) by Cramer's rule, hence the two roundings of the second torque. */
    const Torque tau = {(R_11 * u[0] + R_21 * u[1]) / drive_gain, drive_gain * -u[1] / drive_gain};

    const double y[2] = {q_hat_dot[0] - delta[0], q_hat_dot[1] - delta[1]};
    *out = (Telemetry){.range_estimate = m->q_hat[0],
                       .bearing_estimate = m->q_hat[1],
                       .range_rate_estimate = q_hat_dot[0],
                       .bearing_rate_estimate = q_hat_dot[1],
                       .speed_estimate = y[0] / R_11,
                       .steering_rate_estimate = (R_11 * y[1] - R_21 * y[0]) / -R_11,
                       .weight_norm = sqrt(m->trace),
                       .gain_estimate = m->theta,
                       .torque_command = {tau.drive, tau.steer},
                       .drive_gain = drive_gain,
                       .det_R = -R_11,
                       .relative_range = rho / a,
                       .cos_bearing = cos(q[1]),
                       .cos_steering = c_gamma};

    /* Adaptation, (28) to (30); observer and integrals, (33) and (34), by Euler's method */
    step_weights(g, h, s, sigma, m);
    m->theta += h * g->gamma_theta * s_norm;
    if (m->theta > g->theta_m) m->theta = g->theta_m;
    for (int j = 0; j < 2; j++) {
        const double p_dot = d->q_ddot[j] + g->k_d * g->Lambda_0[j] * q_tilde[j] + g->Lambda_1[j] * q_tilde[j] + m->zeta[j];
        m->zeta[j] += h * (g->k_d * g->Lambda_1[j] * q_tilde[j]);
        m->p[j] += h * p_dot;
        m->q_hat[j] += h * q_hat_dot[j];
        m->epsilon_hat_integral[j] += h * epsilon_hat[j];
        m->epsilon_q_tilde_integral[j] += h * epsilon_q_tilde[j];
    }
    m->bearing = q[1];
    return tau;
}

/* ---- the loop, and its parts alone; arrays by ticks, then robots, of which 0 is the leader ---- */

static inline double clipped(double value, double limit)
{
    return value > limit ? limit : value < -limit ? -limit : value;
}

void closed_loop(long samples, long n, double h, const Plant *plant, const Gains *g, double limit, const Desired *desired,
                 const Torque *leader_torque, const Pose *noise, State *now, Memory *memory, State *states, Pose *measured,
                 Torque *torques, Telemetry *telemetry)
{
    for (long k = 0; k < samples; k++) {
        const int last = k == samples - 1;
        *states++ = now[0];
        *torques++ = leader_torque[k];
        for (long i = 0; i < n; i++, noise++, desired++) {
            State *const own = &now[1 + i];
            const Pose seen = {own->pose.x + noise->x, own->pose.y + noise->y, own->pose.psi + noise->psi,
                               own->pose.gamma + noise->gamma};
            if (k == 0) start_law(plant->a, &seen, &now[0].pose, desired, &memory[i]);
            const Torque command = step_law(g, h, plant->a, &seen, &now[0], desired, &memory[i], telemetry++);
            const Torque applied = {clipped(command.drive, limit), clipped(command.steer, limit)};
            *measured++ = seen;
            *states++ = *own;
            *torques++ = applied;
            if (!last) step_plant(plant, h, applied, own);
        }
        if (!last) step_plant(plant, h, leader_torque[k], &now[0]);
    }
}

/* What a result holds besides: range and bearing as they truly are, and their errors. */
void formation(long samples, long n, double a, const Desired *desired, const State *states, Formation *out)
{
    for (long k = 0; k < samples; k++, states += 1 + n) {
        for (long i = 0; i < n; i++, desired++, out++) {
            const Pose *const own = &states[1 + i].pose;
            double e[2], rho, phi;
            look(a, own, &states[0].pose, cos(own->psi), sin(own->psi), e, &rho, &phi);
            const double bearing = unwrapped(phi - own->gamma, k == 0 ? desired->q[1] : (out - n)->bearing);
            *out = (Formation){rho, bearing, rho - desired->q[0], bearing - desired->q[1]};
        }
    }
}

void plants_alone(long ticks, long robots, double h, const Plant *plant, const Torque *torques, State *now, State *states)
{
    for (long k = 0; k < ticks; k++) {
        for (long i = 0; i < robots; i++) {
            step_plant(plant, h, *torques++, &now[i]);
            *states++ = now[i];
        }
    }
}

void law_alone(long ticks, long n, double h, double a, const Gains *g, const Desired *desired, const Pose *measured,
               const State *leader, Memory *memory, Torque *commands, Telemetry *telemetry)
{
    for (long k = 0; k < ticks; k++) {
        for (long i = 0; i < n; i++, measured++) {
            if (k == 0) start_law(a, measured, &leader[k].pose, &desired[i], &memory[i]);
            *commands++ = step_law(g, h, a, measured, &leader[k], &desired[i], &memory[i], &telemetry[i]);
        }
    }
}
