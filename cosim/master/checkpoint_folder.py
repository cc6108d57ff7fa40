"""The folder of a run's checkpoints, in which one command at a time writes."""

from __future__ import annotations

import re
from contextlib import suppress
from io import FileIO
from pathlib import Path

from cosim.closing import Closing
from cosim.errors import InputError, OutputError
from cosim.file_lock import lock
from cosim.master.checkpoint import Checkpoint
from cosim.master.checkpoint_file import PARTIAL

FOLDER = "checkpoints"
"""Its name in the folder of a run."""
_LOCK = "lock"
_NAME = re.compile(r"([0-9]{10,})\.checkpoint")


def name_of(tick: int) -> str:
    """Return the name of the checkpoint before a tick."""
    return f"{tick:010d}.checkpoint"


def ticks_in(folder: Path) -> list[int]:
    """Return the ticks of the checkpoints in a folder, in their order."""
    names = (path.name for path in folder.iterdir()) if folder.is_dir() else ()
    return sorted(int(match[1]) for name in names if (match := _NAME.fullmatch(name)))


def latest(folder: Path, tick: int | None = None) -> Checkpoint | None:
    """Return the last checkpoint in a folder, or the last one up to a tick; None if there is none.

    Raises
    ------
    InputError
        It is damaged; the message names an earlier one, if there is one.
    """
    ticks = [own for own in ticks_in(folder) if tick is None or own <= tick]
    if not ticks:
        return None
    try:
        return _at(folder, ticks[-1])
    except InputError as error:
        if len(ticks) == 1:
            raise
        step = _step(folder / name_of(ticks[-2]))
        hint = f"; the one before is at {ticks[-2] * step:.12g} s: --at '{ticks[-2] * step:.12g} s'" if step else ""
        raise InputError(f"{error.message}{hint}") from None


def readable(folder: Path) -> Checkpoint | None:
    """Return the last checkpoint in a folder that can be read; None if there is none."""
    for tick in reversed(ticks_in(folder)):
        with suppress(InputError):
            return _at(folder, tick)
    return None


def _at(folder: Path, tick: int) -> Checkpoint:
    """Return the checkpoint before a tick; InputError if it is damaged, or another one under that name."""
    found = Checkpoint(folder / name_of(tick))
    if found.state.tick != tick:
        raise InputError(f"the checkpoint {found.path} is damaged: it is one at {found.time:.12g} s")
    return found


def _step(path: Path) -> float:
    """Return the communication step of a checkpoint's run [s]; zero if it is damaged."""
    with suppress(InputError):
        return Checkpoint(path).scenario.step
    return 0.0


class HeldFolder(Closing):
    """A folder of checkpoints that no other command writes to, until it is closed.

    Parameters
    ----------
    path
        The folder, which is made if it does not exist, and removed in the end if it holds no checkpoint; so is the one
        that it is in, if that was made for it and holds nothing.

    Raises
    ------
    InputError
        Another command writes to it.
    OutputError
        It cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._made = not path.parent.exists()
        try:
            path.mkdir(parents=True, exist_ok=True)
            self._file = FileIO(path / _LOCK, "a")
        except OSError as error:
            raise OutputError(f"checkpoints cannot be written to {path}: {error.strerror}") from None
        try:
            lock(self._file, path, "wait until it ends")
        except BaseException:
            self._file.close()
            raise
        self._clear()

    def close(self) -> None:
        """Let other commands write to it."""
        self._clear()
        if not ticks_in(self.path):
            with suppress(OSError):
                (self.path / _LOCK).unlink()
                self.path.rmdir()
                if self._made:  # for a run that was refused before it began
                    self.path.parent.rmdir()
        self._file.close()

    def _clear(self) -> None:
        """Remove what a process has left that was killed while it wrote a checkpoint."""
        for path in self.path.glob(f".*.checkpoint{PARTIAL}"):
            with suppress(OSError):
                path.unlink()
