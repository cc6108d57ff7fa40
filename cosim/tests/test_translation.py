"""Python functions become C with the same bits, or are refused."""

import ctypes
import importlib.util
import itertools
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from formation_controllers import CarLike, DifferentialDrive, Team, TractorTrailer, elementary, load
from formation_controllers.interface import TickInputs
from formation_controllers.vehicles import Vehicle

from cosim.signals.effects import bias, delay, dropout, effectiveness, quantisation, rate, saturation
from cosim.tests import random_functions
from cosim.translation import CSource, Entry, Untranslatable, translate

FLAGS = (
    *("-std=c11", "-ffp-contract=off", "-shared", "-fPIC", "-Werror"),
    *("-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Wconversion", "-Wmissing-prototypes"),
)
CAR, TRACTOR, DIFFERENTIAL = CarLike(0.5), TractorTrailer(0.4, 0.1, 0.25), DifferentialDrive(0.1, 0.25)
LIMITED = {"guard": 0.1, "torque_limit": 5.0}
SIZE = 3

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="compiles with gcc's options")


def compiled(source: CSource, folder: Path, optimised: str, *flags: str) -> ctypes.CDLL:
    (folder / source.header_name).write_text(source.header, encoding="utf-8")
    (folder / source.source_name).write_text(source.source, encoding="utf-8")
    library = folder / f"{source.source_name}{optimised}.so"
    command = ["gcc", *FLAGS, *flags, optimised, source.source_name, "-o", library, "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    return ctypes.CDLL(str(library))


def as_struct(value: Any, dtype: np.dtype[Any]) -> np.ndarray[Any, Any]:
    """Return a named tuple as the struct that C takes."""
    found = np.zeros((), dtype)

    def fill(place: Any, own: Any) -> None:
        for name, item in zip(own._fields, own, strict=True):
            if name in (place.dtype.names or ()):
                if hasattr(item, "_fields"):
                    fill(place[name], item)
                else:
                    place[name] = item

    fill(found, value)
    return found


def address(array: np.ndarray[Any, Any]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


def bits(array: Any) -> bytes:
    """Return all bits; of NaN just that it is one, as neither IEEE 754 nor a compiler keeps its sign."""
    numbers = np.ascontiguousarray(array).view(np.float64)
    return np.where(np.isnan(numbers), np.nan, numbers).tobytes()


# Laws --------------------------------------------------------------------------------------------------------


def random_inputs(vehicle: Vehicle, random: np.random.Generator) -> TickInputs:
    poses, velocities = len(vehicle.pose), len(vehicle.velocity)
    return TickInputs(
        random.normal(0, 3, (SIZE, poses)),
        random.normal(0, 2, (SIZE, velocities)),
        random.normal(0, 3, poses),
        *(random.normal(0, 1, velocities) for _ in range(2)),
        *(random.normal(0, 1, (SIZE, 2)) for _ in range(3)),
    )


def driven_inputs(vehicle: Vehicle, step: int) -> TickInputs:
    """Return a team that follows its leader along a wavy path."""
    poses, t = len(vehicle.pose), 0.02 * step
    places = np.array([[-1.0 - i, 0.5 * i, 0.1 * i, 0.2] for i in range(SIZE)])
    waves = np.array([0.3 * t, np.sin(0.2 * t), 0.2 * np.sin(t), 0.1 * np.cos(t)])
    q = np.array([[1.0 + i, 0.3 - 0.2 * i] for i in range(SIZE)])
    velocity = np.full((SIZE, 2), 0.3)
    leader = 0.3 * t, np.sin(0.2 * t), 0.2, 0.0
    none = np.zeros((SIZE, 2))
    return TickInputs(
        *((places + waves)[:, :poses].copy(), velocity, np.array(leader)[:poses].copy()),
        *(np.array([0.3, 0.05]), np.array([0.01, 0.0]), q, none, none + 0.01),
    )


@pytest.mark.parametrize(
    ("law", "vehicle", "gains"),
    [
        ("neural-adaptive-pid", CAR, {"W_m": 5.0}),
        ("neural-adaptive-pid", DIFFERENTIAL, LIMITED),
        ("observer-pid", TRACTOR, LIMITED),
        ("neural-high-gain", TRACTOR, {}),
        ("neural-high-gain", DIFFERENTIAL, LIMITED),
        ("feedback-linearisation", CAR, {"guard": 0.1}),
        ("feedback-linearisation", DIFFERENTIAL, {}),
        ("lqg", CAR, LIMITED),
    ],
    ids=lambda value: value if isinstance(value, str) else getattr(value, "kind", None) or "-".join(value) or "plain",
)
def test_law_in_c_has_the_same_bits(law: str, vehicle: Vehicle, gains: dict[str, float], tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    name = law.replace("-", "_")
    controller = load(law)(Team(vehicle, SIZE, 0.02), load(law).gains_type(**gains))
    tick, start = controller.compiled_tick(), controller.compiled_start()
    example = random_inputs(vehicle, random), tick.own
    entries = [Entry("start", start.function, example), Entry("tick", tick.function, (*example, np.zeros((SIZE, 2))))]
    source = translate(name, entries, primitives=elementary.PRIMITIVES)
    libraries = [compiled(source, tmp_path, optimised) for optimised in ("-O0", "-O2")]
    inputs_type, records_type = (
        next(dtype for own, dtype in source.structs.items() if own.endswith(tail))
        for tail in ("TickInputs", "TeamRecords")
    )
    own, guarded, held, unfinite = tick.own, 0, 0, 0
    for step in range(200):
        inputs = driven_inputs(vehicle, step) if step < 100 else random_inputs(vehicle, random)
        if step > 100 and step % 10 == 0:
            inputs.pose[0] = inputs.leader_pose
            for field in own.state.dtype.names:
                own.state[field] = random.normal(0, 1, own.state[field].shape)
        torques = [np.full((SIZE, 2), np.nan) for _ in libraries]
        expected = np.full((SIZE, 2), np.nan)
        records = [as_struct(own, records_type) for _ in libraries]
        given = as_struct(inputs, inputs_type)
        for library, record, torque in zip(libraries, records, torques, strict=True):
            if step in (0, 150):
                getattr(library, f"{name}_start")(address(given), address(record))
            getattr(library, f"{name}_tick")(address(given), address(record), address(torque))
        if step in (0, 150):
            start.function(inputs, own)
        tick.function(inputs, own, expected)
        for record, torque in zip(records, torques, strict=True):
            assert bits(torque) == bits(expected)
            assert bits(record["state"]) == bits(own.state)
            assert bits(record["telemetry"]) == bits(own.telemetry)
        guarded += bool((own.telemetry["guarded"] > 0).any())
        held += "held" in own.telemetry.dtype.names and bool((own.telemetry["held"] > 0).any())
        unfinite += not np.isfinite(expected).all()
    assert guarded or "guard" not in gains
    assert held or "torque_limit" not in gains
    assert unfinite or vehicle is not DIFFERENTIAL or gains


def test_header_serves_c_plus_plus_and_stands_alone(tmp_path: Path) -> None:
    controller = load("observer-pid")(Team(CAR, SIZE, 0.02))
    tick = controller.compiled_tick()
    example = random_inputs(CAR, np.random.default_rng(0)), tick.own, np.zeros((SIZE, 2))
    source = translate(
        "observer_pid", [Entry("tick", tick.function, example)], about="The law.", primitives=elementary.PRIMITIVES
    )
    library = compiled(source, tmp_path, "-O2")
    assert library.observer_pid_tick
    (tmp_path / "user.cpp").write_text('#include "observer_pid.h"\n#include "observer_pid.h"\n', encoding="utf-8")
    subprocess.run(["g++", "-Wall", "-Wextra", "-Werror", "-c", "user.cpp"], cwd=tmp_path, check=True)
    assert source.header.startswith("/* The law. Translated from the Python of formation_controllers.observer_pid;")
    assert source.prototypes["tick"].startswith("void observer_pid_tick(const ObserverPidTickInputs *inputs, ")
    assert "/* Estimate (32)" not in source.header
    assert "own->q_hat[j] += period * c->q_hat_dot[j][r];" in source.source
    assert max(map(len, (source.header + source.source).splitlines())) <= 120
    assert "malloc" not in source.source


# Effects -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("act", "remembers"),
    [
        (delay.hold_back, 4),
        (delay.hold_back_from_first, 4),
        (bias.add, 0),
        (dropout.hold, 1),
        (effectiveness.keep_part, 0),
        (quantisation.to_steps, 0),
        (rate.follow, 1),
        (saturation.clip, 0),
    ],
)
def test_effect_in_c_has_the_same_bits(act: Callable[..., None], remembers: int, tmp_path: Path) -> None:
    random = np.random.default_rng(5)
    shape = 3, 2
    memory = np.zeros((remembers, *shape))
    source = translate("effect", [Entry("act", act, (0, np.zeros(shape), np.zeros(shape), memory))])
    library = compiled(source, tmp_path, "-O2")
    kept = memory.copy()
    for tick in range(12):
        values, amount = random.normal(0, 2, shape), random.choice([0.0, 1.0, 2.0, 3.0], shape)
        if act is rate.follow and tick % 3 == 0:
            amount[0] = np.inf
        own = values.copy()
        library.effect_act(ctypes.c_int64(tick), address(own), address(amount), address(kept))
        act(tick, values, amount, memory)
        assert own.tobytes() == values.tobytes()
        assert kept.tobytes() == memory.tobytes()


# Refusals, and random functions --------------------------------------------------------------------------------


def module_of(text: str, folder: Path, name: str) -> ModuleType:
    path = folder / f"{name}.py"
    path.write_text(text, encoding="utf-8")
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


REFUSED = {
    "return 1.0 if 0.0 < x < 1.0 else 0.0": "a chained comparison: write 0.0 < x and x < 1.0",
    "if x > 0.0:\n        z = 1.0\n    return z": "z may have no value here",
    "for j in range(3):\n        z = 1.0 * j\n    return z": "z may have no value here",
    "for j in range(3):\n        pass\n    return j": "j is needed behind its loop",
    "for j in range(3):\n        j = 2\n    return x": "the loop's j is assigned within the loop: take another name",
    "for j in range(i):\n        for j in range(2):\n            a[0] = x\n    return x": "the loop's j is assigned",
    "for value in a:\n        x += value\n    return x": "a loop runs over range",
    "return math.sin(x)": "math.sin has no translation to C with the same bits everywhere",
    "return x ** 2": "a power is rounded differently",
    "return x % 2.0": "needs whole numbers",
    "return [x][0]": "a list has no translation",
    "return {'x': x}['x']": "a dictionary has no translation",
    "try:\n        x = 1.0\n    except ValueError:\n        x = 2.0\n    return x": "try has no translation",
    "with x:\n        pass\n    return x": "with has no translation",
    "f = lambda z: z\n    return f(x)": "a lambda has no translation",
    "def inner(z):\n        return z\n    return inner(x)": "a function within a function has no translation",
    "return function(x, i, a)": "function calls itself",
    "total = 0\n    for j in range(i):\n        total += x\n    return total": "total is a whole number",
    "if x:\n        return 1.0\n    return 0.0": "x is a float, not a truth value",
    "return x and 1.0": "x is a float, not a truth value",
    "return a": "an array is passed in to be filled",
    "if x > 0.0:\n        return x": "ends with a return on every way",
    "a[:] = a[::-1]\n    return x": "a slice has a positive step",
    "a[1:3] = a[0:2]\n    return x": "an array is copied onto a part of itself",
    "shift(a[0:2], a[1:3])\n    return x": "two arguments may be parts of one array, a, which is written",
    "return push(a) + a[0]": 'push(a)" writes into an array|push writes into an array',
    "b = a[0:2] if x > 0.0 else a[2:4]\n    return b[0]": "is not a number",
    "b = a[i % 2:]\n    i = 1\n    return b[0]": "the place of this view may change",
    "b = a[int(a[0]) % 4:]\n    a[0] = 1.0\n    return b[0]": "the place of this view may change",
    "q = a\n    q = a[1:]\n    return q[0]": "q names several arrays",
    "return a[7]": "there are only 4 entries",
    "return unknown": "unknown is not known here",
    "return sum(a)": "sum has no translation",
    "return x if x is not None else 0.0": "only numbers are compared",
    "x = y = 1.0\n    return x": "several assignments at once",
    "(x, y), z = (1.0, 2.0), 3.0\n    return x": "targets within targets",
    "b = np.empty(i)\n    return b[0]": "the sizes of an array are positive constants",
    "assert x > 0.0\n    return x": "assert has no translation",
    "raise ValueError\n    return x": "raise has no translation",
    "return float(i << 64)": "a shift is by 0 to 63 bits",
    "return float(i >> -1)": "a shift is by 0 to 63 bits",
    "return float(i // 0)": "this divides by zero",
    "return float(i % (2 - 2))": "this divides by zero",
    "return 9223372036854775807 + 1": "has more than 64 bits",
    "return float(BIG)": "BIG has more than 64 bits",
    "return x * HUGE": "HUGE has more than 64 bits",
    "return float(-LEAST)": "-LEAST has more than 64 bits",
    "for j in range(i, -5, LEAST):\n        x += 1.0\n    return x": "range(i, -5, LEAST) has more than 64 bits",
    "global HALF\n    HALF = x\n    return x": "global has no translation",
    "NUMBERS[0] = x\n    return x": "NUMBERS is a constant",
    "while x > 0.0:\n        x -= 1.0\n    else:\n        x = 5.0\n    return x": "else of a loop",
    "return (x := 2.0)": "an assignment within an expression",
    "i = 0.5\n    return i": "i is a whole number before, and a float here",
    "if x > 0.0:\n        return\n    return x": "nothing is returned here, and a value elsewhere",
    "if x > 0.0:\n        return None\n    return x": "nothing is returned here, and a value elsewhere",
}


@pytest.mark.parametrize("body", REFUSED)
def test_what_is_outside_of_the_subset_is_refused(body: str, tmp_path: Path) -> None:
    text = (
        "import math\nimport numpy as np\n\nHALF = 0.5\nNUMBERS = np.zeros(3)\n"
        "BIG = 2**70\nHUGE = 10**400\nLEAST = -(2**63)\n\n\n"
        "def shift(to, of):\n    for j in range(len(to)):\n        to[j] = of[j]\n\n\n"
        "def push(to):\n    to[0] += 1.0\n    return to[0]\n\n\n"
        f"def function(x, i, a):\n    {body}\n"
    )
    module = module_of(text, tmp_path, "refused")
    with pytest.raises(Untranslatable, match=REFUSED[body].replace("(", "\\(").replace(")", "\\)")) as refused:
        translate("refused", [Entry("function", module.function, (0.5, 2, np.zeros(4)))])
    where = refused.value.where
    assert where is not None
    assert where.file == str(tmp_path / "refused.py")
    assert refused.value.text == text.splitlines()[where.line - 1].strip()
    assert refused.value.text in str(refused.value)


def test_random_functions_have_the_same_bits_in_c(tmp_path: Path) -> None:
    count = 150
    text = "".join(random_functions.Text(seed).function(f"f_{seed}") for seed in range(count))
    module = module_of(random_functions.HEAD + text, tmp_path, "fuzzed")
    example = 0.5, 0.5, 1, np.zeros(4), np.zeros((2, 3)), np.zeros(3, np.int64)
    accepted = []
    for seed in range(count):
        entry = Entry(f"f_{seed}", getattr(module, f"f_{seed}"), example)
        try:
            translate("one", [entry])
        except Untranslatable:
            continue
        accepted.append(entry)
    assert len(accepted) > count / 2
    source = translate("fuzzed", accepted)
    for optimised in ("-O0", "-O2"):
        library = compiled(source, tmp_path, optimised, "-Wno-tautological-compare")
        for entry in accepted:
            random = np.random.default_rng(int(entry.name[2:]))
            function = getattr(library, f"fuzzed_{entry.name}")
            function.restype = ctypes.c_double
            for _ in range(4):
                x, y = random.normal(0, 2, 2).tolist()
                i = int(random.integers(-9, 10))
                arrays = random.normal(0, 2, 4), random.normal(0, 2, (2, 3)), random.integers(-5, 9, 3)
                own = [array.copy() for array in arrays]
                numbers = ctypes.c_double(x), ctypes.c_double(y), ctypes.c_int64(i)
                result = function(*numbers, *map(address, own))
                try:
                    with np.errstate(all="ignore"):
                        expected = entry.function(x, y, i, *arrays)
                except (OverflowError, ValueError):  # a whole number of an infinity or of NaN
                    continue
                assert bits(np.float64(result)) == bits(np.float64(expected)), entry.name
                assert [bits(array) for array in own[:2]] == [bits(array) for array in arrays[:2]], entry.name
                assert np.array_equal(own[2], arrays[2]), entry.name


# What is easily translated to something else ---------------------------------------------------------------------

TRAPS = """
import functools

import numpy as np

MANY = 100000
BITS = 1 << 30
CUBE = np.arange(24.0).reshape(2, 3, 4)
LEAST = -(2**62) * 2


def doubled(function):
    @functools.wraps(function)
    def twice(x, i, a):
        return 2.0 * function(x, i, a)

    return twice


def once(x, i, a):
    return x + 1.0


def choice_of_constants(x, i, a):
    return float((MANY if x > 0.0 else 3) * 100000)


def choice_of_choices(x, i, a):
    return float((MANY if x > 0.0 else MANY if i > 0 else 5) * (MANY if i > 1 else 7) - (1 if x > 0.0 else 2))


def shifted_choice(x, i, a):
    return float((BITS if x > 0.0 else 1) >> 40) + float((BITS if x > 0.0 else 1) << 20)


def turned_round(x, i, a):
    return float(~BITS * 8 + ~(BITS if x > 0.0 else 1) * 8 - -(BITS if x > 0.0 else 1) * 8)


def quotients(x, i, a):
    return float((-7 if x > 0.0 else 7) // (2 if i > 0 else -2)) + float((-7 if x > 0.0 else 7) % (i - 5))


def three_dimensions(x, i, a):
    return CUBE[1, 2, 3] + CUBE[i % 2, i % 3, 1]


def least(x, i, a):
    return float(LEAST) + float(LEAST + i)


def by_place(x, /, i, *, y=2.0):
    return x * y + float(i)


def calls_by_place(x, i, a):
    return by_place(x, i) + by_place(x, i, y=x)


def like_a_type(x, i, a):
    Doubles2 = x
    u, v = two(x, Doubles2)
    return u - v + Doubles2


def two(x, y):
    return x * y, x - y


def head_by_name(x, i, a):
    n = i % 4
    head = a[:n]
    head[:] = 7.0
    same = head
    total = 0.0
    for j in range(len(same)):
        total += same[j] + 0.5
    return total


def head_of_a_row(x, i, a):
    n = i % 3
    m = np.zeros((2, 2))
    row = m[1, :n]
    for j in range(len(row)):
        row[j] = 9.0
    return m[0, 0] + 10.0 * m[0, 1] + 100.0 * m[1, 0] + 1000.0 * m[1, 1]


def counted(of):
    again = of
    total = 0.0
    for j in range(len(again)):
        total += 1.0
        again[j] += 1.0
    return total


def head_in_another_function(x, i, a):
    first = counted(a[: i % 4])
    second = counted(a[:2])
    return first + 10.0 * second


def nines(m):
    for j in range(m.shape[0]):
        for k in range(m.shape[1]):
            m[j, k] = 9.0


def corner(x, i, a):
    m = np.zeros((3, 3))
    part = m[0:2, 0:2]
    part[0, 1] = x
    nines(m[:2, 1:])
    nines(m[1:, :2])
    a[0] = m[0, 1]
    a[1] = m[0, 2]
    a[2] = m[1, 0]
    a[3] = m[2, 1] + 10.0 * m[2, 2]
    return m[0, 0]


def end_of_a_loop_in_an_array(x, i, a):
    for j in range(int(a[2])):
        a[2] = 0.0
        a[j] += 1.0
    return a[0]


def row_chosen_by_itself(x, i, a):
    m = np.zeros((3, 2))
    m[0, 0] = i % 3
    m[int(m[0, 0]), :] = 2.0
    a[:] = m[int(a[1]), 1]
    a[0] = 1.0
    a[: int(a[0]) + 1] = 3.0
    return m[0, 0] + m[1, 0] * 10.0 + m[1, 1] * 100.0 + m[2, 0] * 1000.0


def row_chosen_by_what_is_written(x, i, a):
    table = np.zeros((2, 4))
    table[1, :] = 5.0
    table[0, :] = 1.0
    a[0] = 0.0
    a[:] = table[int(a[0]), :]
    return a[3]


def with_for(x, i, a):
    n = 3
    for j in range(n):
        n = j + 7
        a[j] += float(n)
    return a[0] + a[1] + a[2]
"""


def test_what_is_easily_mistaken_has_the_same_bits(tmp_path: Path) -> None:
    text = TRAPS + "\n\ntwice = doubled(once)\n"
    module = module_of(text, tmp_path, "traps")
    names = re.findall(r"^def (\w+)\(x, i, a\):", text, re.MULTILINE)
    assert len(names) > 9
    functions = [*(getattr(module, name) for name in names), module.twice]
    entries = [Entry(f"f_{k}", function, (0.5, 1, np.zeros(4))) for k, function in enumerate(functions)]
    source = translate("traps", entries)
    for optimised in ("-O0", "-O2"):
        library = compiled(source, tmp_path, optimised)
        for entry in entries:
            function = getattr(library, f"traps_{entry.name}")
            function.restype = ctypes.c_double
            for x, i in itertools.product((0.5, -0.5), (0, 1, 2, 3)):
                mine, theirs = np.arange(4.0), np.arange(4.0)
                result = function(ctypes.c_double(x), ctypes.c_int64(i), address(theirs))
                assert result == entry.function(x, i, mine), (entry.function.__name__, x, i)
                assert bits(mine) == bits(theirs)


def test_constants_have_the_words_of_python(tmp_path: Path) -> None:
    text = (
        "import traps_of\nfrom traps_of import LIMIT as MOST\n\nFAR = 5.0  # beyond it, nothing counts\n"
        "NEAR = 1.0\n\n"
        'LEFT = 1\nRIGHT = 2\n"""The sides."""\n\n\n'
        "def f(x):\n    return (x if x > NEAR else FAR) + MOST + float(LEFT if x > 0.0 else RIGHT) + traps_of.LIMIT\n"
    )
    other = 'LIMIT = 7.0\n"""Nothing is larger."""\n'
    sys.modules["traps_of"] = module_of(other, tmp_path, "traps_of")
    try:
        source = translate("words", [Entry("f", module_of(text, tmp_path, "words").f, (0.5,))]).source
    finally:
        del sys.modules["traps_of"]
    begin, end = source.index("/* Constants of words */"), source.index("double words_f(")
    assert source[begin:end].split("\n\n") == [
        "/* Constants of words */\n"
        "static const double words_FAR = 5.0; /* beyond it, nothing counts */\n"
        "static const double words_NEAR = 1.0;\n"
        "/* The sides. */\nenum { words_LEFT = 1 };\nenum { words_RIGHT = 2 };",
        "/* Constants of traps_of */\n/* Nothing is larger. */\nstatic const double traps_of_LIMIT = 7.0;",
        "",
    ]


def test_constants_come_from_where_python_has_imported_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = {
        "limits": "LIMIT = 9.0  # of all\n",
        "sub/limits": "LIMIT = 2.0  # of these\n",
        "sub/__init__": "from numpy import e\n\nfrom ..limits import LIMIT as TOP\nfrom .limits import LIMIT\n\n\n"
        "def f(x):\n    return x + TOP + LIMIT + e\n",
        "pair": "Z, Y = 1.0, 3.0  # both\nglobals()['W'] = 4.0\n\nfrom outer.other import W, Y\n",
        "other": "from outer.pair import W, Y\n\n\ndef f(x):\n    return x + Y + W\n",
    }
    for name, text in files.items():
        path = tmp_path / "outer" / f"{name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    for name, expected in {
        "sub": ["double limits_LIMIT = 9.0; /* of all */", "double limits_LIMIT_2 = 2.0; /* of these */"],
        "pair": ["double pair_Y = 3.0; /* both */", "double other_W = 4.0;"],
    }.items():
        module = importlib.import_module(f"outer.{name}")
        function = getattr(module, "f", None) or sys.modules["outer.other"].f
        source = translate(name, [Entry("f", function, (0.5,))]).source
        assert re.findall("^static const (.*)$", source, re.MULTILINE) == expected


@pytest.mark.parametrize(
    ("text", "was", "now"),
    [
        ("def f(x):\n    return x + 1.0\n", "def f", "def g(y):\n    return y\n\n\ndef f"),
        ("def f(x):\n    return x + 1.0\n", "+", "-"),
        ("def f(x):\n    return x + 0.0\n", "0.0", "-0.0"),
        ("class Laws:\n    def f(x):\n        return x + 1.0\n\n\nf = Laws.f\n", "+", "-"),
        ("def f(x):\n    return x + 1.0\n", "return", "return ("),
    ],
    ids=["above", "operator", "sign-of-zero", "in-a-class", "no-python"],
)
def test_a_text_that_has_changed_since_is_refused(text: str, was: str, now: str, tmp_path: Path) -> None:
    module = module_of(text, tmp_path, "changing")
    (tmp_path / "changing.py").write_text(text.replace(was, now), encoding="utf-8")
    with pytest.raises(Untranslatable, match="f has changed since it was imported"):
        translate("changing", [Entry("f", module.f, (0.5,))])


@pytest.mark.parametrize(
    "text",
    [
        'if True:\n\n    def f(x):\n        """A sum.\n\n        Of two.\n        """\n        return x + 1.0\n',
        pytest.param(
            "def f[T](x: T) -> T:\n    return x + 1.0\n",
            marks=pytest.mark.skipif(sys.version_info < (3, 12), reason="Python 3.12 has them first"),
        ),
    ],
    ids=["indented", "generic"],
)
def test_a_text_that_has_not_changed_is_translated(text: str, tmp_path: Path) -> None:
    source = translate("same", [Entry("f", module_of(text, tmp_path, "same").f, (0.5,))]).source
    assert "return x + 1.0;" in source


def test_only_def_makes_what_is_translated(tmp_path: Path) -> None:
    module = module_of("f = lambda x: x + 1.0\n", tmp_path, "lambdas")
    with pytest.raises(Untranslatable, match="only a function that is written with def is translated: f = lambda x"):
        translate("lambdas", [Entry("f", module.f, (0.5,))])


def test_a_compiler_that_may_round_otherwise_is_refused(tmp_path: Path) -> None:
    text = (
        "from numba import njit\n\n\n@njit(fastmath=True)\ndef fast(x):\n    return x + 1.0\n\n\n"
        "def f(x):\n    return fast(x)\n"
    )
    module = module_of(text, tmp_path, "quick")
    for function, line in (module.fast, 5), (module.f, 10):
        with pytest.raises(Untranslatable, match="with fastmath, a compiler rounds as it likes") as refused:
            translate("quick", [Entry("f", function, (0.5,))])
        assert refused.value.where is not None
        assert refused.value.where.line == line
