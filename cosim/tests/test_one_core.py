"""A thread and a process on one core."""

import os
import subprocess
import sys
from collections.abc import Iterator

import pytest

from cosim.plant import one_core
from cosim.plant.one_core import OneCore

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux keeps threads on a core")


@pytest.fixture
def other() -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen([sys.executable, "-S", "-c", "input()"], stdin=subprocess.PIPE) as process:
        yield process
        process.kill()


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time [s], to be changed."""
    moment = [100.0]
    monkeypatch.setattr(one_core.time, "monotonic", lambda: moment[0])
    return moment


def test_a_process_that_ends_keeps_nobody(other: subprocess.Popen[bytes], now: list[float]) -> None:
    allowed = os.sched_getaffinity(0)
    with OneCore((other.pid,)) as core:
        core.settle(1)
        now[0] += one_core.TRIAL
        core.settle(2)
        kept = os.sched_getaffinity(0)
        assert len(kept) == 1
        assert kept <= allowed
        assert os.sched_getaffinity(other.pid) == kept
        other.kill()
        other.wait()
    assert os.sched_getaffinity(0) == allowed
    for companions in ((other.pid,), ()):  # it has ended
        with OneCore(companions) as core:
            core.settle(1)
            now[0] += one_core.TRIAL
            core.settle(2)
            assert os.sched_getaffinity(0) == allowed


@pytest.mark.parametrize("faster", [False, True])
def test_both_are_kept_on_one_core_of_those_allowed_if_that_is_faster(
    other: subprocess.Popen[bytes], now: list[float], faster: bool
) -> None:
    allowed = os.sched_getaffinity(0)
    with OneCore((other.pid,)) as core:
        for _ in range(2):
            core.settle(0)
            assert os.sched_getaffinity(other.pid) == allowed, "first apart"
            now[0] += one_core.TRIAL
            core.settle(10)
            assert len(os.sched_getaffinity(other.pid)) == 1, "then together"
            now[0] += one_core.TRIAL
            core.settle(21 if faster else 19)
            chosen = os.sched_getaffinity(other.pid)
            assert (len(chosen) == 1) == (faster or len(allowed) == 1)
            now[0] += 0.9 * one_core.TOGETHER
            core.settle(500)
            assert os.sched_getaffinity(other.pid) == chosen
            now[0] += 0.2 * one_core.TOGETHER
    assert os.sched_getaffinity(0) == os.sched_getaffinity(other.pid) == allowed
