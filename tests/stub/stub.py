"""FMUs for tests that behave well, unusually or badly, made of C written for that: see stub_model.h.

The token (guid) in a model description selects the behaviour of the binary: one binary for each version of FMI.
"""

import functools
import importlib.util
import math
import re
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from xml.sax.saxutils import quoteattr

from plants.factory.compile import compile_library, find_compiler
from plants.factory.platforms import Platform, host

HERE = Path(__file__).parent
VENDOR = "libvendor.so.3"

BEHAVIOURS = {
    "good": "does all right",
    "nothing": "every call returns OK, a step does nothing, the outputs stay",
    "segfault": "writes to an address that is not its own",
    "exit": "calls exit(7)",
    "exit_0": "calls exit(0)",
    "abort": "calls abort()",
    "overflow": "calls itself without end, until the stack is full",
    "thread_crash": "starts a thread, which crashes a little after the next call, while that one waits",
    "garbage": "writes bytes without sense into all pipes that its process has open, once",
    "garbage_endless": "likewise, without end",
    "close_pipes": "closes all pipes that its process has open, and sleeps for ever",
    "hang": "sleeps for ever",
    "hang_stubborn": "sleeps for ever, and ignores SIGTERM and SIGINT",
    "spin": "computes for ever",
    "daemon": "leaves a process in a session of its own, which holds all that is open and sleeps for ever",
    "daemon_exit": "likewise, and then ends its own process with status 7",
    "daemon_hang": "likewise, and then sleeps for ever",
    "slow": "sleeps for `seconds`",
    "warning": "returns Warning, having logged why",
    "discard": "returns Discard, having logged why",
    "error": "returns Error, having logged why",
    "silent": "returns Error, and does not say why",
    "fatal": "returns Fatal, having logged why",
    "fatal_strict": "returns Fatal, and aborts in any later call",
    "pending": "returns Pending, which FMI 2 alone has, though it is not asynchronous",
    "illegal": "returns the status 17, which does not exist",
    "minus": "returns the status -1, which does not exist, and makes no step",
    "terminate": "asks for the end of the simulation",
    "log_million": "logs `lines` lines, once",
    "log_odd": "logs percent signs, bytes that are not UTF-8 and control characters, once",
    "log_percent": "logs a text with a bare percent sign; in FMI 1 and 2, where it is a format, that is a fault",
    "log_long": "logs one line of a million characters, once",
    "nan": "has x = NaN; `place` does not matter",
    "infinity": "has v = infinity; `place` does not matter",
    "print": "prints a line to stdout",
    "close_descriptors": "closes the file descriptors 0, 1 and 2",
    "rounding": "lets floating-point numbers be rounded upward",
    "trap": "lets invalid floating-point operations raise SIGFPE (glibc)",
    "chdir": "changes the working directory to /",
    "signals": "ignores SIGINT",
    "stale": "keeps its speed and its wheelbase when it is reset",
    "thread": "starts a thread that never ends, and aborts if it is unloaded or torn down under it",
}
"""What a stub can be made to do at its `place`. Before what ends or hangs the process it logs a line."""

PLACES = {
    "load": "when its library is loaded; only what ends or hangs the process",
    "instantiate": "where an error gives no instance",
    "initialization": "on leaving the initialization mode",
    "set": "on setting an input, from the time `when`",
    "get": "on getting an output that is a state, from the time `when`",
    "step": "in a step (Model Exchange: on getting derivatives) that begins at the time `when` or later",
    "change": "on setting the parameter `when` in the course of a run",
    "terminate": "on terminating",
    "reset": "on being reset",
    "free": "on freeing the instance",
}
"""In which function a stub does what it is made to do."""

_PLACE = dict.fromkeys(("rounding", "trap", "chdir", "signals", "thread"), "instantiate") | {"stale": "reset"}
_ROLES = ("x", "y", "psi", "gamma", "v", "omega")

# Unit of each state, of the torques, of the wheelbase, of the time.
_UNITS: dict[str, tuple[str, ...]] = {
    "si": ("m", "m", "rad", "rad", "m/s", "rad/s", "N.m", "m", "s"),
    "deg": ("m", "m", "deg", "deg", "km/h", "deg/s", "N.m", "m", "s"),
    "names": (
        "metre",
        "metre",
        "radian",
        "radian",
        "metre per second",
        "radian per second",
        "newton metre",
        "metre",
        "second",
    ),
    "none": ("",) * 9,
    "odd": ("furlong", "furlong", "gon", "gon", "km/h", "gon/s", "N.m", "furlong", "s"),
}
_DEGREE = repr(3.141592653589793 / 180)
_GON = repr(3.141592653589793 / 200)
_BASE = {
    "m": 'm="1"',
    "rad": 'rad="1"',
    "m/s": 'm="1" s="-1"',
    "rad/s": 'rad="1" s="-1"',
    "m/s2": 'm="1" s="-2"',
    "rad/s2": 'rad="1" s="-2"',
    "N.m": 'kg="1" m="2" s="-2"',
    "s": 's="1"',
    "N": 'kg="1" m="1" s="-2"',
    "W": 'kg="1" m="2" s="-3"',
    "deg": f'rad="1" factor="{_DEGREE}"',
    "deg/s": f'rad="1" s="-1" factor="{_DEGREE}"',
    "deg/s2": f'rad="1" s="-2" factor="{_DEGREE}"',
    "km/h": f'm="1" s="-1" factor="{1 / 3.6!r}"',
    "km/h/s": f'm="1" s="-2" factor="{1 / 3.6!r}"',
    "furlong": 'm="1" factor="201.168"',
    "furlong/s": 'm="1" s="-1" factor="201.168"',
    "gon": f'rad="1" factor="{_GON}"',
    "gon/s": f'rad="1" s="-1" factor="{_GON}"',
    "gon/s2": f'rad="1" s="-2" factor="{_GON}"',
    "metre": 'm="1"',
    "radian": 'rad="1"',
    "metre per second": 'm="1" s="-1"',
    "radian per second": 'rad="1" s="-1"',
    "metre per second squared": 'm="1" s="-2"',
    "radian per second squared": 'rad="1" s="-2"',
    "newton metre": 'kg="1" m="2" s="-2"',
    "second": 's="1"',
    "watt": 'kg="1" m="2" s="-3"',
}
_RATE = {
    "m": "m/s", "rad": "rad/s", "m/s": "m/s2", "rad/s": "rad/s2", "deg": "deg/s", "deg/s": "deg/s2", "km/h": "km/h/s",
    "furlong": "furlong/s", "gon": "gon/s", "gon/s": "gon/s2",
    "metre": "metre per second", "radian": "radian per second", "metre per second": "metre per second squared",
    "radian per second": "radian per second squared", "": "",
}  # fmt: skip


_COMPASS = {
    "psi": "Heading, clockwise from north",
    "gamma": "Steering angle, positive to the right",
    "omega": "Steering rate, positive to the right",
    "tau_steer": "Steering torque, positive to the right",
}


@dataclass(frozen=True)
class Variable:
    """A variable of a stub as in its model description, in the words of FMI 2 and 3."""

    name: str
    reference: int
    causality: str
    variability: str = "continuous"
    initial: str = ""
    unit: str = ""
    start: str = ""
    derivative: int | None = None
    size: int | None = None
    kind: str = "real"
    dependencies: tuple[int, ...] | None = None
    description: str = ""


@dataclass(frozen=True)
class Options:
    """Description and behaviour of a stub: see `make_fmu`."""

    fmi: str = "2.0"
    interface: str = "co_simulation"
    behaviour: str = "good"
    name: str = "stub"
    place: str = ""
    when: float = 1.0
    lines: int = 1_000_000
    seconds: float = 0.1
    once: bool = False
    says_once: bool = True
    variable_step: bool = True
    fixed_step: float | None = None
    save: bool = False
    event_mode: bool = False
    early_return: str = ""
    intermediate_update: bool = False
    arrays: bool = False
    end_stop: float | None = None
    time_event: bool = False
    step_event: bool = False
    jumps: bool = False
    feedthrough: bool = False
    units: str = "si"
    compass: bool = False
    initial: str = "exact"
    start_torque: bool = False
    late: str = ""
    tolerance: str = ""
    says_tolerance: bool = False
    velocities: bool = True
    drive: bool = True
    discrete: bool = False
    types: str = ""
    fillers: int = 0
    names: Mapping[str, str] | None = None
    aliases: Mapping[str, str] | None = None
    structured: bool = False
    execution_tool: bool = False
    macros: tuple[str, ...] = ()
    vendor: float | None = None
    mass: float | None = None

    def __post_init__(self) -> None:
        three = self.fmi == "3.0"
        wrong = (
            self.fmi not in ("1.0", "2.0", "3.0")
            or self.interface not in ("co_simulation", "model_exchange", "both")
            or (self.fmi == "1.0" and self.interface == "both")
            or self.behaviour not in BEHAVIOURS
            or self.place not in ("", *PLACES)
            or self.early_return not in ("", "allowed", "always")
            or self.units not in _UNITS
            or self.initial not in ("exact", "parameters")
            or self.types not in ("", "single", "whole")
            or (self.types == "single" and not three)
            or (not three and (self.event_mode or self.early_return or self.intermediate_update or self.arrays))
            or (self.fixed_step is not None and bool(self.early_return or self.intermediate_update))
        )
        if wrong:
            raise ValueError(f"no stub can be made of {self}")

    @property
    def model_exchange(self) -> bool:
        return self.interface != "co_simulation"

    @property
    def completed_steps(self) -> bool:
        return self.step_event or self.behaviour == "terminate"

    @property
    def token(self) -> str:
        """The token that selects the behaviour of the binary."""
        said = {
            "behaviour": self.behaviour,
            "place": self.place or _PLACE.get(self.behaviour, "step"),
            "when": repr(float(self.when)),
            "units": self.units,
            "compass": self.compass,
            "resources": self.mass is not None,
            "lines": self.lines,
            "seconds": self.seconds,
            "end_stop": self.end_stop,
            "fixed_step": self.fixed_step,
            "once": self.once,
            "time_event": self.time_event or self.event_mode,
            "step_event": self.step_event,
            "jumps": self.jumps,
            "start_parameters": self.initial == "parameters",
            "start_torque": self.start_torque,
            "late": ("", "zero", "nan", "error", "step").index(self.late),
            "says_tolerance": self.says_tolerance,
            "event_mode": self.event_mode,
            "early_return": bool(self.early_return),
            "early_always": self.early_return == "always",
            "intermediate_update": self.intermediate_update,
            "save": self.save,
            "per_whole": 1000 if self.types == "whole" else None,
        }
        words = (
            f"{key}={int(value) if isinstance(value, bool) else value}"
            for key, value in said.items()
            if value is not None
        )
        return "formation-stub " + " ".join(words)


def make_fmu(where: Path, **options: object) -> Path:
    """Write the FMU `where`/`name`.fmu and return its path.

    Parameters
    ----------
    fmi : {"2.0", "3.0", "1.0"}
        Version; 1.0 has one interface.
    interface : {"co_simulation", "model_exchange", "both"}
    behaviour, place : str
        What it does, and where: BEHAVIOURS and PLACES. The place is "step" by default, or "instantiate" where the
        behaviour changes something for the whole process.
    name : str
        Of the file and the model.
    when : float
        Time [s] from which it misbehaves in steps, in set and in get, and of the time event. It is a parameter too.
    lines, seconds
        For log_million and slow.
    once : bool
        canBeInstantiatedOnlyOncePerProcess; a second instance is refused, even from a copy of the library.
    says_once : bool
        Whether the model description says so.
    variable_step : bool
        canHandleVariableCommunicationStepSize.
    fixed_step : float
        Internal step [s]; a communication step must be a multiple. Announced in FMI 3, which has an attribute for it.
    save : bool
        The state can be saved, restored and serialized.
    event_mode, intermediate_update : bool
        hasEventMode, with a time event; providesIntermediateUpdate, at half of a step. FMI 3.
    early_return : {"", "allowed", "always"}
        mightReturnEarlyFromDoStep: at an event and at half of every other step, if allowed, or even if not. FMI 3.
    arrays : bool
        ``pose`` of 4 and ``torque`` of 2 instead of scalars. FMI 3.
    end_stop : float
        Largest steering angle [rad]; in Model Exchange with two event indicators.
    time_event : bool
        At the time `when` it brakes to standstill.
    step_event : bool
        The heading is brought back to at most half a turn; in Model Exchange by events after integrator steps.
    jumps : bool
        The torques are discrete: in Model Exchange they are set in Event Mode alone. FMI 2 and 3.
    feedthrough : bool
        The output ``power`` = tau_drive v.
    units : {"si", "deg", "names", "none", "odd"}
        "deg" has deg, deg/s and km/h; "names" has words, with their definition in base units; "odd" has furlong, gon,
        gon/s and km/h.
    compass : bool
        The heading is clockwise from north, the steering with its torque positive to the right.
    initial : {"exact", "parameters"}
        The initial pose: start values of the outputs, or parameters x0, y0, psi0 and gamma0.
    start_torque : bool
        An initial equation uses an input: at the start v = tau_drive / 10.
    late : {"", "zero", "nan", "error", "step"}
        What the outputs are before the first step of Co-Simulation instead of what they should be; "step": those of one
        step before, always.
    tolerance : str
        That of the default experiment.
    says_tolerance : bool
        It logs the tolerance that it gets. FMI 2 and 3.
    velocities, drive : bool
        Whether v and omega are outputs (else they are local, named s5 and s6); whether there is the enumeration.
    discrete : bool
        Further inputs: ``enable`` (true or false), ``gear`` (whole), ``direction`` (an enumeration), ``note`` (a text);
        and ``push``, a force.
    types : {"", "single", "whole"}
        "single" has Float32 in place of Float64 for inputs, outputs and the wheelbase; "whole" has whole numbers,
        without units: of mm, mrad, mm/s, mrad/s, mN.m.
    fillers : int
        Number of further parameters, which do nothing.
    names : dict
        Other names of variables.
    aliases : dict
        Variables by further names that they have.
    structured : bool
        Names follow the structured convention; those of fillers have several parts.
    execution_tool : bool
        needsExecutionTool.
    macros : tuple of str
        C macros; WITHOUT_DO_STEP leaves the function out.
    vendor : float
        Mass [kg], 10 kg otherwise, that it has from a library of its own, `VENDOR` beside its binary. Linux.
    mass : float
        Mass [kg] that it reads from a file among its resources. Not Model Exchange of FMI 1.
    """
    chosen = Options(**options)  # type: ignore[arg-type]
    content = {
        "modelDescription.xml": description(chosen).encode(),
        binary_path(chosen): binary(
            chosen.fmi, chosen.name, (*chosen.macros, *["VENDOR"][: chosen.vendor is not None])
        ),
    }
    if chosen.vendor is not None:
        content[str(Path(binary_path(chosen)).with_name(VENDOR))] = vendor_library(chosen.vendor)
    if chosen.place == "load":
        content["resources/at_load.txt"] = chosen.behaviour.encode()
    if chosen.mass is not None:
        content["resources/mass.txt"] = f"{chosen.mass!r}\n".encode()
    return write(where / f"{chosen.name}.fmu", content)


def write(path: Path, content: Mapping[str, bytes]) -> Path:
    """Write a zip archive."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, data in content.items():
            archive.writestr(name, data)
    return path


def binary_path(options: Options) -> str:
    """Return where in the FMU its binary for this machine is."""
    return f"binaries/{folder(host(), options.fmi)}/{options.name}{host().suffix}"


def folder(platform: Platform, fmi: str) -> str:
    """Return the folder of a platform's binaries; FMI 1 has that of FMI 2."""
    return platform.folder("3.0" if fmi == "3.0" else "2.0")


def binary(fmi: str, name: str, macros: tuple[str, ...] = ()) -> bytes:
    """Return the shared library of all stubs of a version of FMI; in FMI 1 the name is part of it."""
    return _compile(fmi[0], name if fmi == "1.0" else "stub", macros)


@functools.cache
def _compile(major: str, name: str, macros: tuple[str, ...]) -> bytes:
    spec = importlib.util.find_spec("fmpy")
    assert spec is not None
    assert spec.origin is not None
    headers = Path(spec.origin).parent / "c-code"
    flags = ("-O1", "-pthread", f"-I{headers}", f"-DMODEL={name}", *(f"-D{macro}" for macro in macros))
    with tempfile.TemporaryDirectory() as scratch:
        for source in HERE.glob("*.[ch]"):
            (Path(scratch) / source.name).write_bytes(source.read_bytes())
        if "VENDOR" in macros:
            (Path(scratch) / VENDOR).write_bytes(vendor_library(10.0))
            flags += (f"-L{scratch}", "-Wl,--no-as-needed", f"-l:{VENDOR}", "-Wl,-rpath,$ORIGIN")
        return compile_library(find_compiler(), host(), Path(scratch), [f"fmi{major}.c"], name, flags)


@functools.cache
def vendor_library(mass: float) -> bytes:
    """Return a library that returns the mass of a stub; all libraries have one name."""
    with tempfile.TemporaryDirectory() as scratch:
        (Path(scratch) / "vendor.c").write_text(
            'double vendor_mass(void);\n__attribute__((visibility("default"))) '
            f"double vendor_mass(void) {{ return {mass!r}; }}\n"
        )
        flags = (f"-Wl,-soname,{VENDOR}",)
        return compile_library(find_compiler(), host(), Path(scratch), ["vendor.c"], "libvendor", flags)


# The model description ------------------------------------------------------------------------------------------


def variables(options: Options) -> list[Variable]:
    """Return the variables of a stub."""
    names = options.names or {}
    found = (_typed(options, variable) for variable in _variables(options))
    described = _COMPASS if options.compass else {}
    return [
        replace(variable, name=names.get(variable.name, variable.name), description=described.get(variable.name, ""))
        for variable in found
    ]


def _typed(options: Options, variable: Variable) -> Variable:
    """Return a variable with the type that the options ask for; states of Model Exchange are real."""
    exchanged = variable.causality == "input" or variable.name == "a" or variable.causality == "output"
    if not exchanged or variable.kind != "real" or (variable.causality == "output" and options.model_exchange):
        return variable
    if options.types == "single":
        return replace(variable, kind="single")
    if options.types != "whole":
        return variable
    start = variable.start and str(round(1000 * float(variable.start)))
    steady = variable.variability if variable.causality == "parameter" else "discrete"
    return replace(variable, kind="integer", unit="", start=start, variability=steady)


def _variables(options: Options) -> Iterator[Variable]:
    units = _UNITS[options.units]
    *state_units, torque, length, second = units
    exact = options.initial == "exact"
    held = "discrete" if options.jumps else "continuous"
    calculated = {"initial": "calculated"}
    for i, (name, unit) in enumerate(zip(_ROLES, state_units, strict=True)):
        if options.arrays and i < 4:
            continue
        shown = i < 4 or options.velocities
        begin = {"initial": "exact", "start": _zero(options, name, unit)} if exact or i >= 4 else calculated
        if options.start_torque and name == "v":
            begin = calculated
        known = (i,) if options.model_exchange else ()
        kind = {"causality": "output", "dependencies": known} if shown else {"causality": "local"}
        yield Variable(name if shown else f"s{i + 1}", i, unit=unit, **kind, **begin)
    if options.arrays:
        begin = {"initial": "exact", "start": "0 0 0 0"} if exact else calculated
        yield Variable("pose", 30, "output", size=4, dependencies=(30,) if options.model_exchange else (), **begin)
    if options.model_exchange:
        for i, (name, unit) in enumerate(zip(_ROLES, state_units, strict=True)):
            if not (options.arrays and i < 4):
                state = name if i < 4 or options.velocities else f"s{i + 1}"
                yield Variable(f"der({state})", 6 + i, "local", unit=_RATE[unit], derivative=i, **calculated)
        if options.arrays:
            yield Variable("der(pose)", 32, "local", size=4, derivative=30, **calculated)
    if options.arrays:
        yield Variable("torque", 31, "input", held, size=2, unit=torque, start="0 0")
    else:
        yield Variable("tau_drive", 12, "input", held, unit=torque, start="0")
        yield Variable("tau_steer", 13, "input", held, unit=torque, start="0")
    fixed = {"causality": "parameter", "variability": "fixed", "initial": "exact"}
    tunable = {"causality": "parameter", "variability": "tunable", "initial": "exact"}
    yield Variable("a", 14, unit=length, start=repr(1.2 / 201.168) if length == "furlong" else "1.2", **tunable)
    yield Variable("when", 15, unit=second, start=repr(float(options.when)), **tunable)
    if not exact:
        for i, (name, unit) in enumerate(zip(_ROLES[:4], state_units, strict=False)):
            yield Variable(f"{name}0", 16 + i, unit=unit, start=_zero(options, name, unit), **fixed)
    if options.feedthrough:
        watt = {"": "", "metre": "watt"}.get(length, "W")
        drive = 31 if options.arrays else 12
        yield Variable(
            "power",
            20,
            "output",
            unit=watt,
            dependencies=(drive, 4) if options.model_exchange else (drive,),
            **calculated,
        )
    if options.drive:
        yield Variable("drive", 21, kind="enumeration", start="3", **fixed)
    if options.end_stop is not None or options.time_event or options.event_mode or options.step_event:
        yield Variable("events", 22, "output", "discrete", kind="integer", **calculated)
    if options.end_stop is not None and options.fmi == "3.0" and options.model_exchange:
        yield Variable("stop_left", 23, "local", **calculated)
        yield Variable("stop_right", 24, "local", **calculated)
    if options.discrete:
        given = {"causality": "input", "variability": "discrete"}
        yield Variable("enable", 50, kind="boolean", start="true", **given)
        yield Variable("gear", 51, kind="integer", start="1", **given)
        yield Variable("direction", 52, kind="enumeration", start="1", **given)
        yield Variable("note", 53, kind="string", start="none", **given)
        yield Variable("push", 54, "input", unit="N" if options.units == "si" else "", start="0")
    for i in range(options.fillers):
        name = f"vehicle.corner[{i % 4 + 1}].spring_{i // 4 + 1}.stiffness" if options.structured else f"filler_{i + 1}"
        yield Variable(name, 1000 + i, start="0", **fixed)
    if options.fmi == "3.0":
        yield Variable("time", 40, "independent", unit=second)


def _zero(options: Options, name: str, unit: str) -> str:
    """Return how a vehicle shows that a state is zero."""
    north = {"deg": "90", "gon": "100"}.get(unit, repr(math.pi / 2))
    return north if options.compass and name == "psi" else "0"


def description(options: Options) -> str:
    """Return the model description of a stub."""
    text = {"1.0": _description1, "2.0": _description2, "3.0": _description3}[options.fmi](options)
    for alias, name in (options.aliases or {}).items():
        text = _aliased(text, name, alias, options.fmi)
    return text


def _aliased(text: str, name: str, alias: str, fmi: str) -> str:
    """Return a model description in which a variable has a further name."""
    if fmi == "3.0":
        text, found = re.subn(rf'<(\w+) (name="{name}" [^>]*)/>', rf'<\1 \2><Alias name="{alias}"/></\1>', text)
        assert found == 1
        return text
    variable = re.search(rf'    <ScalarVariable name="{name}" .*</ScalarVariable>\n', text)
    assert variable is not None
    said = f'name="{alias}" alias="alias"' if fmi == "1.0" else f'name="{alias}"'
    further = variable[0].replace(f'name="{name}"', said)
    return text.replace("  </ModelVariables>", f"{further}  </ModelVariables>")


def _attributes(**values: object) -> str:
    texts = {key: str(value).lower() if isinstance(value, bool) else str(value) for key, value in values.items()}
    return " ".join(f"{key.rstrip('_')}={quoteattr(text)}" for key, text in texts.items() if text not in ("", "None"))


def _units(options: Options, found: list[Variable]) -> str:
    used = sorted({variable.unit for variable in found} - {""})
    lines = "".join(f"    <Unit name={quoteattr(unit)}><BaseUnit {_BASE[unit]}/></Unit>\n" for unit in used)
    return f"  <UnitDefinitions>\n{lines}  </UnitDefinitions>\n" if used else ""


def _items(indent: str, names: tuple[str, ...]) -> str:
    return "".join(f'{indent}<Item name="{name}" value="{value}"/>\n' for value, name in enumerate(names, 1))


def _types(found: list[Variable]) -> dict[str, tuple[str, ...]]:
    """Return the items of the enumerations that are used, by the name of the type."""
    return {_TYPE[v.reference]: _ITEMS[_TYPE[v.reference]] for v in found if v.kind == "enumeration"}


def _said(variable: Variable) -> dict[str, object]:
    return {
        "name": variable.name,
        "valueReference": variable.reference,
        "description": variable.description,
        "causality": variable.causality,
        "variability": variable.variability,
        "initial": variable.initial,
    }


def _experiment(options: Options) -> str:
    said = _attributes(startTime=0, stopTime=2, tolerance=options.tolerance, stepSize=options.fixed_step or 0.02)
    return f"  <DefaultExperiment {said}/>\n"


_ITEMS = {
    "Drive": ("as_printed", "front_wheel", "rear_wheel"),
    "Direction": ("forward", "neutral", "backward"),
}
_TYPE = {21: "Drive", 52: "Direction"}
_HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n'


def _description2(options: Options) -> str:
    found = variables(options)
    index = {variable.reference: i for i, variable in enumerate(found, 1)}
    indicators = 2 if options.end_stop is not None and options.model_exchange else 0
    common = {
        "modelIdentifier": options.name,
        "needsExecutionTool": options.execution_tool,
        "canBeInstantiatedOnlyOncePerProcess": options.once and options.says_once,
        "canNotUseMemoryManagementFunctions": True,
        "canGetAndSetFMUstate": options.save,
        "canSerializeFMUstate": options.save,
    }
    text = _HEAD + "<fmiModelDescription " + _attributes(
        fmiVersion="2.0",
        modelName=options.name,
        guid=options.token,
        generationTool="formation tests",
        variableNamingConvention="structured" if options.structured else "",
        numberOfEventIndicators=indicators or "",
    ) + ">\n"  # fmt: skip
    if options.model_exchange:
        needless = not options.completed_steps
        text += f"  <ModelExchange {_attributes(**common, completedIntegratorStepNotNeeded=needless)}/>\n"
    if options.interface != "model_exchange":
        varies = options.variable_step and options.fixed_step is None
        text += f"  <CoSimulation {_attributes(**common, canHandleVariableCommunicationStepSize=varies)}/>\n"
    text += _units(options, found)
    if types := _types(found):
        text += "  <TypeDefinitions>\n"
        for name, names in types.items():
            items = _items("        ", names)
            text += (
                f'    <SimpleType name="{name}">\n      <Enumeration>\n{items}      </Enumeration>\n    </SimpleType>\n'
            )
        text += "  </TypeDefinitions>\n"
    text += _experiment(options) + "  <ModelVariables>\n"
    for v in found:
        outer = _attributes(**_said(v))
        if v.kind == "real":
            derivative = index[v.derivative] if v.derivative is not None else ""
            inner = f"Real {_attributes(unit=v.unit, start=v.start, derivative=derivative)}"
        elif v.kind == "enumeration":
            inner = f"Enumeration {_attributes(declaredType=_TYPE[v.reference], start=v.start)}"
        else:
            inner = f"{v.kind.capitalize()} {_attributes(start=v.start)}"
        text += f"    <ScalarVariable {outer}><{inner}/></ScalarVariable>\n"
    text += "  </ModelVariables>\n  <ModelStructure>\n"
    for name, unknowns in _structure(found).items():
        if unknowns:
            lines = "".join(f"      <Unknown {_unknown('index', v, index)}/>\n" for v in unknowns)
            text += f"    <{name}s>\n{lines}    </{name}s>\n"
    return text + "  </ModelStructure>\n</fmiModelDescription>\n"


def _structure(found: list[Variable]) -> dict[str, list[Variable]]:
    outputs = [v for v in found if v.causality == "output"]
    derivatives = [v for v in found if v.derivative is not None]
    initial = [v for v in found if v.initial == "calculated" and (v in outputs or v in derivatives)]
    return {"Output": outputs, "Derivative": derivatives, "InitialUnknown": initial}


def _unknown(attribute: str, variable: Variable, number: Mapping[int, int]) -> str:
    text = f'{attribute}="{number[variable.reference]}"'
    if variable.dependencies is None or variable.derivative is not None:
        return text
    return f'{text} dependencies="{" ".join(str(number[reference]) for reference in variable.dependencies)}"'


def _description3(options: Options) -> str:
    found = variables(options)
    number = {variable.reference: variable.reference for variable in found}
    common = {
        "modelIdentifier": options.name,
        "needsExecutionTool": options.execution_tool,
        "canBeInstantiatedOnlyOncePerProcess": options.once and options.says_once,
        "canGetAndSetFMUState": options.save,
        "canSerializeFMUState": options.save,
    }
    head = _attributes(
        fmiVersion="3.0",
        modelName=options.name,
        instantiationToken=options.token,
        generationTool="formation tests",
        variableNamingConvention="structured" if options.structured else "",
    )
    text = f"{_HEAD}<fmiModelDescription {head}>\n"
    if options.model_exchange:
        text += f"  <ModelExchange {_attributes(**common, needsCompletedIntegratorStep=options.completed_steps)}/>\n"
    if options.interface != "model_exchange":
        more = _attributes(
            canHandleVariableCommunicationStepSize=options.variable_step and options.fixed_step is None,
            fixedInternalStepSize=options.fixed_step,
            providesIntermediateUpdate=options.intermediate_update,
            mightReturnEarlyFromDoStep=bool(options.early_return),
            canReturnEarlyAfterIntermediateUpdate=bool(options.early_return and options.intermediate_update),
            hasEventMode=options.event_mode,
        )
        text += f"  <CoSimulation {_attributes(**common)} {more}/>\n"
    text += _units(options, found)
    if types := _types(found):
        text += "  <TypeDefinitions>\n"
        for name, names in types.items():
            text += f'    <EnumerationType name="{name}">\n{_items("      ", names)}    </EnumerationType>\n'
        text += "  </TypeDefinitions>\n"
    text += _experiment(options) + "  <ModelVariables>\n"
    tags = {kind: kind.capitalize() for kind in ("enumeration", "boolean", "string")}
    tags |= {"real": "Float64", "single": "Float32", "integer": "Int32"}
    for v in found:
        inner = _attributes(**_said(v), declaredType=_TYPE.get(v.reference))
        text_start = f"<Start value={quoteattr(v.start)}/>" if v.kind == "string" else ""
        inner += " " + _attributes(unit=v.unit, start="" if text_start else v.start, derivative=v.derivative)
        inside = text_start or (f'<Dimension start="{v.size}"/>' if v.size else "")
        size = f">{inside}</{tags[v.kind]}>" if inside else "/>"
        text += f"    <{tags[v.kind]} {inner.rstrip()}{size}\n"
    text += "  </ModelVariables>\n  <ModelStructure>\n"
    for name, unknowns in _structure(found).items():
        tag = "ContinuousStateDerivative" if name == "Derivative" else name
        text += "".join(f"    <{tag} {_unknown('valueReference', v, number)}/>\n" for v in unknowns)
    text += "".join(f'    <EventIndicator valueReference="{v.reference}"/>\n' for v in found if v.reference in (23, 24))
    return text + "  </ModelStructure>\n</fmiModelDescription>\n"


def _description1(options: Options) -> str:
    found = variables(options)
    head = _attributes(
        fmiVersion="1.0",
        modelName=options.name,
        modelIdentifier=options.name,
        guid=options.token,
        generationTool="formation tests",
        variableNamingConvention="structured" if options.structured else "",
        numberOfContinuousStates=6 if options.model_exchange else 0,
        numberOfEventIndicators=2 if options.end_stop is not None and options.model_exchange else 0,
    )
    text = f"{_HEAD}<fmiModelDescription {head}>\n"
    used = sorted({variable.unit for variable in found} - {""})
    if used:
        lines = "".join(f"    <BaseUnit unit={quoteattr(unit)}/>\n" for unit in used)
        text += f"  <UnitDefinitions>\n{lines}  </UnitDefinitions>\n"
    if types := _types(found):
        text += "  <TypeDefinitions>\n"
        for type_name, names in types.items():
            items = "".join(f'        <Item name="{name}"/>\n' for name in names)
            text += f'    <Type name="{type_name}">\n      <EnumerationType>\n{items}'
            text += "      </EnumerationType>\n    </Type>\n"
        text += "  </TypeDefinitions>\n"
    text += '  <DefaultExperiment startTime="0" stopTime="2"/>\n  <ModelVariables>\n'
    tags = {
        "real": "Real",
        "enumeration": "Enumeration",
        "integer": "Integer",
        "boolean": "Boolean",
        "string": "String",
    }
    for v in found:
        parameter = v.causality == "parameter"
        outer = _attributes(
            name=v.name,
            valueReference=v.reference,
            causality="internal" if parameter else v.causality.replace("local", "internal"),
            variability="parameter" if parameter else v.variability,
            description=v.description,
        )
        start = _attributes(start=v.start, fixed=True if v.start and v.causality != "input" else "")
        declared = _attributes(declaredType=_TYPE.get(v.reference), unit=v.unit)
        text += f"    <ScalarVariable {outer}><{tags[v.kind]} {declared} {start}/></ScalarVariable>\n"
    text += "  </ModelVariables>\n"
    if options.model_exchange:
        return text + "</fmiModelDescription>\n"
    text += "  <Implementation>\n    <CoSimulation_StandAlone>\n      <Capabilities "
    text += _attributes(
        canHandleVariableCommunicationStepSize=options.variable_step and options.fixed_step is None,
        canBeInstantiatedOnlyOncePerProcess=options.once and options.says_once,
        canNotUseMemoryManagementFunctions=True,
    )
    return text + "/>\n    </CoSimulation_StandAlone>\n  </Implementation>\n</fmiModelDescription>\n"
