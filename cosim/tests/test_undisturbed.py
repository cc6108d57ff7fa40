"""Blocks that no signal interrupts, and what is done in the end whatever comes."""

import gc
import os
import signal
import subprocess
import sys
import threading

import pytest

from cosim.undisturbed import SIGNALS, Ending, deaf, disturbed, undisturbed

POSIX = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")


def press() -> None:
    signal.raise_signal(signal.SIGINT)


def test_a_signal_waits_for_the_end_of_the_block() -> None:
    seen: list[object] = []

    def block() -> None:
        with undisturbed():
            assert not disturbed()
            with undisturbed():
                press()
                seen.append("goes on")
                other = threading.Thread(target=lambda: seen.append(disturbed()))
                other.start()
                other.join()
            assert disturbed(), "it waits for the outer block, too"

    with pytest.raises(KeyboardInterrupt):
        block()
    assert not disturbed()
    assert seen == ["goes on", False], "other threads have their own blocks"


def test_all_is_done_in_the_end_whenever_a_signal_comes() -> None:
    done: list[int] = []

    def work(number: int) -> None:
        press()
        done.append(number)

    ending = Ending()
    for number in range(3):
        ending.callback(work, number)
    with pytest.raises(KeyboardInterrupt):
        ending.close()
    assert done == [2, 1, 0]
    ending.close()
    assert done == [2, 1, 0]


def test_a_fault_of_one_does_not_keep_the_others_from_it() -> None:
    done: list[int] = []
    ending = Ending()
    ending.callback(done.append, 1)
    ending.callback(lambda: 1 // 0)
    with pytest.raises(ZeroDivisionError):
        ending.close()
    assert done == [1]


def test_what_is_lost_is_done() -> None:
    done: list[int] = []
    with Ending() as ending:
        ending.callback(done.append, 1)
        kept = ending.pop_all()
    assert done == []
    del kept
    gc.collect()
    assert done == [1]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="forks")
def test_a_forked_process_does_not_do_it() -> None:
    reading, writing = os.pipe()
    ending = Ending()
    ending.callback(lambda: os.write(writing, str(os.getpid()).encode()))
    if (pid := os.fork()) == 0:
        del ending
        gc.collect()
        os._exit(0)
    os.waitpid(pid, 0)
    ending.close()
    os.close(writing)
    assert os.read(reading, 100) == str(os.getpid()).encode()
    os.close(reading)


# Processes that hear none -----------------------------------------------------------------------------------

DEAF = """
import multiprocessing, os, signal, subprocess, sys, time
from cosim.undisturbed import SIGNALS, stay_deaf
for number in SIGNALS:
    os.kill(os.getpid(), number)
stay_deaf()
for number in SIGNALS:
    os.kill(os.getpid(), number)
    started = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    time.sleep(1.0)
    started.send_signal(number)
    print(started.wait(30.0))
forked = multiprocessing.get_context("fork").Process(target=time.sleep, args=(60.0,))
forked.start()
forked.terminate()
forked.join(30.0)
print(forked.exitcode)
"""


@POSIX
def test_a_process_that_stays_deaf_ends_what_it_starts_by_signals() -> None:
    with deaf():
        done = subprocess.run([sys.executable, "-c", DEAF], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [*(str(-number) for number in SIGNALS), str(-signal.SIGTERM)]


@POSIX
def test_whoever_starts_deaf_processes_hears_signals_again() -> None:
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ())

    def block() -> None:
        with deaf():
            press()

    with pytest.raises(KeyboardInterrupt):
        block()
    with pytest.raises(ValueError, match="made up"), deaf():
        raise ValueError("made up")
    assert signal.pthread_sigmask(signal.SIG_BLOCK, ()) == before
