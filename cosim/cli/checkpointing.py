"""The options ``--checkpoint`` and ``--until``, and what a run tells of its checkpoints."""

from __future__ import annotations

import argparse
import shlex
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

from cosim.cli.console import out, safe, say, warn
from cosim.errors import Failure, InputError
from cosim.master.branch import branched
from cosim.master.checkpoint import Checkpoint, Start
from cosim.master.checkpoint_folder import FOLDER, HeldFolder
from cosim.master.checkpoints import Checkpoints
from cosim.master.origin import Origin
from cosim.master.savable import check_savable
from cosim.master.setup import Setup
from cosim.quantity import quantity
from cosim.scenario.scenario import Scenario

_EVERY = "every="


def tick_of(option: str, text: str, scenario: Scenario, told: str = "", least: int = 1) -> int:
    """Return the tick of a time that an option states.

    Parameters
    ----------
    option, text
        The option and the time.
    scenario
        Of the run.
    told
        What the option states, where that is more than the time.
    least
        The first tick that is possible.

    Raises
    ------
    InputError
        It is no time, no tick is there, or it is not within the run.
    """
    told = told or text
    try:
        time = quantity(text, "s")
    except ValueError as error:
        raise InputError(f"{option}: {error}") from None
    if problem := scenario.clock.off_tick(time):
        raise InputError(f"{option} {told}: {problem}")
    tick = round(time / scenario.step)
    if not least <= tick <= scenario.ticks:
        begin = "after" if least else "from"
        raise InputError(
            f"{option} {told}: expected a time {begin} 0 s and not after the end at {scenario.horizon:.12g} s"
        )
    return tick


def every_of(texts: str | None, scenario: Scenario) -> int | None:
    """Return how many ticks lie between two checkpoints, as ``--checkpoint`` asks for; None without it."""
    if texts is None:
        return None
    if not texts.startswith(_EVERY):
        raise InputError(f"--checkpoint {texts}: expected every=TIME, such as every=10s")
    time = texts.removeprefix(_EVERY)
    try:
        long = quantity(time, "s") > scenario.horizon
    except ValueError as error:
        raise InputError(f"--checkpoint {texts}: {error}") from None
    return scenario.ticks if long else tick_of("--checkpoint", time, scenario, texts)


@dataclass
class Course:
    """From where to where a run goes, and the checkpoints on its way.

    Attributes
    ----------
    place : Path
        The folder of the run.
    every, until : int or None
        Ticks between two checkpoints; the tick at which the run is left.
    checkpoint : Checkpoint or None
        From where it goes on.
    branched : Path or None
        The folder of the run from which it branches off: it goes on with another scenario.
    noted : bool
        Whether the result tells of that.
    held : HeldFolder or None
        The folder of its checkpoints, where the caller holds it.
    """

    place: Path
    every: int | None = None
    until: int | None = None
    checkpoint: Checkpoint | None = None
    branched: Path | None = None
    noted: bool = True
    held: HeldFolder | None = None
    checkpoints: Checkpoints | None = None

    @classmethod
    def of(cls, options: argparse.Namespace, scenario: Scenario) -> Course:
        """Return the course of a run from its start, as options ask for."""
        until = None if options.until is None else tick_of("--until", options.until, scenario)
        return cls(options.out / scenario.name, every_of(options.checkpoint, scenario), until)

    @property
    def is_kept(self) -> bool:
        """Whether checkpoints are written; the first one of a branch always is."""
        return self.every is not None or self.until is not None or self.branched is not None

    @property
    def start(self) -> Start | None:
        """From where the run goes on."""
        if self.checkpoint is None:
            return None
        start = self.checkpoint.start(None if self.branched is None else str(self.branched))
        return start if self.noted else replace(start, parts=self.checkpoint.origin.parts)

    def begin(self, scenario: Scenario, setup: Setup, ending: ExitStack) -> tuple[Setup, Start | None]:
        """Check that the run can take this course, and make the folder of its checkpoints.

        Raises
        ------
        InputError, OutputError
            It cannot.
        """
        start = self.start
        if self.checkpoint is not None and start is not None:
            self.checkpoint.origin.check_parts(setup, self.checkpoint.path)
            setup = branched(setup, scenario, start)
        if self.is_kept:
            check_savable(setup)
            if self.held is None:
                self.held = HeldFolder((self.place / FOLDER).absolute())
                ending.callback(self.held.close)
            origin = Origin.of(scenario, setup, () if start is None else start.parts)
            made = self.checkpoints = Checkpoints(self.held.path, origin, self.every, self.until)
            if self.checkpoint is not None and self.checkpoint.path.parent.absolute() == self.held.path:
                made.first, made.before = self.checkpoint.state.tick, self.checkpoint.path.name
        return setup, start

    def tell(self, failure: Failure | None, scenario: Scenario) -> None:
        """Say how a run goes on that has not reached its end, and what is wrong with its checkpoints."""
        made = self.checkpoints
        if made is None:
            return
        if made.fault:
            warn(f"the last checkpoint was not written: {made.fault}")
        if failure is not None and failure.left:
            left = f"left at {failure.time:.12g} s of {scenario.horizon:.12g} s, as asked; nothing is judged yet"
            say(out(), left)
        if failure is not None and not failure.robot and (at := made.written or made.first):
            command = shlex.join(["formation", "resume", str(self.place)])
            out().print(safe(f"{command} goes on from {at * scenario.step:.12g} s"), soft_wrap=True)
