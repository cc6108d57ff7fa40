"""Compiled functions are loaded only from folders to which others cannot write, and only if they are what is wanted."""

from __future__ import annotations

import errno
import importlib.util
import os
import pkgutil
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import formation_controllers
import numba
import numba.extending
import numpy as np
import pytest
from formation_controllers import (
    dependencies,
    elementary,
    neural_adaptive_pid,
    observer_pid,
    projection,
    velocity_observer,
)
from formation_controllers.compiled import _OWN, compiled
from formation_controllers.dependencies import _globals, _references, of_function, steady
from formation_controllers.kept import Files, trusted
from numba.core.dispatcher import Dispatcher

posix = pytest.mark.skipif(os.name != "posix", reason="rights of POSIX")

LAW = "from formation_controllers.compiled import compiled\n"


def printed(program: str, folder: Path, *more: Path) -> str:
    """Return what a new process prints that imports from these folders and keeps compiled functions in the first."""
    environment = {
        **os.environ,
        "NUMBA_CACHE_DIR": str(folder / "numba"),
        "PYTHONPATH": os.pathsep.join(map(str, (folder, *more))),
        "NUMBA_DISABLE_JIT": "0",
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    command = [sys.executable, "-W", "ignore", "-c", program]
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=True
    ).stdout.strip()


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    """Return a folder with a compiled function, and the folder of its source."""
    kept, sources = tmp_path / "kept", tmp_path / "sources"
    for folder in (kept, sources):
        folder.mkdir(mode=0o700)
        (folder / "file").touch()
    return kept, sources


@posix
@pytest.mark.parametrize(
    ("kept_mode", "sources_mode", "good"),
    [
        (0o700, 0o755, True),
        (0o755, 0o755, True),
        (0o775, 0o775, True),  # the sources are as much in their hands
        (0o777, 0o777, True),
        (0o775, 0o755, False),
        (0o757, 0o775, False),
        (0o1777, 0o755, False),
    ],
)
def test_rights(folders: tuple[Path, Path], kept_mode: int, sources_mode: int, good: bool) -> None:
    kept, sources = folders
    kept.chmod(kept_mode)
    sources.chmod(sources_mode)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert trusted(str(kept), str(sources)) is good
        assert trusted(str(kept), str(sources)) is good
    assert len(caught) == (0 if good else 1)
    assert all(f"because others can write to {kept}, where" in str(one.message) for one in caught)
    assert kept.stat().st_mode & 0o7777 == kept_mode, "what is there stays as it is"


@posix
def test_another_users(folders: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    kept, sources = folders
    user, owner = os.geteuid() + 1, sources.stat().st_uid
    os.chmod(kept, 0o755)
    monkeypatch.setattr(os, "geteuid", lambda: user)
    assert trusted(str(kept), str(sources)), "who owns the sources could as well change them"
    if owner == 0:
        os.chown(kept, 4711, 4711)
        with pytest.warns(RuntimeWarning, match="others can write"):
            assert not trusted(str(kept), str(sources / ".."))


@posix
def test_a_new_folder_becomes_the_users_alone(folders: tuple[Path, Path]) -> None:
    kept, sources = folders
    (kept / "file").unlink()
    kept.chmod(0o775)
    assert trusted(str(kept), str(sources))
    assert kept.stat().st_mode & 0o777 == 0o700


@posix
def test_nothing_is_loaded_from_there(tmp_path: Path) -> None:
    """The name of Numba's folder can be foretold, so that another user of a shared folder could lay it out."""
    (tmp_path / "numba").mkdir()
    (tmp_path / "module.py").write_text(LAW + "@compiled\ndef f(x):\n    return x + 1\n")

    def hits() -> str:
        return printed("import module; module.f(1); print(sum(module.f.stats.cache_hits.values()))", tmp_path)

    assert [hits(), hits()] == ["0", "1"]
    [place] = (path for path in (tmp_path / "numba").iterdir() if path.name.startswith(tmp_path.name))
    place.chmod(0o777)
    assert hits() == "0"


# What is in the files -----------------------------------------------------------------------------------------

ROW = np.arange(6.0)
COLUMN = np.arange(12.0)[::2]
"""Six other numbers, in every other place of an array."""


def total(values: Any) -> float:
    """Return a sum, by code that is another for numbers in a row and for others."""
    result = 0.0
    for i in range(len(values)):
        result += values[i]
    return result


@pytest.fixture
def anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], Any]:
    """Return what makes the function as another process does, with the files that are kept."""
    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
        pytest.skip("nothing is compiled")
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "numba"))
    return lambda: compiled(total)


def files(folder: Path, kind: str) -> list[Path]:
    return sorted(folder.glob(f"numba/**/*.{kind}"))


def test_processes_that_compile_for_different_types_at_once(
    anew: Callable[[], Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both read the index before either writes it, and choose one name; the last file is not that of the last index."""
    one, other = anew(), anew()
    save_index, save_data, late = Files._save_index, Files._save_data, list[Callable[[], None]]()

    def after_the_other(self: Any, overloads: Any) -> None:
        if self is one._cache._cache_file:
            assert other(ROW) == 15.0
        save_index(self, overloads)

    def before_the_other(self: Any, name: str, data: Any) -> None:
        if self is other._cache._cache_file:
            late.append(lambda: save_data(self, name, data))
        else:
            save_data(self, name, data)

    monkeypatch.setattr(Files, "_save_index", after_the_other)
    monkeypatch.setattr(Files, "_save_data", before_the_other)
    assert one(COLUMN) == 30.0
    [save] = late
    save()
    monkeypatch.setattr(Files, "_save_index", save_index)
    monkeypatch.setattr(Files, "_save_data", save_data)
    assert len(files(tmp_path, "nbc")) == 1, "both have the same name"
    for hits in (0, 2):
        found = anew()
        assert (found(COLUMN), found(ROW)) == (30.0, 15.0)
        assert sum(found.stats.cache_hits.values()) == hits


def test_code_of_older_sources_under_a_new_entry(anew: Callable[[], Any], tmp_path: Path) -> None:
    """A process that was killed has written the index, and not the file."""
    assert anew()(ROW) == 15.0
    [file] = files(tmp_path, "nbc")
    old = file.read_bytes()
    older = anew()
    older._cache._cache_file._versions = b"older sources"
    assert older(ROW) == 15.0
    assert file.read_bytes() != old
    [index] = files(tmp_path, "nbi")
    index.unlink()
    of_older = file.read_bytes()
    assert anew()(ROW) == 15.0
    file.write_bytes(of_older)
    found = anew()
    assert found(ROW) == 15.0
    assert sum(found.stats.cache_hits.values()) == 0
    found = anew()
    assert found(ROW) == 15.0
    assert sum(found.stats.cache_hits.values()) == 1


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", ["flip", "cut", "empty", "garbage"])
def test_damaged_files(anew: Callable[[], Any], tmp_path: Path, kind: str, damage: str) -> None:
    assert anew()(ROW) == 15.0
    [file] = files(tmp_path, kind)
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    cut = bytes(content[: len(content) // 2])
    file.write_bytes({"flip": bytes(content), "cut": cut, "empty": b"", "garbage": b"garbage" * 100}[damage])
    hits = []
    for _ in range(2):
        found = anew()
        assert found(ROW) == 15.0
        hits.append(sum(found.stats.cache_hits.values()))
    assert hits == [0, 1]


def test_a_class_that_is_not_in_this_project(tmp_path: Path) -> None:
    """What a library's function was compiled for elsewhere ends nobody's start."""
    (tmp_path / "project").mkdir()
    (tmp_path / "library.py").write_text(LAW + "@compiled\ndef first(s):\n    return s[0]\n")
    (tmp_path / "project" / "caller.py").write_text(
        "from typing import NamedTuple\nfrom library import first\n"
        "class S(NamedTuple):\n    x: float\n    y: float\nprint(first(S(1.0, 2.0)))\n"
    )
    assert printed("import caller", tmp_path, tmp_path / "project") == "1.0"
    assert printed("from library import first; print(first((3.0, 4.0)))", tmp_path) == "3.0"


def test_a_class_of_one_process_alone(tmp_path: Path) -> None:
    """The class that another process reads from the file is not that of its arguments."""
    (tmp_path / "law.py").write_text(
        LAW + "from typing import NamedTuple\n@compiled\ndef law(s):\n    return s.x\n"
        "def local():\n    class S(NamedTuple):\n        x: float\n    return S\n"
    )
    program = "from law import *; S = local(); print(law(S(1.0)), law(S(2.0)), sum(law.stats.cache_hits.values()))"
    assert [printed(program, tmp_path) for _ in range(2)] == ["1.0 2.0 0", "1.0 2.0 0"]


@pytest.mark.parametrize(
    "text",
    [
        "@compiled\ndef other(n):\n    return law(n - 1) if n else 0\n"
        "@compiled\ndef law(n):\n    return other(n - 1) if n else 0\n",
        "import threading\nfrom typing import NamedTuple\nlock = threading.Lock()\nclass S(NamedTuple):\n    x: float\n"
        "    def locked(self):\n        return lock\n@compiled\ndef f(s):\n    return s.x\n"
        "def law(n):\n    return f(S(0))\n",
        "import ctypes, ctypes.util\ncosine = ctypes.CDLL(ctypes.util.find_library('m')).cos\n"
        "cosine.argtypes, cosine.restype = [ctypes.c_double], ctypes.c_double\ndef make(f):\n    @compiled\n"
        "    def made(n):\n        return int(f(n - 4.0)) - 1\n    return made\nlaw = make(cosine)\n",
    ],
    ids=["circle", "lock", "ctypes"],
)
def test_what_numba_cannot_keep(tmp_path: Path, text: str) -> None:
    """Functions in a circle end the next process that loads them (SIGSEGV), others end in errors when they are kept."""
    for _ in range(2):
        assert printed(LAW + text + "print(law(4))", tmp_path) == "0"
        (tmp_path / "law.py").write_text(LAW + text)
        assert printed("from law import law; print(law(4))", tmp_path) == "0"


def test_a_module_that_is_not_imported_as_others_are(
    anew: Callable[[], Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # Python knows no two texts of one size in one second apart
    source = tmp_path / "apart.py"
    for gain in (2.0, 2.0, 5.0):
        source.write_text(LAW + f"GAIN = {gain}\n@compiled\ndef f(x):\n    return GAIN * x\n")
        spec = importlib.util.spec_from_file_location("apart", source)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        assert module.f(1.0) == gain


def test_a_full_disk(anew: Callable[[], Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What cannot be kept is called all the same."""

    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Files, "_open_for_write", full)
    assert anew()(ROW) == 15.0
    assert files(tmp_path, "*") == []


# What the code depends on -------------------------------------------------------------------------------------

LAWS = {
    "module": ("import laws.helper as helper", "helper.scaled(x)"),
    "package": ("from laws import helper", "helper.scaled(x)"),
    "modules": ("import laws", "laws.helper.scaled(x)"),
    "relative": ("from .helper import scaled", "scaled(x)"),
    "far": ("from laws.between import scaled", "scaled(x)"),
    "constant": ("from laws.helper import GAIN", "GAIN * x"),
    "closure": (
        "def make(m):\n    @compiled\n    def f(x):\n        return m.GAIN * x\n    return f\n"
        "from laws import helper\nf = make(helper)",
        "f(x)",
    ),
    "array": ("from laws.helper import ARRAY", "ARRAY[1] * x"),
    "file": ("GAIN = float(open('laws/data').read())", "GAIN * x"),
    "tuple": ("from laws.helper import TUPLE", "TUPLE.k * x"),
    "fields": ("from laws.helper import Gains\nGAINS = Gains(2.0, 5.0)", "GAINS.k * x"),
    "member": ("from laws.helper import Gain", "Gain.K.value * x"),
    "made": ("from laws.helper import made", "made(x)"),
    "lazy": ("import laws", "laws.lazy * x"),
    "from numpy": ("from numpy import cos\nfrom laws import helper", "helper.GAIN * cos(0.0 * x)"),
    "local name": (
        "from laws import helper\ndef made():\n    return 0.0\nname = [made]",
        "helper.GAIN * outer(x)\n@compiled\ndef outer(name):\n    def inner(y):\n"
        "        return y * name\n    return inner(1.0)",
    ),
    "names": ("import numpy as np\nfrom laws import helper", "np.log(np.exp(0.0)) + helper.GAIN * x"),
}
"""How a law comes by a gain of 2, that changes to 5: what it imports, and its term."""

UNKNOWN = {
    "by name": (
        "from laws import helper\nfrom laws.helper import NAME",
        "getattr(helper, NAME) * x",
        "all of the module laws.helper",
    ),
    "overload": (
        "from laws.helper import function",
        "function(x)",
        "function, in the place of which an extension of Numba may compile something else",
    ),
    "kept": (
        "from laws import helper",
        "helper.by_gain_kept(x)",
        "helper.by_gain_kept: a function that Numba keeps by the time of its file",
    ),
    "signature": (
        "from laws import helper",
        "helper.rounded(x)",
        "helper.rounded: a function for given types alone, or compiled in another way",
    ),
}
"""Laws with such a gain, of which it cannot be told; and why."""

HELPER = """
import enum, logging
from typing import NamedTuple
import numba
import numba.extending
import numpy as np
from numba.extending import overload

GAIN = 2.0
ARRAY = np.array([1.0, 2.0])

@compiled
def scaled(x):
    return 2.0 * x

class Gains(NamedTuple):
    k: float  # first
    other: float

TUPLE = Gains(k=2.0, other=1.0)

class Gain(enum.Enum):
    K = 2.0

def function(x): ...

@overload(function)
def in_its_place(x):
    return lambda x: 2.0 * x

NAME, log = "GAIN", logging.getLogger()

@numba.njit("float64(int64)")
def rounded(x):
    return 2.0 * x

@compiled
def gain_for(x):
    return 2.0

@compiled
def by_gain(x):
    return GAIN * x

@numba.njit
def by_gain_too(x):
    return GAIN * x

@numba.njit(cache=True)
def by_gain_kept(x):
    return GAIN * x

def make(gain):
    @compiled
    def made(x):
        return gain * x
    return made

made = make(2.0)
"""


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """Return a folder with the package `laws`, in which `law.py` is missing."""
    package = tmp_path / "laws"
    package.mkdir()
    (package / "__init__.py").write_text(
        "from laws import helper\ndef __getattr__(name):\n"
        "    if name == 'lazy':\n        return helper.GAIN\n    raise AttributeError(name)\n"
    )
    (package / "helper.py").write_text(LAW + HELPER)
    (package / "between.py").write_text("from laws.helper import *\n")
    (package / "data").write_text("2.0")
    return tmp_path


def write_law(project: Path, imports: str, term: str, name: str = "law") -> None:
    (project / "laws" / f"{name}.py").write_text(LAW + f"{imports}\n@compiled\ndef law(x):\n    return 1.0 + {term}\n")


def edit(project: Path) -> None:
    """Make a gain of 5 out of a gain of 2, in all ways."""
    for file in (project / "laws" / "helper.py", project / "laws" / "data"):
        text = file.read_text()
        text = text.replace("    k: float  # first\n    other: float", "    other: float\n    k: float")
        file.write_text(text.replace("2.0", "5.0"))


def write_edited(project: Path) -> None:
    """Write `edited.py`, with a gain of 5, for a program that puts it in the place of the helper."""
    (project / "edited.py").write_text((project / "laws" / "helper.py").read_text().replace("2.0", "5.0"))


RUN = "from laws.law import law; print(law(1.0), sum(law.stats.cache_hits.values()))"


def run_all(project: Path) -> dict[str, str]:
    """Return what each law gives in a new process, and how many times kept code was found for it."""
    names = ", ".join(f"law_{i}" for i in range(len(LAWS | UNKNOWN)))
    program = (
        f"from laws import {names}\nfor module in ({names}):\n"
        "    print(module.law(1.0), sum(module.law.stats.cache_hits.values()))"
    )
    lines = printed(program, project).splitlines()
    return dict(zip(LAWS | UNKNOWN, lines, strict=True))


def test_a_change_elsewhere_counts(project: Path) -> None:
    """Numba looks at the function's own file alone. What nobody can tell is compiled anew each time."""
    for i, (imports, term, *_) in enumerate((LAWS | UNKNOWN).values()):
        write_law(project, imports, term, f"law_{i}")
    for gain in (2.0, 5.0):
        for hits in (0, 1):
            assert run_all(project) == dict.fromkeys(LAWS, f"{1.0 + gain} {hits}") | dict.fromkeys(
                UNKNOWN, f"{1.0 + gain} 0"
            )
        edit(project)


@pytest.mark.parametrize("kind", UNKNOWN)
def test_why_a_function_is_not_kept(project: Path, monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    imports, term, reason = UNKNOWN[kind]
    write_law(project, imports, term)
    monkeypatch.setenv("NUMBA_DEBUG_CACHE", "1")
    assert f" is not kept: {reason}\n" in printed(RUN, project)


def test_another_library_of_the_same_name(tmp_path: Path) -> None:
    """One of them has the very functions of the other."""
    law = tmp_path / "law.py"
    for library, result in (("math", float(-(2**63) // 4)), ("numpy", 2.5e18)):
        law.write_text(LAW + f"import {library} as m\n@compiled\ndef law(x):\n    return m.floor(x) / 4\n")
        assert printed("from law import law; print(law(1e19))", tmp_path) == str(result)


def test_a_module_that_has_the_name_of_a_library(tmp_path: Path) -> None:
    file = tmp_path / "plugin.py"
    (tmp_path / "law.py").write_text(LAW + "@compiled\ndef law(x):\n    return m.scaled(x)\n")
    program = (
        "import statistics, law\nfrom importlib.util import *\n"
        "spec = spec_from_file_location('statistics', 'plugin.py')\n"
        "law.m = module_from_spec(spec); spec.loader.exec_module(law.m); print(law.law(1.0))"
    )
    for gain in (2.0, 5.0):
        file.write_text(LAW + f"@compiled\ndef scaled(x):\n    return {gain} * x\n")
        assert printed(program, tmp_path) == str(gain)


def test_two_states_in_turn(project: Path) -> None:
    """Each finds what was kept for it."""
    write_law(project, *LAWS["file"])
    data = project / "laws" / "data"
    for hits in (0, 1):
        for gain in (2.0, 5.0):
            data.write_text(f"{gain}")
            assert printed(RUN, project) == f"{1.0 + gain} {hits}"


@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize("name", ["by_gain", "by_gain_too"])
def test_a_constant_that_changes_after_a_part_is_compiled(project: Path, name: str, back: bool) -> None:
    """Numba does not see the change, and what it makes of that must not be found where it is the constant."""
    write_law(project, "from laws import helper", f"helper.{name}(x)")
    if back:
        change = f"from laws import helper as h; h.{name}(1); h.GAIN = 5.0; h.{name}(1.0); h.GAIN = 2.0; "
    else:
        change = f"from laws import helper as h; h.{name}(1.0); h.GAIN = 5.0; "
    assert printed(change + RUN, project) == ("6.0 0" if back else "3.0 0")
    assert printed(RUN, project) == "3.0 0"
    edit(project)
    assert [printed(RUN, project) for _ in range(2)] == ["6.0 0", "6.0 1"]


def test_a_call_that_is_not_kept_does_not_spoil_others(project: Path) -> None:
    write_law(project, "from laws import helper", "helper.gain_for(x)")
    program = "import numba; from laws import helper; helper.gain_for(numba.typed.List([1.0])); "
    assert [printed(program + RUN, project) for _ in range(2)] == ["3.0 0", "3.0 1"]


def test_what_does_not_change_the_code_does_not_count(project: Path) -> None:
    """Files that are installed or checked out anew have other times; a comment and what else is imported is nothing."""
    write_law(project, *LAWS["package"])
    assert printed(RUN, project) == "3.0 0"
    for file in project.rglob("*.py"):
        file.write_text(file.read_text() + "# and no more\n")
        os.utime(file, (1, 1))
    assert printed("import laws.between, scipy.special; " + RUN, project) == "3.0 1"


def test_an_edit_while_the_program_is_open(project: Path) -> None:
    """The program has the old text, and calls the function for the first time when the file has the new one."""
    write_law(project, *LAWS["module"])
    write_edited(project)
    moved = "import laws.law, os; os.replace('edited.py', 'laws/helper.py'); "
    assert printed(moved + RUN, project) == "3.0 0"
    assert [printed(RUN, project) for _ in range(2)] == ["6.0 0", "6.0 1"]


def test_modules_that_are_loaded_again(project: Path) -> None:
    write_law(project, *LAWS["module"])
    write_edited(project)
    again = (
        "import importlib, os\n"
        "import laws.law as own, laws.helper as helper\n"
        "assert own.law(1.0) == 3.0\n"
        "os.replace('edited.py', 'laws/helper.py')\n"
        "[importlib.reload(module) for module in (helper, own)]\n"
    )
    assert printed(again + RUN, project) == "6.0 0"
    assert printed(RUN, project) == "6.0 1"


def test_fields_of_an_argument(tmp_path: Path) -> None:
    """Where a field is in a named tuple is decided in another file than that of the function."""
    (tmp_path / "law.py").write_text(LAW + "@compiled\ndef law(s):\n    return s.x\n")
    caller = tmp_path / "caller.py"
    text = "from typing import NamedTuple\nfrom law import law\nclass S(NamedTuple):\n    x: float\n    y: float\n"
    for fields in ("    x: float\n    y: float\n", "    y: float\n    x: float\n"):
        caller.write_text(text.replace("    x: float\n    y: float\n", fields) + "print(law(S(x=1.0, y=2.0)))\n")
        assert printed("import caller", tmp_path) == "1.0"


def test_functions_of_one_name(tmp_path: Path) -> None:
    """Two of them on one line, and one that is made twice."""
    text = "one, other = compiled(lambda x: x + 1.0), compiled(lambda x: x + 2.0)\n"
    text += "def make(gain):\n    @compiled\n    def law(x):\n        return gain * x\n    return law\n"
    (tmp_path / "law.py").write_text(LAW + text)
    program = (
        "import law; laws = [law.one, law.other, law.make(3.0), law.make(4.0)]\n"
        "print(*[one(2.0) for one in laws], sum(sum(one.stats.cache_hits.values()) for one in laws[2:]))"
    )
    assert [printed(program, tmp_path) for _ in range(2)] == ["3.0 4.0 6.0 8.0 0", "3.0 4.0 6.0 8.0 2"]


@pytest.mark.parametrize("package", ["plants", "statistics"])
def test_a_package_of_another_ones_name(tmp_path: Path, package: str) -> None:
    """It is its files that make it ours, or Python's."""
    (tmp_path / f"{package}.py").write_text(LAW + "@compiled\ndef scaled(x):\n    return 2.0 * x\n")
    (tmp_path / "law.py").write_text(
        LAW + f"from {package} import scaled\n@compiled\ndef law(x):\n    return scaled(x)\n"
    )
    run = "import sys; sys.path.insert(0, '.'); from law import law; print(law(1.0))"
    assert printed(run, tmp_path) == "2.0"
    file = tmp_path / f"{package}.py"
    file.write_text(file.read_text().replace("2.0", "5.0"))
    assert printed(run, tmp_path) == "5.0"


@pytest.mark.parametrize("kind", ["list", "function"])
def test_what_cannot_be_told_is_not_kept(anew: Callable[[], Any], tmp_path: Path, kind: str) -> None:
    function, argument = (total, numba.typed.List([1.0, 2.0])) if kind == "list" else (called, compiled(scaled))
    assert compiled(function)(argument) == 3.0
    assert files(tmp_path, f"{function.__name__}*") == []


def called(function: Callable[[float], float]) -> float:
    """Return what a function makes of 1.5."""
    return function(1.5)


gain = 2.0


def scaled(x: float) -> float:
    """Return a multiple."""
    return gain * x


def test_a_constant_that_changes_while_it_is_compiled(
    anew: Callable[[], Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody knows which one is in the code."""

    def load(self: Any, key: object) -> Any:
        found = read(self, key)
        monkeypatch.setattr(sys.modules[__name__], "gain", 5.0)
        return found

    read = Files.load
    monkeypatch.setattr(Files, "load", load)
    assert compiled(scaled)(1.0) == 5.0
    assert files(tmp_path, "*") == []


def test_bounds_are_checked_if_they_shall(tmp_path: Path) -> None:
    """NUMBA_BOUNDSCHECK=1 finds the fault in a law that was compiled without it."""
    (tmp_path / "law.py").write_text(LAW + "@compiled\ndef law(x):\n    return x[len(x)]\n")
    call = "import numpy as np, law\ntry: law.law(np.ones(3)); print('unseen')\nexcept IndexError: print('seen')"
    assert printed(call, tmp_path) == "unseen"
    assert printed("import os; os.environ['NUMBA_BOUNDSCHECK'] = '1'\n" + call, tmp_path) == "seen"


# Own files, whose texts are known by their checksum: what they refer to can still be changed in memory -----------

jit = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")  # type: ignore[attr-defined]


@compiled
def replacing(p: float, q_tilde: float, Lambda_0: float, k_d: float) -> float:
    """Return another rate than `rate_estimate`."""
    return 0.0 * p


@jit
@pytest.mark.parametrize(
    ("module", "name", "value", "law"),
    [
        (projection, "ON_BOUND", 0.0, neural_adaptive_pid),
        (velocity_observer, "rate_estimate", replacing, observer_pid),
        (observer_pid, "estimate", replacing, observer_pid),
        (observer_pid, "velocity_observer", projection, observer_pid),
        (elementary, "HALF_PI", 1.5, observer_pid),
        (elementary, "copysign", elementary.sqrt, observer_pid),
    ],
)
def test_what_is_changed_in_an_own_module_counts(
    monkeypatch: pytest.MonkeyPatch, module: Any, name: str, value: Any, law: Any
) -> None:
    before = of_function(law.tick, _OWN.files)
    assert steady(law.tick, _OWN.files)
    with monkeypatch.context() as change:
        assert hasattr(module, name)
        change.setattr(module, name, value)
        assert of_function(law.tick, _OWN.files) != before
    assert of_function(law.tick, _OWN.files) == before


@jit
def test_a_change_below_a_function_that_numba_has_registered(monkeypatch: pytest.MonkeyPatch) -> None:
    """It may be compiled already, with the constant of before: nothing is kept that calls it."""
    assert steady(neural_adaptive_pid.tick, _OWN.files)
    with monkeypatch.context() as change:
        change.setattr(dependencies, "_states", dependencies._states.copy())  # a change is remembered for good
        change.setattr(elementary, "EXP_3", 0.0)
        assert not steady(neural_adaptive_pid.tick, _OWN.files)
    assert steady(neural_adaptive_pid.tick, _OWN.files)


def reinterpreted(given: Any, taken: Any) -> Any:
    """Return a function of which Numba makes no more than another type of the same bits."""

    @numba.extending.intrinsic
    def bits(typing: Any, value: Any) -> Any:
        return taken(given), lambda context, builder, _, values: builder.bitcast(
            values[0], context.get_value_type(taken)
        )

    return bits


@jit
def test_intrinsics_of_one_place_are_told_apart_by_their_closures() -> None:
    def calling(bits: Any) -> Any:
        return numba.njit(lambda x: bits(x))

    def described(given: Any, taken: Any) -> str:
        return of_function(calling(reinterpreted(given, taken)), frozenset({__file__}))

    assert described(numba.float64, numba.int64) == described(numba.float64, numba.int64)
    assert described(numba.float64, numba.int64) != described(numba.int64, numba.float64)


@jit
def test_every_own_function_can_be_described() -> None:
    """One that cannot be would be compiled at each start; and the names that it takes are found in a shorter way."""
    described = 0
    for found in pkgutil.walk_packages(formation_controllers.__path__, "formation_controllers."):
        for function in vars(importlib.import_module(found.name)).values():
            if isinstance(function, Dispatcher):
                assert of_function(function, _OWN.files)
                code = function.py_func.__code__
                assert set(_globals(code)) == {name for name, *_ in _references(code)}
                described += 1
    assert described > 50


def test_more_names_than_one_byte_counts() -> None:
    names = [f"name_{i}" for i in range(300)]
    space: dict[str, Any] = {}
    exec(f"def f():\n    return {' + '.join(names)}", space)
    assert _globals(space["f"].__code__) == tuple(sorted(names))


@jit
def test_a_process_that_changes_an_own_module_spoils_no_other(tmp_path: Path) -> None:
    run = (
        "import numba, numpy as np\nfrom formation_controllers import input_checks as c\n{}\n"
        "print(c.all_finite(*[np.array([np.nan])] * 7), sum(c.all_finite.stats.cache_hits.values()))"
    )
    changed, clean = run.format("c.finite = numba.njit(lambda array: True)"), run.format("")
    programs = [changed, clean, clean, changed]
    assert [printed(program, tmp_path) for program in programs] == ["True 0", "False 0", "False 1", "True 1"]
