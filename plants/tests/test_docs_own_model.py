"""The page docs/own_model.md as written: its code runs, in order, and prints what the page shows."""

import re
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

import fmpy
import fmpy.validation
import pytest

PAGE = Path(__file__).parents[2] / "docs" / "own_model.md"


def test_the_page_runs_as_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```(python|text)\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert len([kind for kind, _ in blocks if kind == "python"]) >= 6
    names: dict[str, object] = {}
    printed = ""
    for kind, block in blocks:
        if kind == "text":
            assert printed == block
            printed = ""
            continue
        assert printed == "", "code prints what the page does not show"
        with redirect_stdout(StringIO()) as output:
            exec(block, names)
        printed = output.getvalue()
    assert printed == ""
    built = sorted(path.name for path in (tmp_path / "fmus").iterdir())
    assert built == ["cart.fmu", "unicycle.fmu"]
    for name in built:
        assert fmpy.validation.validate_fmu(str(tmp_path / "fmus" / name)) == []


def test_stating_the_model_takes_few_lines() -> None:
    """About twenty, not counting where each of the declared quantities has a line of its own."""
    (block,) = re.findall(r"(unicycle = OdeModel\(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert len(block.splitlines()) <= 25
