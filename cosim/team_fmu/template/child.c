/* The law's process. First of all the sources, as it says what it needs of the system. */
#ifndef _WIN32
#define _POSIX_C_SOURCE 200809L
#ifdef __APPLE__
#define _DARWIN_C_SOURCE
#elif defined(__linux__)
#define _DEFAULT_SOURCE
#endif
#endif

#include "child.h"

#include <stdlib.h>

#ifdef _WIN32

struct Tool *model_open(const char *resources, const char **fault)
{
    (void)resources;
    *fault = LAW " runs in Python beside this FMU, which works on Linux and macOS only";
    return NULL;
}

const char *model_begin(struct Tool *tool, const double *parameters, const int *integers)
{
    (void)tool;
    (void)parameters;
    (void)integers;
    return LAW " has no process";
}

const char *child_tick(struct Tool *tool, int team, long long tick, const void *inputs, size_t given, void *outputs,
                       size_t taken)
{
    (void)team;
    (void)tick;
    (void)inputs;
    (void)given;
    (void)outputs;
    (void)taken;
    return model_begin(tool, NULL, NULL);
}

void model_end(struct Tool *tool)
{
    (void)tool;
}

void model_close(struct Tool *tool)
{
    (void)tool;
}

#else

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#ifdef __linux__
#include <sys/syscall.h>
#endif
#include <sys/types.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

extern char **environ;

enum { CHILD_MESSAGE = 320, CHILD_PATH = 1024, CHILD_HEADER = 5 };
/* Kinds of requests and replies, see host.py. */
enum { CHILD_STEP = 1, CHILD_TEAMS = 3, CHILD_DONE = 0 };
/* Beside the statuses of a process that has ended, which are at least 0. */
enum { CHILD_UNKNOWN = -1, CHILD_KILLED = -2 };

static const char child_mark[] = "formation " MODEL_GUID "\n";
static const double child_farewell = 1.0; /* s that the process has to end by itself */

struct Tool {
    char *resources;
    pid_t process; /* 0 without one */
    int socket;
    char message[CHILD_MESSAGE];
};

/* ---- the process ---- */

static double child_now(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* Whether the process has ended, which stays to be waited for. */
static bool child_has_ended(const struct Tool *tool)
{
    siginfo_t about;
    memset(&about, 0, sizeof about);
    const int failed = waitid(P_PID, (id_t)tool->process, &about, WEXITED | WNOHANG | WNOWAIT);
    return (failed && errno != EINTR) || about.si_pid == tool->process;
}

/* End the process with all that it has started; how it has ended, CHILD_KILLED, or CHILD_UNKNOWN. */
static int child_stop(struct Tool *tool, double patience)
{
    if (tool->process <= 0) return CHILD_UNKNOWN;
    close(tool->socket);
    const double until = child_now() + patience;
    while (!child_has_ended(tool) && child_now() < until) {
        const struct timespec moment = {0, 2000000};
        nanosleep(&moment, NULL);
    }
    const bool was_alive = !child_has_ended(tool);
    kill(-tool->process, SIGKILL); /* it leads a group of its own */
    int status = CHILD_UNKNOWN;
    while (waitpid(tool->process, &status, 0) < 0) {
        if (errno == EINTR) continue;
        status = CHILD_UNKNOWN; /* somebody else has waited for it */
        break;
    }
    tool->process = 0;
    return was_alive ? CHILD_KILLED : status;
}

void model_end(struct Tool *tool)
{
    if (tool != NULL) child_stop(tool, child_farewell);
}

void model_close(struct Tool *tool)
{
    if (tool == NULL) return;
    model_end(tool);
    free(tool->resources);
    free(tool);
}

/* ---- bytes ---- */

typedef enum { CHILD_MOVED, CHILD_GONE, CHILD_LATE } Moved;

/* Write or read so many bytes. */
static Moved child_move(const struct Tool *tool, bool writes, void *bytes, size_t size, double until)
{
#ifdef MSG_NOSIGNAL
    const int flags = MSG_DONTWAIT | MSG_NOSIGNAL;
#else
    const int flags = MSG_DONTWAIT;
#endif
    char *at = bytes;
    while (size > 0) {
        const ssize_t moved = writes ? send(tool->socket, at, size, flags) : recv(tool->socket, at, size, MSG_DONTWAIT);
        if (moved > 0) {
            at += moved;
            size -= (size_t)moved;
            continue;
        }
        if (moved == 0) return CHILD_GONE;
        if (errno == EINTR) continue;
        if (errno != EAGAIN && errno != EWOULDBLOCK) return CHILD_GONE;
        const double left = until - child_now();
        if (left <= 0.0) return CHILD_LATE;
        struct pollfd one = {.fd = tool->socket, .events = writes ? POLLOUT : POLLIN};
        poll(&one, 1, left < 1000.0 ? (int)(1e3 * left) + 1 : 1000000);
    }
    return CHILD_MOVED;
}

/* Why the process, which is ended, did not do something. */
static const char *child_lost(struct Tool *tool, const char *what, Moved moved, double limit)
{
    const int status = child_stop(tool, moved == CHILD_LATE ? 0.0 : child_farewell);
    char how[96] = ": its process has ended";
    if (moved == CHILD_LATE) {
        snprintf(how, sizeof how, " within %g s; its process was ended", limit);
    } else if (status == CHILD_KILLED) {
        snprintf(how, sizeof how, ": it closed its connection; its process was ended");
    } else if (status != CHILD_UNKNOWN && WIFSIGNALED(status)) {
        snprintf(how, sizeof how, ": its process crashed (signal %d)", WTERMSIG(status));
    } else if (status != CHILD_UNKNOWN && WIFEXITED(status)) {
        snprintf(how, sizeof how, ": its process exited with status %d", WEXITSTATUS(status));
    }
    snprintf(tool->message, sizeof tool->message, LAW " did not %s%s", what, how);
    return tool->message;
}

/* Read a reply, of which `size` bytes are expected. NULL, or why there is none. */
static const char *child_reply(struct Tool *tool, const char *what, void *answer, size_t size, double until,
                               double limit)
{
    unsigned char header[CHILD_HEADER];
    Moved moved = child_move(tool, false, header, sizeof header, until);
    if (moved != CHILD_MOVED) return child_lost(tool, what, moved, limit);
    const size_t length =
        (size_t)header[1] | (size_t)header[2] << 8 | (size_t)header[3] << 16 | (size_t)header[4] << 24;
    if (header[0] == CHILD_DONE && length == size) {
        moved = child_move(tool, false, answer, size, until);
        return moved == CHILD_MOVED ? NULL : child_lost(tool, what, moved, limit);
    }
    char said[CHILD_MESSAGE - sizeof LAW - 16];
    if (header[0] == CHILD_DONE || length >= sizeof said) {
        child_stop(tool, 0.0);
        return LAW " answered without sense; its process was ended";
    }
    moved = child_move(tool, false, said, length, until);
    if (moved != CHILD_MOVED) return child_lost(tool, what, moved, limit);
    said[length] = '\0';
    snprintf(tool->message, sizeof tool->message, LAW "%s", said);
    return tool->message;
}

static const char *child_request(struct Tool *tool, const char *what, int kind, const void *body, size_t size,
                                 void *answer, size_t expected, double limit)
{
    unsigned char request[CHILD_HEADER + CHILD_ROOM];
    request[0] = (unsigned char)kind;
    for (int i = 0; i < 4; i++) request[1 + i] = (unsigned char)(size >> 8 * i);
    if (size > 0) memcpy(request + CHILD_HEADER, body, size);
    const double until = child_now() + limit;
    const Moved moved = child_move(tool, true, request, CHILD_HEADER + size, until);
    if (moved != CHILD_MOVED) return child_lost(tool, what, moved, limit);
    return child_reply(tool, what, answer, expected, until, limit);
}

/* ---- its start ---- */

static char *child_path(const struct Tool *tool, const char *name)
{
    const size_t size = strlen(tool->resources) + strlen(name) + 2;
    char *const path = malloc(size);
    if (path != NULL) snprintf(path, size, "%s/%s", tool->resources, name);
    return path;
}

/* Its Python: the one that the environment names, or the one that the FMU was made with. */
static bool child_interpreter(const struct Tool *tool, char interpreter[CHILD_PATH])
{
    const char *const named = getenv("FORMATION_LAW_PYTHON");
    if (named != NULL && named[0] != '\0') {
        return snprintf(interpreter, CHILD_PATH, "%s", named) < CHILD_PATH;
    }
    char *const path = child_path(tool, "interpreter.txt");
    FILE *const file = path == NULL ? NULL : fopen(path, "r");
    free(path);
    const bool is_read = file != NULL && fgets(interpreter, CHILD_PATH, file) != NULL;
    if (file != NULL) fclose(file);
    if (is_read) interpreter[strcspn(interpreter, "\r\n")] = '\0';
    return is_read && interpreter[0] != '\0';
}

/* Whether the main thread starts the process: with another thread it must not end. */
static bool child_of_main_thread(void)
{
#ifdef __linux__
    return syscall(SYS_gettid) == (long)getpid();
#else
    return false;
#endif
}

/* Start a program that speaks through one end of a socket. 0, or the error. */
static int child_spawn(struct Tool *tool, char *const arguments[])
{
    int ends[2];
    if (socketpair(AF_UNIX, SOCK_STREAM, 0, ends)) return errno;
    for (int i = 0; i < 2; i++) { /* neither is a standard stream, nor inherited by another program */
        const int end = fcntl(ends[i], F_DUPFD_CLOEXEC, 3);
        const int error = errno;
        close(ends[i]);
        ends[i] = end;
        if (end < 0) {
            close(ends[1 - i]);
            return error;
        }
    }
#ifdef SO_NOSIGPIPE
    const int on = 1;
    setsockopt(ends[0], SOL_SOCKET, SO_NOSIGPIPE, &on, sizeof on);
#endif
    posix_spawn_file_actions_t actions;
    posix_spawnattr_t attributes;
    sigset_t none, usual;
    sigemptyset(&none);
    sigemptyset(&usual);
    sigaddset(&usual, SIGPIPE);
    posix_spawn_file_actions_init(&actions);
    posix_spawnattr_init(&attributes);
    posix_spawn_file_actions_adddup2(&actions, ends[1], 0);
    posix_spawn_file_actions_adddup2(&actions, ends[1], 1);
    const int errors = fcntl(2, F_GETFD); /* a master without standard error may have another file there */
    if (errors < 0 || errors & FD_CLOEXEC) {
        posix_spawn_file_actions_addopen(&actions, 2, "/dev/null", O_WRONLY, 0);
    }
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
    posix_spawnattr_setpgroup(&attributes, 0);
    posix_spawnattr_setsigmask(&attributes, &none);
    posix_spawnattr_setsigdefault(&attributes, &usual);
    const int error = posix_spawn(&tool->process, arguments[0], &actions, &attributes, arguments, environ);
    posix_spawnattr_destroy(&attributes);
    posix_spawn_file_actions_destroy(&actions);
    close(ends[1]);
    tool->socket = ends[0];
    if (error) {
        close(ends[0]);
        tool->process = 0;
    }
    return error;
}

/* Read up to where the host begins: what Python loads at its start may have printed. */
static Moved child_hear(const struct Tool *tool, double until)
{
    const size_t size = sizeof child_mark - 1;
    char last[sizeof child_mark] = "";
    for (int read = 0; read < 65536; read++) {
        memmove(last, last + 1, size - 1);
        const Moved moved = child_move(tool, false, &last[size - 1], 1, until);
        if (moved != CHILD_MOVED) return moved;
        if (memcmp(last, child_mark, size) == 0) return CHILD_MOVED;
    }
    return CHILD_GONE;
}

static const char *child_start(struct Tool *tool)
{
    if (tool->process > 0) return NULL;
    char interpreter[CHILD_PATH];
    if (!child_interpreter(tool, interpreter)) {
        return LAW " has no Python: the file interpreter.txt of the FMU's resources is not there";
    }
    char owner[24], main_thread[2] = "0";
    snprintf(owner, sizeof owner, "%ld", (long)getpid());
    main_thread[0] = child_of_main_thread() ? '1' : '0';
    char isolated[] = "-I", option[] = "-X", utf8[] = "utf8", mark[sizeof child_mark];
    memcpy(mark, child_mark, sizeof child_mark);
    char *const host = child_path(tool, "host.py"), *const law = child_path(tool, "law.json");
    char *const arguments[] = {interpreter, isolated, option, utf8, host, owner, main_thread, mark, law, NULL};
    const int error = host == NULL || law == NULL ? ENOMEM : child_spawn(tool, arguments);
    free(host);
    free(law);
    if (error) {
        snprintf(tool->message, sizeof tool->message,
                 LAW
                 " needs a Python with its package: %.120s cannot be started (%s); FORMATION_LAW_PYTHON names another",
                 interpreter, strerror(error));
        return tool->message;
    }
    const double until = child_now() + CHILD_START_LIMIT;
    const Moved moved = child_hear(tool, until);
    if (moved != CHILD_MOVED) return child_lost(tool, "start", moved, CHILD_START_LIMIT);
    const char *const fault = child_reply(tool, "start", NULL, 0, until, CHILD_START_LIMIT);
    if (fault != NULL) child_stop(tool, child_farewell);
    return fault;
}

/* ---- for the model ---- */

static int child_digit(char c)
{
    return c >= '0' && c <= '9'   ? c - '0'
           : c >= 'a' && c <= 'f' ? c - 'a' + 10
           : c >= 'A' && c <= 'F' ? c - 'A' + 10
                                  : -1;
}

/* FMI 2.0 has a URI, of the forms file:/path, file:///path and file://host/path; FMI 3.0 has a path. */
struct Tool *model_open(const char *resources, const char **fault)
{
    *fault = LAW " needs the FMU's resources: their location was not given";
    if (resources == NULL || resources[0] == '\0') return NULL;
    *fault = "out of memory";
    struct Tool *const tool = calloc(1, sizeof *tool);
    if (tool == NULL) return NULL;
    const bool is_uri = strncmp(resources, "file:", 5) == 0;
    const char *from = resources + (is_uri ? 5 : 0);
    if (is_uri && strncmp(from, "//", 2) == 0) {
        from += 2;
        from += strcspn(from, "/");
    }
    tool->resources = malloc(strlen(from) + 1);
    if (tool->resources == NULL) {
        free(tool);
        return NULL;
    }
    char *to = tool->resources;
    while (*from != '\0') {
        const bool is_escape = is_uri && from[0] == '%' && child_digit(from[1]) >= 0 && child_digit(from[2]) >= 0;
        *to++ = is_escape ? (char)(16 * child_digit(from[1]) + child_digit(from[2])) : *from;
        from += is_escape ? 3 : 1;
    }
    *to = '\0';
    return tool;
}

const char *model_begin(struct Tool *tool, const double *parameters, const int *integers)
{
    (void)integers;
    const char *const fault = child_start(tool);
    if (fault != NULL) return fault;
    return child_request(tool, "start", CHILD_TEAMS, parameters, N_PARAMETERS * sizeof(double), NULL, 0,
                         CHILD_START_LIMIT);
}

const char *child_tick(struct Tool *tool, int team, long long tick, const void *inputs, size_t given, void *outputs,
                       size_t taken)
{
    if (tool->process <= 0) return LAW " has no process any more";
    unsigned char body[CHILD_ROOM];
    const int64_t head[2] = {team, tick};
    memcpy(body, head, sizeof head);
    memcpy(body + sizeof head, inputs, given);
    const double limit = tick == 0 && CHILD_START_LIMIT > CHILD_LIMIT ? CHILD_START_LIMIT : CHILD_LIMIT;
    return child_request(tool, "complete the tick", CHILD_STEP, body, sizeof head + given, outputs, taken, limit);
}

#endif
