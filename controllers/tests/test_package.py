"""The package as a whole: what it imports, what it costs to import, and that compiled code is never stale."""

from __future__ import annotations

import ast
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
from formation_controllers.neural_adaptive_pid import NeuralAdaptivePid, NeuralAdaptivePidGains

PACKAGE = Path(formation_controllers.__file__).parent
DISTRIBUTION = Path(__file__).parents[1]


def run(code, **env):
    return subprocess.run(
        [sys.executable, "-P", "-c", code], env=os.environ | env, capture_output=True, check=True, text=True
    ).stdout


def test_only_numpy_numba_and_the_standard_library_are_imported():
    allowed = {"numpy", "numba", "formation_controllers"} | sys.stdlib_module_names - {"xml"}
    for file in PACKAGE.glob("**/*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{file.name}: relative import"
                names = [node.module]
            for name in names:
                assert name.split(".")[0] in allowed, f"{file.name} imports {name}"


def test_finding_controllers_does_not_import_numba():
    code = "import sys, formation_controllers as f; f.installed(); print('numba' in sys.modules)"
    assert run(code).strip() == "False"


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled with NUMBA_DISABLE_JIT=1")
def test_a_changed_formula_is_compiled_anew_wherever_it_is_used(tmp_path):
    shutil.copytree(PACKAGE, tmp_path / PACKAGE.name, ignore=shutil.ignore_patterns("__pycache__"))
    code = (
        "from formation_controllers import CarLike\n"
        "from formation_controllers.geometry import range_bearing\n"
        "print(range_bearing([0, 0, 0, 0], [4, 0, 0, 0], CarLike(1.0))[0])"
    )
    env = {"PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    assert run(code, **env).strip() == "3.0"
    assert list((tmp_path / "cache").glob("**/*.nbc")), "nothing was cached"
    kinematics = tmp_path / PACKAGE.name / "kinematics.py"
    formula = kinematics.read_text(encoding="utf-8")
    assert "ahead = e_1 - length" in formula
    kinematics.write_text(formula.replace("ahead = e_1 - length", "ahead = e_1 + length"), encoding="utf-8")
    assert run(code, **env).strip() == "5.0"


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled with NUMBA_DISABLE_JIT=1")
@pytest.mark.parametrize(
    "obstacle",
    [
        "def refuse(*args): raise RuntimeError('cannot cache function: no locator available')\n"
        "caching.FunctionCache.__init__ = refuse\n",  # a read-only installation without a home to write to
        "caching.IndexDataCacheFile.__init__ = lambda self, *args, **rest: None\n",  # a Numba of another kind
    ],
)
def test_without_a_place_for_compiled_code_the_package_works_uncached(tmp_path, obstacle):
    code = (
        "from numba.core import caching\n"
        f"{obstacle}"
        "from formation_controllers import CarLike\n"
        "from formation_controllers.geometry import range_bearing\n"
        "print(range_bearing([0, 0, 0, 0], [4, 0, 0, 0], CarLike(1.0))[0])"
    )
    assert run(code, NUMBA_CACHE_DIR=str(tmp_path)).strip() == "3.0"
    assert not list(tmp_path.glob("**/*.nbc"))


def test_changelog_starts_with_this_version():
    changelog = (DISTRIBUTION / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.search(r"^## (\S+)", changelog, re.MULTILINE)[1] == version("formation-controllers")


def test_readme_lists_every_gain_and_every_signal():
    readme = (DISTRIBUTION / "README.md").read_text(encoding="utf-8")
    for field in fields(NeuralAdaptivePidGains):
        info = field.metadata["gain"]
        assert f"| `{field.name}` | {info.symbol} |" in readme
        assert info.description in readme
    for signal in NeuralAdaptivePid.signals:
        assert f"| `{signal.name}` | {signal.unit} | {signal.description} |" in readme


def test_readme_example_runs_as_written():
    readme = (DISTRIBUTION / "README.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```python\n(.*?)```", readme, re.DOTALL)
    names: dict[str, object] = {}
    exec(compile(example, "README.md", "exec"), names)
    assert names["torque"].shape == (2, 2)
    assert np.isfinite(names["torque"]).all()
    assert names["estimates"].shape == (2,)
