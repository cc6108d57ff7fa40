"""Interpreters in processes of their own: how they are started, and how they end."""

from __future__ import annotations

import os
import signal
import site
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from cosim import process_tree
from cosim.compiled import PLAIN
from cosim.undisturbed import deaf


def environment(mark: str, plain: bool = True) -> dict[str, str]:
    """Return the environment of a process that runs FMUs: it finds this package where the harness has found it.

    Parameters
    ----------
    mark
        That of the process, by which `kill` knows what it has started.
    plain
        Whether it does without compiled code.
    """
    variables = {**os.environ, mark: "1", **({PLAIN: "1"} if plain else {})}
    root = str(Path(__file__).parents[2])
    if root not in (*site.getsitepackages(), site.getusersitepackages()):  # of which some may hide standard modules
        variables["PYTHONPATH"] = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH"))))
    return variables


def launch(
    command: Sequence[str], variables: dict[str, str], inherited: tuple[int, ...] = (), errors: int | None = None
) -> subprocess.Popen[bytes]:
    """Start an interpreter that finds modules where this one does; see `start`.

    Its arguments are this process, and the folders where Python finds modules here.
    """
    folders = (os.path.abspath(folder) for folder in sys.path)
    return start([*command, str(os.getpid()), *folders], variables, inherited, errors)


def start(
    command: Sequence[str], variables: dict[str, str], inherited: tuple[int, ...] = (), errors: int | None = None
) -> subprocess.Popen[bytes]:
    """Start an interpreter that is reached through its standard input and output.

    Neither Ctrl-C nor another signal that stops a command reaches it. It stays in the session, as Linux shares a core
    out between sessions first: one cannot give way to the other in time.

    Parameters
    ----------
    command
        Its path, and its arguments.
    variables
        Its environment; see `environment`.
    inherited
        Descriptors that it has, too.
    errors
        A descriptor for its standard error; without one, that of this process.
    """
    with deaf():
        return subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=variables,
            pass_fds=inherited,
            stderr=errors if errors is not None or _standard_error() else subprocess.DEVNULL,
            bufsize=0,
            process_group=0 if os.name == "posix" else None,
            creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),  # which Windows alone has
        )


def _standard_error() -> bool:
    """Return whether the harness has a standard error that a process can inherit, and no other file in its place."""
    try:
        return os.get_inheritable(2)
    except OSError:
        return False


def kill(process: subprocess.Popen[bytes], mark: str) -> None:
    """End a process with everything that it has started, and wait for it."""
    kill_only(process, mark)
    process.wait()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with suppress(OSError):
                pipe.close()


def kill_only(process: subprocess.Popen[bytes], mark: str) -> None:
    """End a process likewise, but do not wait for it.

    Once it has been waited for, its number may be that of another process: then what it has left is ended by its mark.
    """
    if process.returncode is None:
        process_tree.end(process.pid, mark)
        process.kill()
    else:
        process_tree.end_marked(mark)


def wait(process: subprocess.Popen[bytes], mark: str, limit: float) -> int:
    """Wait for a process to end by itself, end what it has left, and return its status.

    What it has left is ended at once: later, the process's number may be that of another one, see `kill_only`.

    Raises
    ------
    subprocess.TimeoutExpired
        It has not ended within a time limit [s].
    """
    status = process.wait(limit)
    process_tree.end(process.pid, mark)
    return status


def how_it_ended(status: int, limit: float | None = None) -> str:
    """Return how a process ended, in words that follow what it did not do.

    Parameters
    ----------
    status
        Its exit status; of a signal, the negative number.
    limit
        The time [s] after which it was to be ended; None if it was within its limit.
    """
    if limit is not None and status == -signal.SIGKILL:  # and not by itself a moment before
        return f" within {limit:g} s; its process was ended"
    if status < 0:
        name = signal.Signals(-status).name if -status in set(signal.Signals) else f"signal {-status}"
        return f": its process crashed ({name})"
    return f": its process exited with status {status}"


def tells_of_kill(message: str) -> bool:
    """Return whether a message says that a process was killed, as the system does for want of memory, or anybody."""
    return how_it_ended(-signal.SIGKILL) in message
