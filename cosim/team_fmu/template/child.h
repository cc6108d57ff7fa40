/* The process in which Python runs the law: host.py of the FMU's resources. It starts with the initialisation, and ends
 * with the instance. Each request and each reply is one message through a socket: a kind (one byte), a length (four
 * bytes, the least significant first), and that many bytes. A request to begin brings the parameters, and one for a
 * tick two 64-bit integers, team and tick, and the inputs, all as this machine has them. A reply brings commands and
 * telemetry, or a text that says why there are none. */
#ifndef CHILD_H
#define CHILD_H

#include <stddef.h>

#include "law.h"
#include "model.h"

/* Let the law run a tick of a team: from its inputs to its outputs, so many bytes. A tick may come once more, with
 * other inputs: then the law is led back to before it. Returns NULL, or why that is not possible. */
const char *child_tick(struct Tool *tool, int team, long long tick, const void *inputs, size_t given, void *outputs,
                       size_t taken);

#endif
