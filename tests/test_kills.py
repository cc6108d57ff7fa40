"""A few kills; ``python -m tests.kills`` is the long run."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.skipif(sys.platform != "linux", reason="looks at the processes that Linux shows")
@pytest.mark.parametrize("kind", ["run", "study", "hosted"])
def test_a_command_that_is_killed_leaves_whole_files_and_nothing_else(kind: str) -> None:
    """The next command works; no summary is one of a run that did not end; a study has the rows that it must have."""
    command = [sys.executable, "-m", "tests.kills", "--count", "4", "--only", kind]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.stdout.splitlines()[-1] == "4 kills, 0 findings", done.stdout + done.stderr
    assert done.returncode == 0


@pytest.mark.skipif(sys.platform != "linux", reason="looks at the processes that Linux shows")
@pytest.mark.parametrize("kind", ["run", "hosted", "study"])
def test_a_command_whose_processes_all_get_a_signal_is_interrupted(kind: str) -> None:
    """As service managers and batch systems send it: it is told as an interruption, not as a fault of a plant."""
    command = [sys.executable, "-m", "tests.kills", "--stop", "--count", "4", "--only", kind]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.stdout.splitlines()[-1] == "4 kills, 0 findings", done.stdout + done.stderr
    assert done.returncode == 0
