"""A thread and a process on one core."""

import os
import subprocess
import sys
from collections.abc import Iterator

import pytest

from cosim.plant import one_core
from cosim.plant.one_core import Companions, OneCore

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux keeps threads on a core")


@pytest.fixture
def other() -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen([sys.executable, "-S", "-c", "input()"], stdin=subprocess.PIPE) as process:
        yield process
        process.kill()


def test_both_are_kept_on_one_core_of_those_allowed_and_let_go(
    other: subprocess.Popen[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    allowed = os.sched_getaffinity(0)
    with OneCore(Companions((other.pid,), in_turns=True)) as core:
        assert os.sched_getaffinity(0) == os.sched_getaffinity(other.pid) == allowed, "not before a first segment"
        core.settle(1)
        kept = os.sched_getaffinity(0)
        assert len(kept) == 1
        assert kept <= allowed
        assert os.sched_getaffinity(other.pid) == kept
        core.settle(1)
        assert os.sched_getaffinity(0) == kept
        monkeypatch.setattr(one_core.time, "monotonic", lambda: float("inf"))
        core.settle(1)
        assert os.sched_getaffinity(0) == os.sched_getaffinity(other.pid) == allowed, "so that they can be moved"
        core.settle(1)
        assert len(os.sched_getaffinity(other.pid)) == 1
    assert os.sched_getaffinity(0) == os.sched_getaffinity(other.pid) == allowed


def test_a_process_that_ends_keeps_nobody(other: subprocess.Popen[bytes]) -> None:
    allowed = os.sched_getaffinity(0)
    with OneCore(Companions((other.pid,), in_turns=True)) as core:
        core.settle(1)
        assert len(os.sched_getaffinity(0)) == 1
        other.kill()
        other.wait()
    assert os.sched_getaffinity(0) == allowed
    with OneCore(Companions((other.pid,), in_turns=True)) as core:  # it has ended
        core.settle(1)
        assert os.sched_getaffinity(0) == allowed
    with OneCore(Companions()) as core:
        core.settle(1)
        assert os.sched_getaffinity(0) == allowed


@pytest.mark.parametrize("faster", [False, True])
def test_processes_that_work_side_by_side_are_kept_together_if_that_is_faster(
    other: subprocess.Popen[bytes], monkeypatch: pytest.MonkeyPatch, faster: bool
) -> None:
    allowed, now = os.sched_getaffinity(0), 100.0
    monkeypatch.setattr(one_core.time, "monotonic", lambda: now)
    with OneCore(Companions((other.pid,), in_turns=False)) as core:
        for _ in range(2):
            core.settle(0)
            assert os.sched_getaffinity(other.pid) == allowed, "first apart"
            now += one_core.TRIAL
            core.settle(10)
            assert len(os.sched_getaffinity(other.pid)) == 1, "then together"
            now += one_core.TRIAL
            core.settle(21 if faster else 19)
            chosen = os.sched_getaffinity(other.pid)
            assert (len(chosen) == 1) == (faster or len(allowed) == 1)
            now += 0.9 * one_core.TOGETHER
            core.settle(500)
            assert os.sched_getaffinity(other.pid) == chosen
            now += 0.2 * one_core.TOGETHER
    assert os.sched_getaffinity(0) == os.sched_getaffinity(other.pid) == allowed
