"""Signals are held, whatever the moment in which they come."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any

import pytest

import cosim.master.interrupt
from cosim.master.interrupt import SIGNALS, HeldSignals


@pytest.fixture(autouse=True)
def raising() -> Iterator[None]:
    """Let all signals raise KeyboardInterrupt, as in the command line."""
    before = {number: signal.signal(number, signal.default_int_handler) for number in SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


class Signaller:
    """Raises signals when a certain instruction of the module under test, counted from zero, is about to run."""

    def __init__(self, instruction: int, number: signal.Signals, times: int) -> None:
        self.left = instruction
        self._number = number
        self._times = times

    def __call__(self, frame: FrameType, event: str, _: Any) -> Callable[..., Any] | None:
        if frame.f_code.co_filename != cosim.master.interrupt.__file__:
            return None
        frame.f_trace_opcodes = True
        if event == "opcode":
            self.left -= 1
            if self.left == -1:
                for _ in range(self._times):
                    signal.raise_signal(self._number)
        return self


def saves(done: list[str]) -> None:
    """Do what a run does."""

    def work() -> None:
        done.append("recorded")

    with HeldSignals() as signals:
        signals.breakable(work)
        done.append("saved")


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.parametrize("times", [1, 2])
def test_at_any_instruction(number: signal.Signals, times: int) -> None:
    """What is recorded is saved, and in the end signals raise again, all of them."""
    interrupted = 0
    for instruction in range(10_000):
        done: list[str] = []
        signaller = Signaller(instruction, number, times)
        sys.settrace(signaller)
        try:
            saves(done)
        except KeyboardInterrupt:
            interrupted += 1
        finally:
            sys.settrace(None)
        assert done in ([], ["recorded", "saved"], ["saved"]), instruction
        for one in SIGNALS:
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(one)
        if signaller.left >= 0:
            break
    assert instruction > 100, "all instructions of the module"
    assert 0 < interrupted < instruction


def test_the_second_one_ends_code_of_others() -> None:
    begun: list[int] = []

    def never_ends() -> None:
        for count in range(3):
            begun.append(count)
            signal.raise_signal(signal.SIGINT)

    with HeldSignals() as signals:
        signals.breakable(never_ends)
        assert begun == [0, 1]
        for _ in range(5):
            signal.raise_signal(signal.SIGTERM)
    assert signals.received == 7


def test_many_break_nothing_in_a_process_that_is_supervised() -> None:
    done: list[signal.Signals] = []

    def work() -> None:
        for number in SIGNALS:
            signal.raise_signal(number)
            done.append(number)

    with HeldSignals(supervised=True) as signals:
        signals.breakable(work)
    assert signals.received == len(SIGNALS)
    assert tuple(done) == SIGNALS


def test_code_of_others_may_fail_or_interrupt_itself() -> None:
    def fails(error: BaseException) -> None:
        raise error

    with HeldSignals() as signals:
        with pytest.raises(ValueError, match="made up"):
            signals.breakable(lambda: fails(ValueError("made up")))
        signals.breakable(lambda: fails(KeyboardInterrupt()))
        for _ in range(5):
            signal.raise_signal(signal.SIGINT)
    assert signals.received == 6


def test_a_block_within_a_block() -> None:
    with HeldSignals() as outer:
        signal.raise_signal(signal.SIGINT)
        with HeldSignals() as inner:
            assert inner.received == 1, "it is not forgotten"
            signal.raise_signal(signal.SIGTERM)
        assert outer.received == 2


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="POSIX signals")
def test_ignored_signals_stay_ignored() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with HeldSignals() as signals:
        signal.raise_signal(signal.SIGHUP)
        signal.raise_signal(signal.SIGINT)
    assert signals.received == 1
    assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
