"""Kills runs at random ticks and resumes them: ``python -m tests.checkpoint_kills --ticks 20 --seed 1`` from the root.

Each of some scenarios is run in one piece, and again for each tick: with a checkpoint there, killed (SIGKILL) soon
after it is written, and resumed by another process. The files must be those of the run in one piece, byte for byte, but
for the note of the resumption. Exit status 1: they are not.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from cosim.cli import main
from cosim.cli.earlier_results import RESULT
from cosim.master.checkpoint_folder import FOLDER, ticks_in
from cosim.results.files import load, save
from cosim.scenario.grammar import NAMESPACE
from cosim.scenario.reader import read_scenario
from tests.stub.stub import make_fmu

ROOT = Path(__file__).parent.parent
SCENARIOS = ("clmr_line", "sensor_dropout", "one_sample_delay", "heavy_payload", "mixed_team")
"""Among them noise, dropouts, delays, a period of control, events, changes of parameters, and several laws."""
_PATIENCE = 120.0
"""How long a checkpoint may take to appear [s]."""


def foreign(folder: Path, isolate: str = "") -> Path:
    """Write a scenario of robots whose FMU is a file, with events, noise and a delay."""
    fmu = make_fmu(folder, name="car", save=True, end_stop=0.2, time_event=True)
    path = folder / f"foreign{'_isolated' if isolate else ''}.xml"
    path.write_text(
        f"""<scenario xmlns="{NAMESPACE}" name="{path.stem}"><title>Cars of a foreign FMU</title>
  <simulation horizon="20 s" step="20 ms" seed="3"/>
  <plant id="car" fmu="{fmu}"{isolate}/>
  <controller id="pid" name="neural-adaptive-pid" package="formation-controllers" version="~=0.1.0"/>
  <sensor><noise x="2 mm" psi="0.1 deg"/><delay time="40 ms"/></sensor>
  <leader plant="car"><pose x="0 m" y="0 m" psi="0 deg" gamma="0 deg"/><torque tau_drive="1 N.m" tau_steer="0 N.m"/>
  </leader>
  <follower id="one" plant="car" controller="pid"><pose x="-3 m" y="1 m" psi="0 deg" gamma="0 deg"/>
    <desired range="3 m" bearing="160 deg"/></follower>
  <event at="0.5 s" robots="one"><parameter name="when" value="9 s"/></event>
</scenario>""",
        encoding="utf-8",
    )
    return path


class Bench:
    """A scenario that is run in one piece, and in parts.

    Parameters
    ----------
    path
        Its file.
    folder
        Where the files go.
    options
        Options of all runs.
    """

    def __init__(self, path: Path, folder: Path, options: Sequence[str] = ()) -> None:
        folder.mkdir(exist_ok=True)
        self.path, self.folder, self.options = path, folder, (*options, "--no-figure", "--no-report")
        self.scenario = read_scenario(path)
        self.whole = self.run("whole")

    def run(self, name: str) -> Path:
        """Run it in one piece; return the folder of the run."""
        status, _ = self.call(["run", str(self.path), "--out", str(self.folder / name), *self.options])
        assert status in (0, 1), f"{self.path.name} in one piece: status {status}"
        return self.folder / name / self.scenario.name

    def killed_at(self, tick: int, after: float) -> Iterator[str]:
        """Kill a run some time [s] after its checkpoint at a tick, resume it, and return what is wrong.

        A checkpoint is left out in the first second of a run, and for longer where it takes a while, as on a busy
        machine. The run is then killed after one at a multiple of the tick; if there is none, or the run ends before it
        is killed, it is repeated more slowly.
        """
        place = self.folder / "killed" / self.scenario.name
        time_of = tick * self.scenario.step
        command = ["run", str(self.path), "--out", str(place.parent), *self.options]

        def written() -> bool:
            if not any(ticks_in(place / FOLDER)):  # besides that of the start
                return False
            time.sleep(after)
            return True

        for seconds in (1.2, 6.0, 30.0):
            shutil.rmtree(place, ignore_errors=True)
            moment = ["--checkpoint", f"every={time_of!r} s", "--pace", f"{time_of / seconds}"]
            status, said = self.call([*command, *moment], written)
            if status == -signal.SIGKILL and any(ticks_in(place / FOLDER)) and not (place / RESULT).exists():
                break
        else:
            yield f"it was not killed after a checkpoint: status {status}, {said}"
            return
        status, said = self.call(["resume", str(place), "--no-figure", "--no-report"])
        if status not in (0, 1):
            yield f"it was not resumed: status {status}, {said}"
            return
        yield from differences(self.whole, place, self.folder)

    def call(self, command: list[str], kill: Callable[[], bool] | None = None) -> tuple[int, str]:
        """Give a command in a process forked from this one, killed once a condition holds; return status and output.

        It is killed, too, if the condition does not hold within `_PATIENCE`.
        """
        log = self.folder / "log"
        if (pid := os.fork()) == 0:
            status = 70
            try:
                os.setsid()
                with log.open("wb") as file:
                    os.dup2(file.fileno(), 1)
                    os.dup2(file.fileno(), 2)
                status = main(command)
                sys.stdout.flush()
                sys.stderr.flush()
            except SystemExit as error:
                status = int(error.code or 0)
            finally:
                os._exit(status)
        give_up = time.monotonic() + _PATIENCE
        while kill is not None and time.monotonic() < give_up:
            if kill() or os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT):
                break
            time.sleep(0.001)
        if kill is not None:
            os.kill(pid, signal.SIGKILL)  # one that has ended stays as it is
        _, status = os.waitpid(pid, 0)
        return os.waitstatus_to_exitcode(status), log.read_text(errors="replace")[-500:]


def differences(whole: Path, parts: Path, folder: Path) -> Iterator[str]:
    """Return how the files of a run in parts differ from those of a run in one piece, the note of that apart."""
    results = [load(run / "result.nc") for run in (whole, parts)]
    if results[0].attrs.pop("parts", None) is not None or results[1].attrs.pop("parts", None) is None:
        yield "the note of the resumption is missing, or where it should not be"
    bare = [folder / name for name in ("one.nc", "other.nc")]
    for result, path in zip(results, bare, strict=True):
        save(result, path)
    if bare[0].read_bytes() != bare[1].read_bytes():
        names = [name for name in results[0].variables if not results[0][name].identical(results[1][name])]
        told = [name for name in results[0].attrs if results[0].attrs[name] != results[1].attrs.get(name)]
        yield f"result.nc differs: {names} {told}"
    summaries = [json.loads((run / "summary.json").read_text()) for run in (whole, parts)]
    for summary in summaries:
        summary.pop("parts")
    if summaries[0] != summaries[1]:
        yield "summary.json differs"


def command(arguments: Sequence[str] | None = None) -> int:
    """Kill and resume; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--ticks", type=int, default=20, help="ticks of each scenario (20)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="the scenarios whose name has this")
    options = parser.parse_args(arguments)
    chance, findings = random.Random(options.seed), 0
    with tempfile.TemporaryDirectory(prefix="formation-kills-") as name:
        folder = Path(name)
        paths = [ROOT / "scenarios" / f"{one}.xml" for one in SCENARIOS]
        paths += [foreign(folder), foreign(folder, ' isolate="process"')]
        for path in paths:
            if options.only not in path.stem:
                continue
            bench = Bench(path, folder / path.stem)
            for _ in range(options.ticks):
                tick, after = chance.randrange(1, bench.scenario.ticks), chance.choice((0.0, chance.random() * 0.05))
                for finding in bench.killed_at(tick, after):
                    findings += 1
                    print(f"{path.stem}, tick {tick}: {finding}", flush=True)
            print(f"{path.stem}: killed and resumed at {options.ticks} ticks", flush=True)
    print(f"{findings} findings")
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(command())
