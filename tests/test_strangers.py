"""Inputs of strangers that a program easily stumbles over: each is refused in one sentence, with its place."""

import os
import re
import zipfile
from pathlib import Path

import pytest

from cosim.errors import brief
from cosim.fmu.package import Package, open_package
from cosim.fmu.vehicle import as_vehicle
from cosim.scenario.document import NAMESPACE
from cosim.scenario.root_element import root_of
from cosim.tests.driving import SHORT

from .commands import command, failed

ODD_NAMES = ("a\udcffb", "a\x1b[31m\u202eb")
LONG_NAME, LONG_PATH = "a" * 300, "b/" * 3000 + "c.csv"


def changed(line: str, folder: Path, old: str, new: str) -> Path:
    """Write a changed scenario, in the encoding that it declares if there is one."""
    text = Path(line).read_text(encoding="utf-8")
    assert old in text
    path = folder / "stranger.xml"
    path.write_bytes(text.replace(old, new, 1).encode("utf-8"))
    return path


@pytest.mark.parametrize(
    ("old", "new", "place", "sentence"),
    [
        *(
            ('encoding="UTF-8"', f'encoding="{name}"', "1:31", "declares an encoding that does not fit")
            for name in ("GBK", "Big5", "Shift_JIS", "EUC-KR", "UTF-7", "undefined", "idna", "hex", "rot13", "punycode")
        ),
        ("urn:formation-cosim:scenario:1", "urn:formation cosim:scenario:1", "2:1", "the root element is"),
        (
            "<sensor>",
            '<a:x xmlns:a="a b"/><sensor>',
            r"\d+:3",
            "the element {a b}x is not part of the scenario language",
        ),
        ("<noise ", '<noise xmlns:a="a^b" a:x="1" ', r"\d+:5", "<noise> has no attribute '{a^b}x'"),
        ('seed="1"', f'seed="{"0" * 5000}"', r"11:3", "in at most 1000 digits"),
        ('seed="1"', f'seed="{"0" * 5000}1"', r"11:3", "in at most 1000 digits"),
        ("<noise ", '<noise to="1e308 s" ', r"\d+:5", 'to="1e308 s" of <noise> is longer than'),
        ("<saturation ", '<saturation from="1e308 s" ', r"\d+:5", 'from="1e308 s" of <saturation> is too long for'),
        ('step="20 ms"', 'step="1e308 s"', r"11:3", 'step="1e308 s" of <simulation> is longer than'),
        ('step="20 ms"', 'step="1e-320 s"', r"11:3", "the run has inf communication steps"),
        (
            '<desired range="',
            '<desired range="1 m" bearing="0 deg"><change to="1e308 s" range="2 m"/></desired><desired range="',
            r"\d+:\d+",
            "",
        ),
    ],
)
def test_scenarios(
    line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, place: str, sentence: str
) -> None:
    path = changed(line, tmp_path, old, new)
    assert root_of(path) or "urn:formation cosim" in new
    printed = failed(capsys, 2, "check", str(path))
    assert re.match(rf"{re.escape(str(path))}:{place}: error: ", printed)
    assert sentence in printed
    assert printed.count("\n") == 1
    assert len(printed) < 1000


@pytest.mark.parametrize("name", [LONG_NAME, LONG_PATH, "loop.csv"])
@pytest.mark.parametrize("element", ["table", "compare"])
def test_paths_that_the_system_does_not_know(
    line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, element: str
) -> None:
    (tmp_path / "loop.csv").symlink_to("pool.csv")
    (tmp_path / "pool.csv").symlink_to("loop.csv")
    old, new = {
        "table": ("<leader ", f'<input name="tau_d_y"><table file="{name}" column="c"/></input><leader '),
        "compare": ("<expect>", f'<expect><compare measure="rms" signal="range_error" factor="1" scenario="{name}"/>'),
    }[element]
    path = changed(line, tmp_path, old, new)
    printed = failed(capsys, 2, "check", str(path))
    assert f"{path}:" in printed
    assert ("File name too long" in printed) is (name != "loop.csv")
    assert len(printed) < 2000


def test_an_fmu_that_is_a_loop_of_links(line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.fmu").symlink_to("b.fmu")
    (tmp_path / "b.fmu").symlink_to("a.fmu")
    path = changed(line, tmp_path, 'model="car_like"', 'fmu="a.fmu"')
    assert "a.fmu cannot be read: Too many levels of symbolic links" in failed(capsys, 2, "check", str(path))
    assert "stranger.xml:13:3: " in failed(capsys, 2, "check", str(path), "--untrusted", str(tmp_path))
    assert "there is no such" in failed(capsys, 2, "check", line, "--untrusted", str(tmp_path / "a.fmu"))
    printed = failed(capsys, 2, "check", line, "--plant", f"clmr={tmp_path / 'a.fmu'}")
    assert "symbolic links" in printed or "there is no such file" in printed


@pytest.mark.parametrize("cut", ["front", "middle", "directory"])
def test_an_fmu_with_bytes_missing(tmp_path: Path, capsys: pytest.CaptureFixture[str], cut: str) -> None:
    path = tmp_path / "a.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        for name in ("modelDescription.xml", "a", "b"):
            archive.writestr(name, "<x/>" * 100)
    data = path.read_bytes()
    directory = data.index(b"PK\1\2")
    offset = data.index(b"PK\5\6") + 16
    path.write_bytes(
        {
            "front": data[500:],
            "middle": data[:500] + data[600:],
            "directory": data[:offset] + (directory + 1000).to_bytes(4, "little") + data[offset + 4 :],
        }[cut]
    )
    printed = failed(capsys, 2, "inspect", str(path))
    assert f"{path} is not an FMU: " in printed


@pytest.mark.parametrize(
    "options", [["--step", "1e-320 s", "--duration", "1 s"], ["--step", "1e-9 s", "--duration", "1e308 s"]]
)
def test_steps_without_number(capsys: pytest.CaptureFixture[str], options: list[str]) -> None:
    printed = failed(capsys, 2, "compare-plants", "car_like", "car_like", *options)
    assert "are not a whole number of steps" in printed


def test_an_fmu_of_many_unused_plants_is_opened_once(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = Path(line).read_text(encoding="utf-8")
    unused = "".join(f'<plant id="p{i}" model="car_like"><parameter name="a" value="2 m"/></plant>' for i in range(50))
    path = tmp_path / "unused.xml"
    path.write_text(text.replace("<controller ", f"{unused}<controller ", 1), encoding="utf-8")
    opened: list[Path] = []

    def counted(fmu: Path, *arguments: object) -> object:
        opened.append(fmu)
        return open_package(fmu, *arguments)  # type: ignore[arg-type]

    looked: list[Path] = []

    def as_vehicle_counted(package: Package, *arguments: object) -> object:
        looked.append(package.path)
        return as_vehicle(package, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr("cosim.fmu.vehicle.open_package", counted)
    monkeypatch.setattr("cosim.master.used_fmus.as_vehicle", as_vehicle_counted)
    command(capsys, "check", path)
    assert len(opened) == 2, "for the plant that is used, and for all others"
    assert not looked, "they have one binding and one interface"
    path.write_text(path.read_text(encoding="utf-8").replace('"2 m"', '"2 kg"'), encoding="utf-8")
    assert "'2 kg'" in failed(capsys, 2, "check", str(path)), "each plant is checked"


# Paths ------------------------------------------------------------------------------------------------------


LINE = "{line}"
"""Stands for a scenario."""
READ = [
    ["run", "{}"],
    ["run", LINE, "--plant", "clmr={}"],
    ["run", LINE, "--binding", "clmr={}"],
    ["run", LINE, "--environment", "proposed={}"],
    ["resume", "{}"],
    ["study", "{}"],
    ["show", "{}"],
    ["report", "{}"],
    ["export", "{}"],
    ["export-controller", "{}"],
    ["import", "{}.ssp"],
    ["judge", "{}", "--scenario", LINE],
    ["judge", "recorded.csv", "--scenario", LINE, "--map", "{}"],
    ["check", "{}"],
    ["check", LINE, "--untrusted", "{}/a"],
    ["inspect", "{}", "--self-test"],
    ["swap", "{}", "--plant", "clmr=a.fmu"],
    ["swap", LINE, "--plant", "clmr={}", "--no-probe"],
    ["compare-plants", "{}", "car_like"],
    ["compare-plants", "car_like", "car_like", "--torque", "{}"],
    ["compare-plants", "car_like", "car_like", "--binding-b", "{}"],
    ["env", "list", "{}"],
    ["env", "create", "made", "./{}"],
    ["env", "create", "made", "a", "--wheels", "{}"],
    ["new", "{}"],
]
"""Commands that read a file, or want another name; ``{}`` stands for its path."""


@pytest.mark.parametrize("path", [LONG_NAME, LONG_PATH, "loop", "pipe", "file/a", *ODD_NAMES, ""], ids=range(8))
@pytest.mark.parametrize("arguments", READ, ids=" ".join)
def test_paths_that_no_command_can_read(
    line: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    path: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("recorded.csv").write_text("time\n0\n")
    Path("file").write_text("")
    Path("loop").symlink_to("loop")
    if hasattr(os, "mkfifo"):
        os.mkfifo("pipe")
    before = sorted(tmp_path.iterdir())
    printed = failed(capsys, 2, *(argument.replace(LINE, line).replace("{}", path) for argument in arguments))
    assert printed.strip()
    assert not set("\x1b\u202e\udcff") & set(printed)
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize("name", [*ODD_NAMES, "[a]{b} '$x' <&%"], ids=range(3))
def test_work_in_a_folder_of_an_unusual_name(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    (tmp_path / name).mkdir()
    monkeypatch.chdir(tmp_path / name)
    short = ("--horizon", "0.4 s", "--no-expectations")
    bare = ("--no-figure", "--no-report")
    Path("mine.xml").write_bytes(Path(line).read_bytes())
    Path("seeds.xml").write_text(
        f'<study xmlns="{NAMESPACE}" name="seeds" of="mine.xml"><title>Seeds</title><vary name="end" cross="yes">'
        '<case name="a"><set select="simulation/@horizon" value="1 s"/><remove select="expect"/></case></vary>'
        '<sample method="grid"/><measure name="e" figure="rms" signal="range_error" unit="m" over="mean"/></study>'
    )
    absolute = str(Path.cwd())
    printed = ""
    for arguments in (
        ["check", "mine.xml"],
        ["run", "mine.xml", *short, *bare, "--checkpoint", "every=0.2s"],
        ["resume", f"{absolute}/runs/clmr_line", *bare, "--at", "0.2 s", "--horizon", "0.3 s", "--no-expectations"],
        ["study", "seeds.xml", "--no-figure", "--out", f"{absolute}/studies"],
        ["report", f"{absolute}/runs/clmr_line", "--out", f"{absolute}/report.html"],
        ["export", f"{absolute}/runs/clmr_line", "--out", f"{absolute}/wide.csv"],
        ["export", f"{absolute}/mine.xml", "--ssp", f"{absolute}/mine.ssp"],
        ["import", "mine.ssp", "--out", "again.xml"],
        ["build", "car_like", "--out", absolute],
        ["export-controller", "mine.xml", "--out", absolute],
        ["compare-plants", "car_like.fmu", "car_like", "--duration", "0.2 s", "--out", absolute, "--no-figure"],
    ):
        printed += "".join(command(capsys, *arguments))
    assert not set("\x1b\u202e\udcff") & set(printed)


# Messages ---------------------------------------------------------------------------------------------------


def test_a_message_quotes_at_most_a_line_of_a_value() -> None:
    value = "x y " * 1000
    assert len(brief(f"name=\"{value}\" of <a> is wrong: expected 'b'")) < 300
    assert brief(f"no robot {value!r}: known: 'a', 'b'").endswith("...': known: 'a', 'b'")
    assert brief("the FMU's text " + "is long " * 100 + "but the robot's is not")[-22:] == "but the robot's is not"
    assert brief(f'a "first line\nsecond {value}" b') == 'a "first line..." b'
    assert len(brief("p" * 5000)) < 600
    assert len(brief("'" * 1000 + "a b " * 20_000)) < 11_000
    plain = "a sentence with 'a value' and \"another one\", of usual length" * 5
    assert brief(plain) == plain


@pytest.mark.parametrize(
    "arguments",
    [
        ["--set", "9" * 5000],
        ["--set", f"//@{'a' * 5000}=1"],
        ["--set", "//title/@x=" + "a b" * 5000],
        ["--seed", "9" * 300],
    ],
)
def test_options_are_quoted_briefly(line: str, capsys: pytest.CaptureFixture[str], arguments: list[str]) -> None:
    assert len(failed(capsys, 2, "check", line, *arguments)) < 1500


def test_a_seed_of_5000_digits_as_an_option(line: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as raised:
        command(capsys, "check", line, "--seed", "9" * 5000)
    assert raised.value.code == 2
    assert len(capsys.readouterr().err) < 1500


def test_what_fails_says_cannot_steer_a_terminal(line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = changed(line, tmp_path, "<rms ", '<rms fails="a&#x9b;31m b&#x202e;c" ')
    out, err = command(capsys, "run", path, "--out", tmp_path, *SHORT, "--no-figure", status=1)
    assert "a?31m b?c" in out
    assert not set("\x9b\u202e\x1b") & set(out + err)
