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


def test_both_are_kept_on_one_core_of_those_allowed_and_let_go(
    other: subprocess.Popen[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    allowed = os.sched_getaffinity(0)
    with OneCore(other.pid) as core:
        assert os.sched_getaffinity(0) == os.sched_getaffinity(other.pid) == allowed, "not before a first segment"
        core.settle()
        kept = os.sched_getaffinity(0)
        assert len(kept) == 1
        assert kept <= allowed
        assert os.sched_getaffinity(other.pid) == kept
        core.settle()
        assert os.sched_getaffinity(0) == kept
        monkeypatch.setattr(one_core.time, "monotonic", lambda: float("inf"))
        core.settle()
        assert os.sched_getaffinity(0) == os.sched_getaffinity(other.pid) == allowed, "so that they can be moved"
        core.settle()
        assert len(os.sched_getaffinity(other.pid)) == 1
    assert os.sched_getaffinity(0) == os.sched_getaffinity(other.pid) == allowed


def test_a_process_that_ends_keeps_nobody(other: subprocess.Popen[bytes]) -> None:
    allowed = os.sched_getaffinity(0)
    with OneCore(other.pid) as core:
        core.settle()
        assert len(os.sched_getaffinity(0)) == 1
        other.kill()
        other.wait()
    assert os.sched_getaffinity(0) == allowed
    with OneCore(other.pid) as core:  # it has ended
        core.settle()
        assert os.sched_getaffinity(0) == allowed
    with OneCore(None) as core:
        core.settle()
        assert os.sched_getaffinity(0) == allowed
