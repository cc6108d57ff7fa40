"""The package as a whole: its imports, their cost, and that compiled code is never stale."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import os
import re
import shutil
import subprocess
import sys
from dataclasses import fields
from importlib.metadata import version
from pathlib import Path

import formation_controllers
import numba
import numpy as np
import pytest
from formation_controllers import CarLike, installed, kinematics, load
from formation_controllers.compiled import compiled
from formation_controllers.testing import check_controller

PACKAGE = Path(formation_controllers.__file__).parent
DISTRIBUTION = Path(__file__).parents[1]


def run(code, **env):
    return subprocess.run(
        [sys.executable, "-P", "-c", code], env=os.environ | env, capture_output=True, check=True, text=True
    ).stdout


def test_only_numpy_numba_and_the_standard_library_are_imported():
    for file in PACKAGE.glob("**/*.py"):
        allowed = {"numpy", "numba", "formation_controllers"} | sys.stdlib_module_names - {"xml"}
        compiling = "compiled.py", "dependencies.py", "kept.py"  # all is compiled and kept in one way, tested below
        if file.name not in compiling:
            allowed -= {"numba"}
        if file.name == "kept.py":
            allowed |= {"llvmlite"}
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{file.name}: relative import"
                names = [node.module]
            for name in names:
                assert name.split(".")[0] in allowed, f"{file.name} imports {name}"


def test_a_new_process_imports_no_more_than_it_needs_and_compiles_nothing_if_told_so():
    """Finding controllers takes no Numba, loading them no python-control; NUMBA_DISABLE_JIT=1 leaves plain Python."""
    code = (
        "import sys, formation_controllers as f\n"
        "f.installed(); print('numba' in sys.modules)\n"
        "law = f.load('lqg'); print('numba' in sys.modules, 'control' in sys.modules)\n"
        "print(type(sys.modules[law.__module__].tick).__name__)"
    )
    assert run(code, NUMBA_DISABLE_JIT="1").split() == ["False", "True", "False", "function"]


def test_modules_that_have_moved_are_found_under_their_older_names():
    for older, newer in {
        "formation_model": ["formation_model"],
        "gain_conditions": ["gain_conditions", "region_of_attraction"],
    }.items():
        old = importlib.import_module(f"formation_controllers.{older}")
        new = [importlib.import_module(f"formation_controllers.analysis.{name}") for name in newer]
        for name in old.__all__:
            assert any(getattr(old, name) is getattr(module, name, None) for module in new), name


def test_lqg_needs_no_python_control(monkeypatch):
    monkeypatch.setitem(sys.modules, "control", None)  # as if it were not installed
    check_controller(load("lqg"), vehicle=CarLike(1.2))


FORMULA = """
from somewhere.compiled import compiled
@compiled
def ahead(x):
    return x - 1.0
"""
USE = """
from somewhere.compiled import compiled
from somewhere.formula import ahead
@compiled
def used(x):
    return 2.0 * ahead(x)
"""


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled with NUMBA_DISABLE_JIT=1")
def test_a_changed_formula_is_compiled_anew_wherever_it_is_used(tmp_path, monkeypatch):
    """Two files, compiled like the package: a change in one renews the functions that the other has inlined from it."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    package = tmp_path / "somewhere"
    package.mkdir()
    shutil.copy(PACKAGE / "compiled.py", package)
    for name, text in (("formula", FORMULA), ("use", USE)):
        (package / f"{name}.py").write_text(text)

    def used(x):
        """Return the number that a new process computes, and whether it found the function in the cache."""
        for name in [name for name in sys.modules if name.split(".")[0] == package.name]:
            monkeypatch.delitem(sys.modules, name)
        importlib.invalidate_caches()
        function = importlib.import_module(f"{package.name}.use").used
        return function(x), bool(function.stats.cache_hits)

    assert used(4.0) == (6.0, False)
    assert used(4.0) == (6.0, True)
    formula = package / "formula.py"
    formula.write_text(formula.read_text().replace("x - 1.0", "x + 21.0"))  # of another size: Python looks at that too
    assert used(4.0) == (50.0, False)


def refuse(*args):
    raise RuntimeError("cannot cache function: no locator available")


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled with NUMBA_DISABLE_JIT=1")
@pytest.mark.parametrize(
    "obstacle",
    [
        ("FunctionCache.__init__", refuse),  # a read-only installation without a home to write to
        ("IndexDataCacheFile.__init__", lambda self, *args, **rest: None),  # a Numba of another kind
    ],
    ids=["no_place", "other_numba"],
)
def test_without_a_place_for_compiled_code_the_package_works_uncached(tmp_path, monkeypatch, obstacle):
    written = []
    for place in ("good", "bad"):
        monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / place))
        if place == "bad":
            name, other = obstacle
            monkeypatch.setattr(f"numba.core.caching.{name}", other)
        function = compiled(kinematics.line_of_sight.py_func)
        assert function(4.0, 0.0, 1.0)[0] == 3.0
        written.append(len(list((tmp_path / place).glob("**/*.nbc"))))
    assert written == [1, 0]


def test_changelog_starts_with_this_version():
    changelog = (DISTRIBUTION / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.search(r"^## (\S+)", changelog, re.MULTILINE)[1] == version("formation-controllers")


LAWS = {name: load(name) for name, found in installed().items() if found.package == "formation-controllers"}


def bound(info):
    limits = {">": info.above, ">=": info.at_least, "<": info.below}
    return ", ".join(f"{sign} {limit:g}" for sign, limit in limits.items() if limit is not None)


def value(default):
    numbers = np.atleast_1d(default)
    return ", ".join(f"{n:g}" for n in numbers) if len(numbers) < 4 else f"{numbers[0]:g}, ..., {numbers[-1]:g}"


def tables(head, of_law):
    """Return tables of rows, one for each set of laws that share them, the largest set first."""
    laws = {}
    for name, law in LAWS.items():
        for row in of_law(law):
            laws.setdefault(row, []).append(name)
    rows = {}
    for (first, *rest), names in laws.items():
        rows.setdefault(tuple(names), []).append("| " + " | ".join([f"`{first}`", *rest]) + " |")
    for names in sorted(rows, key=len, reverse=True):
        which = "every law" if len(names) == len(LAWS) else ", ".join(f"`{name}`" for name in names)
        line = f"|{'---|' * head.count(' | ')}---|"
        yield "\n".join([f"{head.split()[1].capitalize()}s of {which}:", "", head, line, *rows[names]])


GAINS = "| gain | symbol | unit | default | bound | meaning |"
SIGNALS = "| signal | unit | meaning |"


def gain_rows(law):
    for field in fields(law.gains_type):
        info = field.metadata["gain"]
        yield field.name, info.symbol, info.unit, value(field.default), bound(info), info.description


def signal_rows(law):
    return [(signal.name, signal.unit, signal.description) for signal in law.signals]


@pytest.mark.parametrize(("head", "of_law"), [(GAINS, gain_rows), (SIGNALS, signal_rows)])
def test_readme_has_tables_of_all_gains_and_signals(head, of_law):
    readme = (DISTRIBUTION / "README.md").read_text(encoding="utf-8")
    assert "\n\n".join(tables(head, of_law)) + "\n\n" in readme
    assert readme.count(head) == len(list(tables(head, of_law)))


def test_a_name_means_the_same_signal_in_every_law():
    meanings = {(s.name, s.unit, s.components) for law in LAWS.values() for s in law.signals}
    assert len(meanings) == len({name for name, _, _ in meanings})


def test_readme_examples_run_as_written():
    readme = (DISTRIBUTION / "README.md").read_text(encoding="utf-8")
    example = "".join(re.findall(r"```python\n(.*?)```", readme, re.DOTALL))
    names: dict[str, object] = {}
    exec(compile(example, "README.md", "exec"), names)
    assert names["torque"].shape == (2, 2)
    assert np.isfinite(names["torque"]).all()
    assert names["estimates"].shape == (2,)


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled with NUMBA_DISABLE_JIT=1")
def test_compiled_matrix_products_load_scipy_when_they_are_needed() -> None:
    program = """
import sys
import numba, numpy as np
from formation_controllers.compiled import compiled
print("scipy.linalg" in sys.modules)
print(numba.njit(lambda a: np.dot(a, a).sum() + np.linalg.det(a))(np.eye(2)), "scipy.linalg" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", program], check=True, timeout=300, capture_output=True, text=True)
    assert done.stdout == "False\n3.0 True\n"
