"""Python environments for tests, made in a moment: no network, nothing is copied."""

import sys
import venv
from collections.abc import Iterable
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
LIBRARIES = Path(np.__file__).parents[1]
CONTROLLERS = ROOT / "controllers"

FAULTY = '''"""A law that does what its gain says."""

import os
import sys
import time
from dataclasses import dataclass

import numpy as np
from formation_controllers import ControllerError, Signal
from formation_controllers.compiled import compiled
from formation_controllers.controller import Controller
from formation_controllers.gains import Gains, gain
from formation_controllers.interface import CompiledTick


@dataclass(frozen=True)
class FaultyGains(Gains):
    fault: float = gain(0.0, "f", "1", "what it does at tick 10", at_least=0)


class Faulty(Controller[FaultyGains]):
    interface = "1.1"
    vehicles = ("car_like",)
    gains_type = FaultyGains
    signals = (Signal("count", "1", "ticks so far"), Signal("pair", "m, rad", "two numbers", ("range", "bearing")))

    def state_shapes(self):
        return {"count": ()}

    def on_start(self, pose, leader, desired):
        if self.gains.fault == 20:
            os._exit(4)
        if self.gains.fault == 21:
            print("at work", file=sys.stderr)
            sum(range(10**12))  # no other thread of Python comes to its turn

    def on_step(self, pose, leader, desired):
        self._telemetry["count"] = self._state["count"]
        self._telemetry["pair"] = pose[:, :2]
        self._state["count"] += 1
        if self._state["count"][0] == 11:
            fault(self.gains.fault)
        return np.stack([8.0 + 0.01 * pose[:, 0], -0.1 * pose[:, 3]], axis=1) * (np.nan if torn(self) else 1.0)


class Compiled(Faulty):
    def on_step(self, pose, leader, desired):
        tick, own = self.compiled_tick()
        command = np.zeros((len(pose), 2))
        tick((pose,), own, command)
        return command

    def compiled_tick(self):
        return CompiledTick(tick, (self._state, self._telemetry, self.gains.fault))


@compiled
def tick(inputs, own, commands):
    state, telemetry, number = own
    for i in range(len(state)):
        telemetry[i]["count"] = state[i]["count"]
        telemetry[i]["pair"][:] = inputs[0][i, :2]
        state[i]["count"] += 1
        if state[i]["count"] == 11 and number == 9:
            raise ValueError("a number is wrong")
        commands[i, 0], commands[i, 1] = 8.0 + 0.01 * inputs[0][i, 0], -0.1 * inputs[0][i, 3]


def torn(law):
    return law.gains.fault == 8 and law._state["count"][0] == 11


def fault(number):
    if number == 1:
        time.sleep(1000)
    if number == 2:
        os.kill(os.getpid(), 11)
    if number == 3:
        os._exit(7)
    if number == 4:
        sys.exit("enough")
    if number == 5:
        for line in range(1_000_000):
            print("line", line)
    if number == 6:
        raise ControllerError("too near", robot=1)
    if number == 7:
        for descriptor in range(3, 30):
            try:
                os.write(descriptor, b"nonsense" * 10)
            except OSError:
                pass
    if number == 9:
        1 // 0
    if number == 10:
        time.sleep(0.7)
    if number == 13:
        os.closerange(3, 30)
        time.sleep(1000)
    if number in (11, 12) and not os.path.exists(f"{__file__}.killed"):
        if number == 11:
            open(f"{__file__}.killed", "x").close()
        os.kill(os.getpid(), 9)
'''


def environment(folder: Path, *found: Path) -> Path:
    """Make an environment that finds modules in some folders and, after them, the libraries of this one."""
    venv.create(folder, with_pip=False, symlinks=sys.platform != "win32")
    (packages_of(folder) / "found.pth").write_text("".join(f"{path}\n" for path in (*found, LIBRARIES)))
    return folder


def packages_of(folder: Path) -> Path:
    """Return where an environment has its packages."""
    (packages,) = folder.glob("[Ll]ib/**/site-packages")
    return packages


def distribution(packages: Path, name: str, version: str, laws: Iterable[str], text: str = "") -> None:
    """Install a distribution with controllers, each ``NAME = MODULE:CLASS``, and a module of its name with a text."""
    about = packages / f"{name.replace('-', '_')}-{version}.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    (about / "entry_points.txt").write_text("\n".join(["[formation.controllers]", *laws, ""]))
    if text:
        (packages / f"{name.replace('-', '_')}.py").write_text(text)
