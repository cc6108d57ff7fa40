"""The page of a study, as data, from the files of its folder."""

from __future__ import annotations

import base64
import json
import math
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cosim
from cosim.cli import main
from cosim.errors import InputError
from cosim.report import study_content
from cosim.report.study_content import _values, study_of
from cosim.results.files import save
from cosim.results.result import Result, Variable
from cosim.scenario.scenario import Scenario
from cosim.tests.studies import LAST, write_study
from cosim.tests.study_folder import LIMIT, write_study_folder


def columns(study: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {column["name"]: column for column in json.loads(zlib.decompress(base64.b64decode(study["table"])))}


@pytest.fixture(scope="module")
def kept(short_line: Scenario) -> Result:
    return Result.of(cosim.run(short_line.edited(expectations=False)))


def test_content(tmp_path: Path, kept: Result) -> None:
    folder = tmp_path / "many"
    write_study_folder(folder, 40)
    for number in (7, 11):
        (folder / "kept" / f"run_{number}").mkdir(parents=True)
        save(kept, folder / "kept" / f"run_{number}" / "result.nc")
    (folder / "runs_to_see").mkdir()
    (folder / "runs_to_see" / "run_2.xml").write_text("<variant/>")
    (folder / "figure.png").write_bytes(b"picture")
    (folder / "cases.csv").write_text("law,passed\nprinted,3\n")

    study, runs = study_of(folder)

    json.dumps([study, runs], allow_nan=False)
    assert [run["number"] for run in runs] == [7, 11]
    assert study["kept"] == {number: f"{folder}/kept/run_{number}" for number in (7, 11)}
    assert study["to_see"] == {2: f"{folder}/runs_to_see/run_2.xml"}
    assert (study["cases"], study["text"]) == ([["law", "passed"], ["printed", "3"]], "<study/>")
    assert base64.b64decode(study["pictures"][0]["data"].partition(",")[2]) == b"picture"
    assert study["keep"] == f"formation study 'studies/my many.xml' --out {tmp_path} --keep"
    table = columns(study)
    assert [*table] == ["run", "draw", "mass", "law", "seed", "status", "settling", "margin_1", "message"]
    assert table["seed"]["values"][-1] == 1_000_040
    assert table["settling"]["values"][:2] == [None, "Infinity"]
    assert (table["mass"]["kind"], table["mass"]["unit"]) == ("value", "kg")
    assert all((mass > LIMIT) == (end == "failed") for mass, end in zip(*_pairs(table), strict=True))


@pytest.mark.parametrize(
    ("worst", "end", "told"), [(-math.inf, "least", "-Infinity"), (math.inf, "greatest", "Infinity")]
)
def test_an_infinite_quantile_has_the_sign_of_the_worst_figure(
    tmp_path: Path, worst: float, end: str, told: str
) -> None:
    write_study_folder(tmp_path, 40, none=worst)
    (measure,) = study_of(tmp_path)[0]["measures"]
    assert {name for name, value in measure.items() if value == told} == {end}


def _pairs(table: dict[str, dict[str, Any]]) -> tuple[list[float], list[str]]:
    return table["mass"]["values"][1:], table["status"]["values"][1:]


def test_large_whole_numbers_are_told_with_all_of_their_digits(tmp_path: Path) -> None:
    write_study_folder(tmp_path, 5, first_seed=2**53)
    seeds = columns(study_of(tmp_path)[0])["seed"]
    assert (seeds["exact"], seeds["values"]) == (True, [str(2**53 + k) for k in range(5)])


def test_a_page_of_10_000_runs_is_small(tmp_path: Path) -> None:
    write_study_folder(tmp_path / "many", 10_000, message="studies/../scenarios/line.xml:69:5: settled by 80 s: 84.8 s")
    assert main(["report", str(tmp_path / "many")]) == 0
    assert (tmp_path / "many" / "report.html").stat().st_size < 800_000


def test_of_very_many_runs_the_extremes_and_those_to_look_at_are_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(study_content, "MOST_ROWS", 50)
    write_study_folder(tmp_path, 1000)
    (tmp_path / "runs_to_see").mkdir()
    (tmp_path / "runs_to_see" / "run_14.xml").write_text("<variant/>")
    whole = columns(study_of(tmp_path)[0])
    shown = whole["run"]["values"]
    assert {1, 14, 21, 41} <= set(shown)
    assert len(shown) < 60
    settling = [value for value in whole["settling"]["values"] if isinstance(value, float)]
    least = min(25.0 + 7.0 * (number * 0.618034 % 1.0) for number in range(3, 1001))
    assert min(settling) == pytest.approx(40.0 + least, rel=1e-5)


def test_a_kept_result_that_cannot_be_shown_has_no_playback(tmp_path: Path, kept: Result) -> None:
    write_study_folder(tmp_path, 5)
    for number, data in ((1, b"torn"), (2, None)):
        (tmp_path / "kept" / f"run_{number}").mkdir(parents=True)
        file = tmp_path / "kept" / f"run_{number}" / "result.nc"
        save(kept.within(slice(0, 0)), file) if data is None else file.write_bytes(data)
    study, runs = study_of(tmp_path)
    assert runs == []
    assert [*study["kept"]] == [1, 2]


def test_files_of_other_runs_are_refused_or_left_out(tmp_path: Path, kept: Result) -> None:
    write_study_folder(tmp_path, 5, mark="this")
    with pytest.raises(InputError, match=r"summary.json and runs.nc are not of the same study and runs"):
        study_of(tmp_path)

    table = Result.of(cosim.load_result(tmp_path / "runs.nc"))
    keys = Variable(("run",), np.array([f"key {number}" for number in range(1, 6)]), {"kind": "run"})
    save(
        Result({**table.data_vars, "run_key": keys}, table.coords, {**table.attrs, "mark": "this"}),
        tmp_path / "runs.nc",
    )
    for number, key in ((1, "key 1 in full"), (2, "key 3"), (9, "key 9")):
        (tmp_path / "kept" / f"run_{number}").mkdir(parents=True)
        of_run = Result(kept.data_vars, kept.coords, {**kept.attrs, "study_run": key})
        save(of_run, tmp_path / "kept" / f"run_{number}" / "result.nc")
    study, runs = study_of(tmp_path)
    assert [run["number"] for run in runs] == [*study["kept"]] == [1]
    assert study["left_out"] == [f"{tmp_path}/kept/run_2"]
    assert "run_key" not in columns(study)


def test_the_command_of_a_first_look_makes_no_more_runs(tmp_path: Path) -> None:
    write_study_folder(tmp_path / "runs" / "many", 5, planned=512, changes=["simulation/@horizon=1 s"])
    assert study_of(tmp_path / "runs" / "many")[0]["keep"] == (
        f"formation study 'studies/my many.xml' --set 'simulation/@horizon=1 s' --runs 5 --out {tmp_path}/runs --keep"
    )


@pytest.mark.parametrize(
    ("summary", "message"),
    [
        (None, "holds no summary.json; expected the folder of a study, runs/NAME"),
        ("{", "summary.json cannot be read"),
        ('{"study": 1}', "summary.json is not the summary of a study: KeyError: 'title'"),
        ("[" * 100_000, "summary.json cannot be read"),
    ],
)
def test_bad_input(summary: str | None, message: str, tmp_path: Path) -> None:
    write_study_folder(tmp_path, 3)
    (tmp_path / "summary.json").unlink()
    if summary is not None:
        (tmp_path / "summary.json").write_text(summary)
    with pytest.raises(InputError, match=message):
        study_of(tmp_path)


def test_a_study_is_shown_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_study_folder(tmp_path / "many", 3)
    assert main(["report", str(tmp_path / "many"), "other.nc"]) == 2
    assert "is the folder of a study, which has a page of its own: give it alone" in capsys.readouterr().err


def test_a_study_has_its_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_study(tmp_path, rest=LAST + '<worst of="last" below="9 m"/><keep runs="2"/>')
    command = ["study", str(path), "--workers", "1", "--no-figure", "--out", str(tmp_path / "runs")]
    assert main(command) == 0
    assert "summary.json, report.html\n" in capsys.readouterr().out
    folder = tmp_path / "runs" / "small"
    study, runs = study_of(folder)
    assert [run["number"] for run in runs] == [2]
    assert study["bounds"] == [{"measure": "last", "kind": "worst", "below": 9000.0}]
    assert "<vary" in study["text"]
    (folder / "report.html").unlink()
    assert main([*command, "--no-report"]) == 0
    assert not (folder / "report.html").exists()


def test_numbers_near_to_one_another_keep_the_digits_that_tell_them_apart() -> None:
    places = np.array([5_000_000.125, 5_000_001.5, 5_000_002.75, np.nan])
    assert _values(Variable(("run",), places), np.arange(4)) == [*places[:3], None]
    assert _values(Variable(("run",), np.array([1.23456789, -2.0, np.inf])), np.arange(3)) == [
        1.23457,
        -2.0,
        "Infinity",
    ]
