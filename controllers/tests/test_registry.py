"""Finding controllers: real entry points of made-up distributions on the path."""

from __future__ import annotations

import pytest
from formation_controllers import (
    INTERFACE_VERSION,
    ControllerError,
    IncompatibleInterface,
    UnknownController,
    installed,
    load,
    registry,
)
from formation_controllers.neural_adaptive_pid import NeuralAdaptivePid

MODULE = """
from dataclasses import dataclass
from formation_controllers import Gains, Signal
from formation_controllers.controller import Controller
from formation_controllers.neural_adaptive_pid import NeuralAdaptivePid
@dataclass(frozen=True)
class Bare(Gains):
    k: float = 1.0
class Fine(NeuralAdaptivePid):
    pass
class Older(NeuralAdaptivePid):
    interface = "0.3"
class Newer(NeuralAdaptivePid):
    interface = "1.9"
class Silent(NeuralAdaptivePid):
    interface = None
class Vague(Controller):
    def state_shapes(self): return {}
    def on_start(self, pose, leader, desired): pass
    def on_step(self, pose, leader, desired): pass
class NoInterface(Vague):
    pass
class NoSignals(Vague):
    interface, vehicles, gains_type = "1.0", ("car_like",), Gains
class NoGains(Vague):
    interface, vehicles, signals = "1.0", ("car_like",), ()
class NoVehicles(Vague):
    interface, gains_type, signals = "1.0", Gains, ()
class WrongVehicles(Fine):
    vehicles = "car_like"
class WrongGains(Fine):
    gains_type = dict
class BareGain(Fine):
    gains_type = Bare
class WrongSignals(Fine):
    signals = ("speed",)
class WrongNeeds(Fine):
    needs = ("mind",)
class TwiceASignal(Fine):
    signals = (Signal("speed", "m/s", "speed"),) * 2
class Negative(Fine):
    signals = (Signal("speed", "m/s", "speed", singular_at_zero="it stands", singular_below=-0.1),)
class Endless(Fine):
    signals = (Signal("speed", "m/s", "speed", singular_at_zero="it stands", singular_below=float("nan")),)
class Wordy(Fine):
    signals = (Signal("speed", "m/s", "speed", singular_at_zero="it stands", singular_below="0.1"),)
class Meaningless(Fine):
    signals = (Signal("speed", "m/s", "speed", singular_below=0.1),)
class Of10(Fine):
    interface = "1.0"
    signals = (Signal("speed", "m/s", "speed", (), "it stands"),)
class Unfinished(Controller):
    interface, vehicles, gains_type, signals = "1.0", ("car_like",), Gains, ()
nothing = 3
"""


@pytest.fixture
def distribution(tmp_path, monkeypatch):
    """Return a function that puts a distribution with controllers on the path."""

    def make(name, points, module="someones_controllers"):
        folder = tmp_path / name
        info = folder / f"{name}-2.5.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 2.5\n")
        lines = [f"{point} = {module}:{attribute}" for point, attribute in points.items()]
        (info / "entry_points.txt").write_text("\n".join([f"[{registry.GROUP}]", *lines]))
        (folder / "someones_controllers.py").write_text(MODULE)
        monkeypatch.syspath_prepend(folder)

    return make


def test_the_papers_controller_is_installed():
    found = installed()["neural-adaptive-pid"]
    assert found.package == "formation-controllers"
    assert load("neural-adaptive-pid") is NeuralAdaptivePid


def test_anyones_package_can_bring_a_controller(distribution):
    distribution("someones", {"someones-law": "Fine"})
    found = installed()["someones-law"]
    assert (found.name, found.package, found.version) == ("someones-law", "someones", "2.5")
    assert load("someones-law").__name__ == "Fine"


def test_an_unknown_controller_is_refused_with_the_nearest_and_the_known():
    with pytest.raises(UnknownController, match=r"'neural-pid'; did you mean 'neural-adaptive-pid'\? known: .*neural"):
        load("neural-pid")
    with pytest.raises(UnknownController, match=r"unknown controller 'zzz'; known: "):
        load("zzz")


SPOKEN = f"of the controller interface, and version {INTERFACE_VERSION} is spoken here"


@pytest.mark.parametrize(
    ("attribute", "fault"),
    [
        ("Older", f"speaks version 0.3 {SPOKEN}: install releases that agree in the first number"),
        ("Newer", f"speaks version 1.9 {SPOKEN}: install a newer formation-controllers"),
        ("Silent", f"states the interface None, which is not a version: expected one such as {INTERFACE_VERSION!r}"),
    ],
)
def test_another_version_of_the_interface_is_refused(distribution, attribute, fault):
    distribution("someones", {"someones-law": attribute})
    with pytest.raises(IncompatibleInterface) as caught:
        load("someones-law")
    assert str(caught.value) == f"controller 'someones-law' of someones 2.5 {fault}"


@pytest.mark.parametrize("version", ["1.0", "1.1"])
def test_an_older_minor_version_of_the_interface_is_spoken(distribution, monkeypatch, version):
    distribution("someones", {"someones-law": "Fine"})
    monkeypatch.setattr(load("someones-law"), "interface", version)
    assert load("someones-law").interface == version


@pytest.mark.parametrize("version", ["1.5", "2.0", "0.9", "1", "1.0.0", "one", "", None, 1.0])
def test_a_newer_version_another_major_one_and_what_is_none_are_refused(distribution, monkeypatch, version):
    distribution("someones", {"someones-law": "Fine"})
    monkeypatch.setattr(load("someones-law"), "interface", version)
    with pytest.raises(IncompatibleInterface):
        load("someones-law")


def test_signals_as_1_0_knew_them_tell_of_changes_of_sign_alone(distribution):
    distribution("someones", {"someones-law": "Of10"})
    (signal,) = load("someones-law").signals
    assert (signal.singular_at_zero, signal.singular_below) == ("it stands", 0)


def test_what_cannot_be_imported_or_is_no_controller_is_refused(distribution):
    distribution("someones", {"absent": "Absent", "number": "nothing"})
    with pytest.raises(ControllerError, match=r"controller 'absent' of someones 2.5 cannot be imported"):
        load("absent")
    with pytest.raises(ControllerError, match=r"controller 'number' of someones 2.5 is 3: expected a subclass"):
        load("number")


@pytest.mark.parametrize(
    ("attribute", "message"),
    [
        ("NoInterface", "states no interface: expected a version such as"),
        ("NoSignals", "has signals = None: expected a tuple of Signal"),
        ("NoGains", "has gains_type = None: expected a dataclass derived from Gains"),
        ("NoVehicles", "has vehicles = None: expected a tuple of kinds"),
        ("WrongVehicles", "has vehicles = 'car_like': expected a tuple"),
        ("WrongGains", "has gains_type = <class 'dict'>: expected a dataclass derived from Gains"),
        ("BareGain", r"has a gain 'k' that is not stated with gain\(...\)"),
        ("WrongSignals", r"has signals = \('speed',\): expected a tuple of Signal"),
        ("WrongNeeds", r"needs \('mind',\): expected a tuple of velocity"),
        ("TwiceASignal", "has two signals named 'speed'"),
        ("Negative", r"has a signal 'speed' with singular_below = -0\.1: expected a magnitude, 0 or more"),
        ("Endless", "has a signal 'speed' with singular_below = nan: expected a magnitude"),
        ("Wordy", r"has a signal 'speed' with singular_below = '0\.1': expected a magnitude"),
        ("Meaningless", "has a signal 'speed' with a singular_below but nothing in singular_at_zero"),
        ("Unfinished", "lacks on_start, on_step, state_shapes: a controller must implement them"),
    ],
)
def test_a_class_that_does_not_state_what_it_is_is_refused(distribution, attribute, message):
    distribution("someones", {"someones-law": attribute})
    with pytest.raises(ControllerError, match=rf"controller 'someones-law' of someones 2.5 {message}"):
        load("someones-law")


def test_a_module_that_is_not_there_is_refused(distribution):
    distribution("someones", {"lost": "Law"}, module="no_such_module_anywhere")
    with pytest.raises(ControllerError, match=r"controller 'lost' of someones 2.5 cannot be imported: No module"):
        load("lost")


def test_a_module_that_fails_while_it_is_imported_is_refused(distribution, tmp_path):
    distribution("someones", {"broken": "Law"}, module="someones_broken_module")
    (tmp_path / "someones" / "someones_broken_module.py").write_text("1 / 0")
    with pytest.raises(ControllerError, match=r"controller 'broken' .* cannot be imported: division by zero"):
        load("broken")


def test_two_packages_with_the_same_name_are_refused(distribution):
    distribution("someones", {"law": "Fine"})
    distribution("others", {"law": "Fine"})
    with pytest.raises(ControllerError, match=r"both .* and .* bring a controller named 'law': uninstall one"):
        installed()
