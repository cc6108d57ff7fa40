/* A simple car for tests, and all that it can be made to do wrong. The token in the model description tells it what.
 *
 *     dx/dt = v cos(psi), dy/dt = v sin(psi), dpsi/dt = v tan(gamma)/a, dgamma/dt = omega,
 *     dv/dt = tau_drive/10, domega/dt = tau_steer/10
 *
 * with discrete inputs, which have no effect unless they are set: dv/dt is zero unless it is enabled, is multiplied by
 * the gear, and by 1, 0 or -1 in the direction 1, 2 or 3.
 *
 * fmi1.c, fmi2.c and fmi3.c are thin layers over it. In Co-Simulation one explicit Euler step is taken per
 * communication step. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fenv.h>
#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#define TOKEN "formation-stub "
#define EPSILON 1e-9 /* of times [s] */

enum { X, Y, PSI, GAMMA, V, OMEGA, STATES };

/* Value references. */
enum {
    DER = 6,         /* derivatives of the states */
    TAU_DRIVE = 12,
    TAU_STEER,
    WHEELBASE,
    WHEN,
    START = 16,      /* x0, y0, psi0, gamma0 */
    POWER = 20,
    DRIVE,           /* enumeration */
    EVENTS,          /* integer */
    INDICATOR,       /* two */
    POSE = 30,       /* arrays of 4, 2 and 4 */
    TORQUE,
    DER_POSE,
    TIME = 40,
    ENABLE = 50,     /* discrete inputs: true or false, a whole number, an enumeration, a text */
    GEAR,
    DIRECTION,
    NOTE,
    PUSH,            /* a real input [N], which accelerates the mass of 10 kg */
    FILLER = 1000    /* and all above: parameters that do nothing */
};

typedef enum { MINUS = -1, OK, WARNING, DISCARD, ERROR, FATAL, PENDING, ILLEGAL = 17 } Status;

typedef enum { CREATED, INITIALIZATION, STEP_MODE, EVENT_MODE, CONTINUOUS_TIME, TERMINATED } Mode;

typedef struct Stub Stub;

/* What can be saved and restored. */
typedef struct {
    double time, state[STATES], before[STATES], input[2], push, a, when, start[4], last_successful_time;
    int drive, gear, direction, events, contact[2]; /* contact: with the end stops of the steering, at +limit and -limit */
    long steps;
    bool enabled, braked, terminated, logged, event_pending;
    char note[32];
    Mode mode;
} Car;

struct Stub {
    Car car;
    char behaviour[32], place[32]; /* what goes wrong, and in which function */
    double scale[STATES], offset[STATES]; /* from SI to what is shown: units, signs, zeros */
    double scale_length, scale_steer;     /* of the wheelbase, of the steering torque */
    double mass;                          /* that its resources tell, or 0 */
    double end_stop, fixed_step, seconds, per_whole; /* per_whole: units of a whole number in one of the real one */
    int late; /* before the first step outputs are: 1 zero, 2 not a number, 3 refused; 4: always those of one step before */
    long lines;
    bool once, time_event, step_event, start_parameters, start_torque, says_tolerance, jumps;
    bool model_exchange, fatal, nothing, event_mode, early_always;
    bool early_return, intermediate_update, save;
    bool event_mode_used, early_allowed; /* as the importer says, FMI 3 */
    void (*log)(Stub *, Status, const char *category, const char *text, bool as_format);
    void *environment;
    void (*logger)(void);
    void (*update)(void);
    char name[128];
};

static inline void say(Stub *s, Status status, const char *format, ...)
{
    char text[512];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    s->log(s, status, status >= ERROR ? "logStatusError" : status == OK ? "logEvents" : "logStatusWarning", text, false);
}

/* ---- what the token says ---- */

static inline void text_option(const char *token, const char *name, char *value, size_t size, const char *otherwise)
{
    char key[64];
    snprintf(key, sizeof key, " %s=", name);
    const char *at = strstr(token, key);
    snprintf(value, size, "%s", otherwise);
    if (at == NULL) return;
    at += strlen(key);
    const size_t length = strcspn(at, " ");
    snprintf(value, size, "%.*s", (int)length, at);
}

static inline double option(const char *token, const char *name, double otherwise)
{
    char value[64];
    text_option(token, name, value, sizeof value, "");
    return value[0] == '\0' ? otherwise : strtod(value, NULL);
}

/* ---- misbehaviour ---- */

static inline bool is(const Stub *s, const char *behaviour)
{
    return strcmp(s->behaviour, behaviour) == 0;
}

static inline void segfault(void)
{
    static volatile size_t nowhere = 8;
    *(volatile int *)nowhere = 1;
}

static inline void hang(void)
{
    for (;;) pause();
}

/* A thread that never ends, in code of this library: which may neither be unloaded nor torn down under it. */
static volatile bool has_thread = false;

static inline void *live(void *nothing)
{
    for (;;) usleep(1000);
    return nothing;
}

__attribute__((destructor)) static void torn_down(void)
{
    if (has_thread) abort();
}

/* Start a process of a session of its own that nobody waits for, which holds all that this one has open. */
static inline void leave_a_daemon(void)
{
    static bool left = false;
    if (left) return;
    left = true;
    const pid_t child = fork();
    if (child > 0) waitpid(child, NULL, 0);
    if (child != 0) return;
    setsid();
    if (fork() > 0) _exit(0);
    hang();
}

/* A recursion without end, which no compiler can make a loop. */
static inline int overflow(volatile char *above)
{
    volatile char block[4096];
    block[0] = above[0];
    return overflow(block) + block[0];
}

/* End this process, or hang for ever, if that is what is asked for. */
static inline void end_or_hang(const char *how)
{
    if (strcmp(how, "daemon_exit") == 0) _exit(7);
    if (strcmp(how, "segfault") == 0) segfault();
    if (strcmp(how, "overflow") == 0) {
        volatile char first[1] = {0};
        exit(overflow(first));
    }
    if (strcmp(how, "exit") == 0) exit(7);
    if (strcmp(how, "exit_0") == 0) exit(0);
    if (strcmp(how, "abort") == 0) abort();
    if (strcmp(how, "hang_stubborn") == 0) {
        signal(SIGTERM, SIG_IGN);
        signal(SIGINT, SIG_IGN);
        hang();
    }
    if (strcmp(how, "hang") == 0 || strcmp(how, "daemon_hang") == 0) hang();
    if (strcmp(how, "spin") == 0) {
        for (volatile long i = 0;; i++) {}
    }
}

/* When it is loaded, it does what a file among its resources asks for, before anyone can call it. */
__attribute__((constructor)) static void loaded(void)
{
    Dl_info about;
    char path[4096], how[32] = "";
    if (dladdr((void *)&loaded, &about) == 0) return;
    snprintf(path, sizeof path, "%s", about.dli_fname);
    for (int i = 0; i < 3; i++) {
        char *const slash = strrchr(path, '/');
        if (slash == NULL) return;
        *slash = '\0';
    }
    strncat(path, "/resources/at_load.txt", sizeof path - strlen(path) - 1);
    FILE *const file = fopen(path, "r");
    if (file == NULL) return;
    if (fscanf(file, "%31s", how) != 1) how[0] = '\0';
    fclose(file);
    end_or_hang(how);
}

/* A thread that crashes a little after it was told to. */
static volatile bool crash_now = false;

static inline void *wait_and_crash(void *nothing)
{
    while (!crash_now) usleep(1000);
    usleep(10000);
    segfault();
    return nothing;
}

/* Start it in the first call; in the second one let it crash, and wait for that. */
static inline void crash_in_a_thread(void)
{
    static bool started = false;
    pthread_t thread;
    if (!started) {
        started = pthread_create(&thread, NULL, wait_and_crash, NULL) == 0;
        return;
    }
    crash_now = true;
    hang();
}

/* Write what makes no sense into every pipe that this process has open, apart from the standard streams, and go no
 * further. */
static inline void write_garbage(bool endless)
{
    static bool written = false;
    static const char garbage[4096] = "\xff\xff\xff\xffThis is no reply.";
    struct stat about;
    if (written) return;
    written = true;
    do {
        for (int descriptor = 3; descriptor < 4096; descriptor++) {
            if (fstat(descriptor, &about) != 0 || !S_ISFIFO(about.st_mode)) continue;
            if (write(descriptor, garbage, sizeof garbage) < 0) continue; /* the end from which one reads */
        }
    } while (endless);
    hang();
}

/* Close every pipe that this process has open, apart from the standard streams, and go no further. */
static inline void close_pipes(void)
{
    struct stat about;
    for (int descriptor = 3; descriptor < 4096; descriptor++) {
        if (fstat(descriptor, &about) == 0 && S_ISFIFO(about.st_mode)) close(descriptor);
    }
    hang();
}

/* Do what this stub does in a function of the importer's interface: mostly nothing. */
static inline Status act(Stub *s, const char *place)
{
    static const struct { const char *name; Status status; } returned[] = {
        {"warning", WARNING}, {"discard", DISCARD}, {"error", ERROR}, {"silent", ERROR}, {"fatal", FATAL},
        {"fatal_strict", FATAL}, {"pending", PENDING}, {"illegal", ILLEGAL}, {"minus", MINUS},
    };
    Car *const car = &s->car;
    if (s->nothing || strcmp(s->place, place) != 0) return OK;
    const bool timed = strcmp(place, "step") == 0 || strcmp(place, "set") == 0 || strcmp(place, "get") == 0;
    if (timed && car->time < car->when - EPSILON) return OK;
    static const char *const deadly[] = {"segfault", "exit", "exit_0", "abort", "hang", "hang_stubborn", "spin",
                                         "daemon_exit", "daemon_hang", "overflow", "thread_crash", "garbage_endless",
                                         "close_pipes"};
    for (size_t i = 0; i < sizeof deadly / sizeof deadly[0]; i++) {
        if (is(s, deadly[i])) say(s, OK, "%s goes into %s at t = %g s, as it was made to", place, s->behaviour, car->time);
    }
    if (strncmp(s->behaviour, "daemon", 6) == 0) leave_a_daemon();
    if (is(s, "thread_crash")) crash_in_a_thread();
    if (is(s, "garbage")) write_garbage(false);
    if (is(s, "garbage_endless")) write_garbage(true);
    if (is(s, "close_pipes")) close_pipes();
    end_or_hang(s->behaviour);
    if (is(s, "slow")) usleep((useconds_t)(s->seconds * 1e6));
    if (is(s, "print")) {
        printf("%s prints at t = %g s\n", s->name, car->time);
        fflush(stdout);
    }
    if (is(s, "close_descriptors")) {
        for (int descriptor = 0; descriptor < 3; descriptor++) close(descriptor);
    }
    if (is(s, "rounding")) fesetround(FE_UPWARD);
#ifdef __GLIBC__
    if (is(s, "trap")) feenableexcept(FE_DIVBYZERO | FE_INVALID | FE_OVERFLOW);
#endif
    if (is(s, "chdir") && chdir("/") != 0) return ERROR;
    if (is(s, "signals")) signal(SIGINT, SIG_IGN);
    if (is(s, "thread") && !has_thread) {
        pthread_t thread;
        has_thread = pthread_create(&thread, NULL, live, NULL) == 0;
    }
    if (is(s, "terminate")) car->terminated = true;
    if (strncmp(s->behaviour, "log_", 4) == 0 && !car->logged) {
        car->logged = true;
        if (is(s, "log_million")) {
            for (long i = 1; i <= s->lines; i++) say(s, OK, "line %ld of %ld", i, s->lines);
        } else if (is(s, "log_odd")) {
            s->log(s, WARNING, "logStatusWarning",
                   "100 % sure of %s and %d: \xff\xfe not UTF-8, \x1b[31mred\x1b[0m, bell \a, tab \t, two\r\nlines", false);
        } else if (is(s, "log_percent")) { /* where the text is a format (FMI 1 and 2) this is a fault of the FMU's */
            s->log(s, WARNING, "logStatusWarning", "100 % of it", true);
        } else if (is(s, "log_long")) {
            const size_t length = 1000000;
            char *const text = malloc(length + 1);
            memset(text, 'x', length);
            text[length] = '\0';
            s->log(s, OK, "logEvents", text, false);
            free(text);
        }
    }
    for (size_t i = 0; i < sizeof returned / sizeof returned[0]; i++) {
        if (!is(s, returned[i].name)) continue;
        if (is(s, "silent")) return ERROR;
        say(s, returned[i].status, "%s returns %s at t = %g s, as it was made to", place, s->behaviour, car->time);
        s->fatal = is(s, "fatal_strict");
        return returned[i].status;
    }
    return OK;
}

/* Whether a function may be called now; if not, say so. After a strict Fatal nothing may be called at all. */
static inline bool allowed(Stub *s, const char *function, unsigned modes)
{
    if (s->fatal) abort();
    if (s->nothing || (modes >> s->car.mode & 1) != 0) return true;
    static const char *const names[] = {"instantiated", "initialization mode", "step mode", "event mode",
                                        "continuous-time mode", "terminated"};
    say(s, ERROR, "%s was called in the wrong mode: %s", function, names[s->car.mode]);
    return false;
}

/* ---- life ---- */

/* The instance that exists, if one only is allowed, is known by the process's environment: so that not even a copy of
 * the library can have a second one. */
static inline bool claim(Stub *s)
{
    char process[32];
    snprintf(process, sizeof process, "%ld", (long)getpid());
    const char *const owner = getenv("FORMATION_STUB_INSTANCE");
    if (owner != NULL && strcmp(owner, process) == 0) {
        say(s, ERROR, "it can be instantiated only once per process, and there is an instance already");
        return false;
    }
    setenv("FORMATION_STUB_INSTANCE", process, 1);
    return true;
}

#ifdef UNIQUE
__attribute__((visibility("default"))) extern double unique_count;
__asm__(".pushsection .data\n.balign 8\n.globl unique_count\n.type unique_count, %gnu_unique_object\n"
        ".size unique_count, 8\nunique_count: .quad 0\n.popsection");
#endif

static inline void reset(Stub *s, double when)
{
#ifdef UNIQUE
    unique_count += 1.0;
#endif
    s->car = (Car){.a = 1.2, .drive = 3, .when = when, .enabled = true, .gear = 1, .direction = 1, .note = ""};
}

/* Read the mass from a folder of which the path or the URI is given. */
static inline bool read_mass(Stub *s, const char *resources)
{
    char path[4096];
    const char *at = resources == NULL ? "" : strncmp(resources, "file://", 7) == 0 ? resources + 7 : resources;
    size_t n = 0;
    for (; *at != '\0' && n + 16 < sizeof path; at++) {
        unsigned code;
        if (at != resources && *at == '%' && sscanf(at + 1, "%2x", &code) == 1) at += 2;
        else code = (unsigned char)*at;
        path[n++] = (char)code;
    }
    strcpy(path + n, "/mass.txt");
    FILE *const file = fopen(path, "r");
    const bool found = file != NULL && fscanf(file, "%lf", &s->mass) == 1;
    if (file != NULL) fclose(file);
    if (!found) say(s, ERROR, "it cannot read its mass from %s", path);
    return found;
}

/* Make of `made`, in which only what concerns the log is set, an instance on the heap; or NULL, having logged why. */
static inline Stub *create(Stub made, const char *name, const char *token, const char *resources, bool model_exchange)
{
    Stub *s = &made;
    snprintf(s->name, sizeof s->name, "%s", name == NULL ? "?" : name);
    if (token == NULL || strncmp(token, TOKEN, strlen(TOKEN)) != 0) {
        say(s, ERROR, "the token %s is not that of this binary", token == NULL ? "NULL" : token);
        return NULL;
    }
    char units[32];
    text_option(token, "behaviour", s->behaviour, sizeof s->behaviour, "good");
    text_option(token, "place", s->place, sizeof s->place, "step");
    text_option(token, "units", units, sizeof units, "si");
    for (int i = 0; i < STATES; i++) s->scale[i] = 1.0;
    if (strcmp(units, "deg") == 0) {
        s->scale[PSI] = s->scale[GAMMA] = s->scale[OMEGA] = 180.0 / 3.14159265358979323846;
        s->scale[V] = 3.6;
    }
    s->scale_length = s->scale_steer = 1.0;
    if (strcmp(units, "odd") == 0) {
        s->scale[X] = s->scale[Y] = s->scale_length = 1.0 / 201.168;
        s->scale[PSI] = s->scale[GAMMA] = s->scale[OMEGA] = 200.0 / 3.14159265358979323846;
        s->scale[V] = 3.6;
    }
    if (option(token, "compass", 0) != 0) {
        s->offset[PSI] = 3.14159265358979323846 / 2 * s->scale[PSI];
        s->scale[PSI] *= -1.0, s->scale[GAMMA] *= -1.0, s->scale[OMEGA] *= -1.0;
        s->scale_steer = -1.0;
    }
    if (option(token, "resources", 0) != 0 && !read_mass(s, resources)) return NULL;
    s->end_stop = option(token, "end_stop", INFINITY);
    s->fixed_step = option(token, "fixed_step", 0.0);
    s->per_whole = option(token, "per_whole", 1.0);
    s->seconds = option(token, "seconds", 0.1);
    s->lines = (long)option(token, "lines", 1e6);
    s->once = option(token, "once", 0) != 0;
    s->time_event = option(token, "time_event", 0) != 0;
    s->step_event = option(token, "step_event", 0) != 0;
    s->jumps = option(token, "jumps", 0) != 0;
    s->start_parameters = option(token, "start_parameters", 0) != 0;
    s->late = (int)option(token, "late", 0.0);
    s->says_tolerance = option(token, "says_tolerance", 0) != 0;
    s->start_torque = option(token, "start_torque", 0) != 0;
    s->event_mode = option(token, "event_mode", 0) != 0;
    s->early_return = option(token, "early_return", 0) != 0;
    s->early_always = option(token, "early_always", 0) != 0;
    s->intermediate_update = option(token, "intermediate_update", 0) != 0;
    s->save = option(token, "save", 0) != 0;
    s->nothing = is(s, "nothing");
    s->model_exchange = model_exchange;
    reset(s, option(token, "when", 1.0));
    if (act(s, "instantiate") >= DISCARD) return NULL;
    if (s->once && !claim(s)) return NULL;
    Stub *const kept = malloc(sizeof *kept);
    if (kept != NULL) *kept = made;
    return kept;
}

static inline void destroy(Stub *s)
{
    if (s == NULL) return;
    if (s->fatal) abort();
    act(s, "free");
    if (s->once) unsetenv("FORMATION_STUB_INSTANCE");
    free(s);
}

static inline void hear_tolerance(Stub *s, bool told, double tolerance)
{
    if (s->says_tolerance && told) say(s, OK, "it is told a tolerance of %g", tolerance);
    if (s->says_tolerance && !told) say(s, OK, "it is told no tolerance");
}

static inline Status finish_initialization(Stub *s, Mode next)
{
    Car *const car = &s->car;
    const Status status = act(s, "initialization");
    if (status >= DISCARD) return status;
    if (s->start_parameters) memcpy(car->state, car->start, sizeof car->start);
    if (s->start_torque) car->state[V] = car->input[0] / 10.0;
    car->mode = next;
    car->last_successful_time = car->time;
    return status;
}

static inline Status restart(Stub *s)
{
    const Status status = act(s, "reset");
    if (status >= DISCARD) return status;
    const Car before = s->car;
    reset(s, before.when);
    if (is(s, "stale")) s->car.a = before.a, s->car.state[V] = before.state[V];
    return status;
}

static inline Status finish(Stub *s)
{
    const Status status = act(s, "terminate");
    if (status < DISCARD) s->car.mode = TERMINATED;
    return status;
}

/* ---- the model ---- */

#ifdef VENDOR
double vendor_mass(void); /* of a library of its own */
#else
static inline double vendor_mass(void)
{
#ifdef UNIQUE /* as a static variable of an inline function of C++: it counts the instances */
    return unique_count * 10.0;
#else
    return 10.0;
#endif
}
#endif

static inline void derivatives(const Stub *s, double rate[STATES])
{
    const Car *const car = &s->car;
    const double *const z = car->state;
    const bool held = car->contact[0] || car->contact[1];
    rate[X] = z[V] * cos(z[PSI]);
    rate[Y] = z[V] * sin(z[PSI]);
    rate[PSI] = z[V] * tan(z[GAMMA]) / car->a;
    rate[GAMMA] = held ? 0.0 : z[OMEGA];
    rate[V] = car->input[0] / (s->mass > 0.0 ? s->mass : vendor_mass()) * (car->enabled ? car->gear : 0) * (2 - car->direction) + car->push / 10.0;
    rate[OMEGA] = held ? 0.0 : car->input[1] / 10.0;
    if (is(s, "nan") && car->time >= car->when - EPSILON) rate[X] = NAN;
    if (is(s, "infinity") && car->time >= car->when - EPSILON) rate[V] = INFINITY;
}

/* Positive, until the steering reaches an end stop; then positive as long as the torque presses it there. */
static inline void indicators(const Stub *s, double value[2])
{
    for (int i = 0; i < 2; i++) {
        const double sign = i == 0 ? 1.0 : -1.0;
        value[i] = s->car.contact[i] ? sign * s->car.input[1] + 1e-6 : s->end_stop - sign * s->car.state[GAMMA] + 1e-9;
    }
}

static inline bool time_event_due(const Stub *s)
{
    return s->time_event && !s->car.braked && s->car.time >= s->car.when - (s->model_exchange ? 0.0 : EPSILON);
}

static inline bool step_event_due(const Stub *s)
{
    return s->step_event && fabs(s->car.state[PSI]) > 3.14159265358979323846;
}

/* Handle all events that are due: the time event brakes to standstill, the end stops hold the steering, and the step
 * event brings the heading back to at most half a turn. Return whether states were changed. */
static inline bool handle_events(Stub *s)
{
    Car *const car = &s->car;
    const int before = car->events;
    if (time_event_due(s)) {
        car->state[V] = 0.0;
        car->braked = true;
        car->events++;
    }
    if (step_event_due(s)) {
        car->state[PSI] -= copysign(2 * 3.14159265358979323846, car->state[PSI]);
        car->events++;
    }
    double value[2];
    indicators(s, value);
    for (int i = 0; i < 2; i++) {
        if (value[i] > 0.0) continue;
        car->contact[i] = !car->contact[i];
        car->state[GAMMA] = (i == 0 ? 1.0 : -1.0) * s->end_stop;
        car->state[OMEGA] = 0.0;
        car->events++;
    }
    return car->events != before;
}

static inline void euler(Stub *s, double h)
{
    double rate[STATES];
    derivatives(s, rate);
    for (int i = 0; i < STATES; i++) s->car.state[i] += h * rate[i];
    s->car.time += h;
}

/* Go on to a time, with events as they come, unless the importer handles them. */
static inline void advance(Stub *s, double end)
{
    Car *const car = &s->car;
    const double h = s->fixed_step > 0.0 ? s->fixed_step : end - car->time;
    const long n = s->fixed_step > 0.0 ? lround((end - car->time) / h) : 1;
    const double begin = car->time;
    memcpy(car->before, car->state, sizeof car->state);
    for (long i = 1; i <= n; i++) {
        const double next = i == n ? end : begin + i * h;
        if (s->time_event && !car->braked && car->when < next - EPSILON && car->when > car->time && !s->event_mode_used) {
            euler(s, car->when - car->time);
            car->time = car->when;
            handle_events(s);
        }
        euler(s, next - car->time);
        car->time = next;
        if (!s->event_mode_used) handle_events(s);
    }
    car->steps++;
}

/* Begin a communication step: whether it can be taken. */
static inline Status begin_step(Stub *s, double time, double h)
{
    Car *const car = &s->car;
    if (fabs(time - car->time) > 1e-6 * (1.0 + fabs(time))) {
        say(s, ERROR, "a step was asked for at t = %.9g s, but it is t = %.9g s", time, car->time);
        return ERROR;
    }
    if (!(h > 0.0)) {
        say(s, ERROR, "the step size %g s is not positive", h);
        return ERROR;
    }
    if (s->fixed_step > 0.0) {
        const double ratio = h / s->fixed_step;
        if (ratio < 0.5 || fabs(ratio - round(ratio)) > 1e-6) {
            say(s, ERROR, "the step size %.9g s is no multiple of the fixed internal step %.9g s", h, s->fixed_step);
            return ERROR;
        }
    }
    car->last_successful_time = time;
    car->time = time;
    return act(s, "step");
}

/* ---- variables ---- */

static inline size_t length(unsigned reference)
{
    return reference == POSE || reference == DER_POSE ? 4 : reference == TORQUE ? 2 : 1;
}

static inline double shown(const Stub *s, int i, double state)
{
    return state * s->scale[i] + s->offset[i];
}

static inline double taken(const Stub *s, int i, double value)
{
    return (value - s->offset[i]) / s->scale[i];
}

static inline double output(const Stub *s, int i)
{
    const bool now = s->car.time >= s->car.when - EPSILON;
    if (now && i == X && is(s, "nan")) return NAN;
    if (now && i == V && is(s, "infinity")) return INFINITY;
    return shown(s, i, s->late == 4 && s->car.steps > 0 ? s->car.before[i] : s->car.state[i]);
}

static inline Status get_real(Stub *s, unsigned reference, double *value)
{
    const Car *const car = &s->car;
    double rate[STATES];
    if (s->start_parameters && car->mode < STEP_MODE) memcpy(s->car.state, car->start, sizeof car->start);
    if (reference < STATES) {
        *value = output(s, (int)reference);
    } else if (reference < DER + STATES) {
        derivatives(s, rate);
        *value = rate[reference - DER] * s->scale[reference - DER];
    } else if (reference == TAU_DRIVE || reference == TAU_STEER) {
        *value = car->input[reference - TAU_DRIVE] * (reference == TAU_STEER ? s->scale_steer : 1.0);
    } else if (reference == WHEELBASE) {
        *value = car->a * s->scale_length;
    } else if (reference == WHEN) {
        *value = car->when;
    } else if (reference >= START && reference < START + 4) {
        *value = shown(s, (int)reference - START, car->start[reference - START]);
    } else if (reference == POWER) {
        *value = car->input[0] * car->state[V];
    } else if (reference == INDICATOR || reference == INDICATOR + 1) {
        double both[2];
        indicators(s, both);
        *value = both[reference - INDICATOR];
    } else if (reference == POSE) {
        for (int i = 0; i < 4; i++) value[i] = output(s, i);
    } else if (reference == DER_POSE) {
        derivatives(s, rate);
        for (int i = 0; i < 4; i++) value[i] = rate[i] * s->scale[i];
    } else if (reference == TORQUE) {
        memcpy(value, car->input, sizeof car->input);
        value[1] *= s->scale_steer;
    } else if (reference == PUSH) {
        *value = car->push;
    } else if (reference == TIME) {
        *value = car->time;
    } else if (reference >= FILLER) {
        *value = 0.0;
    } else {
        say(s, ERROR, "there is no real variable with the value reference %u", reference);
        return ERROR;
    }
    const bool is_output = reference < STATES || reference == POSE;
    if (is_output && s->late > 0 && s->late < 4 && car->steps == 0) {
        for (size_t i = 0; i < length(reference); i++) value[i] = s->late == 1 ? 0.0 : NAN;
        return s->late == 3 ? ERROR : OK;
    }
    return is_output ? act(s, "get") : OK;
}

static inline bool settable_discrete(Stub *s, unsigned reference)
{
    if (!s->model_exchange || s->car.mode != CONTINUOUS_TIME) return true;
    say(s, ERROR, "the discrete variable with the value reference %u cannot be set in continuous time", reference);
    return false;
}

static inline Status set_real(Stub *s, unsigned reference, const double *value)
{
    Car *const car = &s->car;
    const bool before = car->mode < STEP_MODE;
    if (s->jumps && !settable_discrete(s, reference)) return ERROR;
    if (reference == TAU_DRIVE || reference == TAU_STEER) {
        const Status status = act(s, "set");
        const double scale = reference == TAU_STEER ? s->scale_steer : 1.0;
        if (status < DISCARD) car->input[reference - TAU_DRIVE] = *value / scale;
        return status;
    }
    if (reference == TORQUE) {
        const Status status = act(s, "set");
        if (status < DISCARD) memcpy(car->input, value, sizeof car->input);
        if (status < DISCARD) car->input[1] /= s->scale_steer;
        return status;
    }
    if (reference == WHEELBASE) {
        car->a = *value / s->scale_length;
    } else if (reference == PUSH) {
        car->push = *value;
    } else if (reference == WHEN) {
        if (*value < 0.0) {
            say(s, ERROR, "the time when = %g s is negative", *value);
            return ERROR;
        }
        car->when = *value;
        return before ? OK : act(s, "change");
    } else if (before && reference < STATES && (!s->start_parameters || reference >= V)) {
        car->state[reference] = taken(s, (int)reference, *value);
    } else if (before && reference == POSE && !s->start_parameters) {
        for (int i = 0; i < 4; i++) car->state[i] = taken(s, i, value[i]);
    } else if (before && s->start_parameters && reference >= START && reference < START + 4) {
        car->start[reference - START] = taken(s, (int)reference - START, *value);
    } else if (reference >= FILLER) {
        return OK;
    } else {
        say(s, ERROR, "the variable with the value reference %u cannot be set now", reference);
        return ERROR;
    }
    return OK;
}

/* Whether a discrete input can be set now: of Model Exchange not in continuous time (FMI 2.0, section 3.2.1). */
static inline Status get_whole(Stub *s, unsigned reference, int *value)
{
    const Car *const car = &s->car;
    double real = 0.0;
    switch (reference) {
    case DRIVE: *value = car->drive; return OK;
    case EVENTS: *value = car->events; return OK;
    case GEAR: *value = car->gear; return OK;
    case DIRECTION: *value = car->direction; return OK;
    default:
        if (reference >= FILLER || get_real(s, reference, &real) >= DISCARD) {
            say(s, ERROR, "there is no integer or enumeration with the value reference %u", reference);
            return ERROR;
        }
        *value = (int)lround(real * s->per_whole);
        return OK;
    }
}

static inline Status set_whole(Stub *s, unsigned reference, int value)
{
    if (reference == GEAR || reference == DIRECTION) {
        if (!settable_discrete(s, reference)) return ERROR;
        *(reference == GEAR ? &s->car.gear : &s->car.direction) = value;
        return OK;
    }
    if (reference == DRIVE && value >= 1 && value <= 3) {
        s->car.drive = value;
        return OK;
    }
    const double real = value / s->per_whole;
    if (reference != DRIVE && reference < FILLER && set_real(s, reference, &real) < DISCARD) return OK;
    say(s, ERROR, "the variable with the value reference %u cannot be set to %d", reference, value);
    return ERROR;
}

static inline Status set_switch(Stub *s, unsigned reference, bool value)
{
    if (reference != ENABLE) {
        say(s, ERROR, "there is no boolean with the value reference %u", reference);
        return ERROR;
    }
    if (!settable_discrete(s, reference)) return ERROR;
    s->car.enabled = value;
    return OK;
}

static inline Status set_text(Stub *s, unsigned reference, const char *value)
{
    if (reference != NOTE) {
        say(s, ERROR, "there is no text with the value reference %u", reference);
        return ERROR;
    }
    if (!settable_discrete(s, reference)) return ERROR;
    snprintf(s->car.note, sizeof s->car.note, "%s", value);
    say(s, WARNING, "the note says %s", s->car.note);
    return OK;
}
