"""The pytest plugin, in a pytest of its own: a folder of scenarios as a user has it."""

import re
import subprocess
import sys
from contextlib import nullcontext
from io import BytesIO
from pathlib import Path

import pytest
from lxml import etree

from cosim.scenario.document import NAMESPACE
from cosim.scenario.root_element import MAX_BYTES, UNCLEAR, root_of
from cosim.scenario.root_element import NAMESPACE as SNIFFED
from cosim.tests.studies import LAST, write_study

EXAMPLE = Path(__file__).with_name("example.xml")


def written(folder: Path, name: str, below: str = "99 m", fails: str = "", more: str = "") -> Path:
    mark = f'fails="{fails}" ' if fails else ""
    text = EXAMPLE.read_text(encoding="utf-8").replace('"100 s"', '"0.2 s"').replace('name="example"', f'name="{name}"')
    expect = f'<expect><final signal="range_error" {mark}below="{below}"/>{more}</expect></scenario>'
    path = folder / f"{name}.xml"
    path.write_text(text.replace("</scenario>", expect), encoding="utf-8")
    return path


def run_pytest(folder: Path, *arguments: str) -> tuple[int, str]:
    """Run pytest in a folder; return its exit status and what it printed."""
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-W", "error", *arguments]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=600)
    assert done.stderr == ""
    return done.returncode, done.stdout


def test_scenarios_are_tests(tmp_path: Path) -> None:
    """One process for all that can come of a scenario."""
    folder = tmp_path / "scenarios"
    folder.mkdir()
    peak = '<peak signal="range_error" below="1 mm"/>'
    written(folder, "good")
    written(folder, "bad", "1 mm")
    written(folder, "known", "1 mm", "too slow")
    written(folder, "better", "99 m", "too slow")
    written(folder, "known_and_bad", "1 mm", "too slow", peak)
    written(folder, "wrong", "1 s")
    (folder / "other.xml").write_text("<project/>")
    (folder / "broken.xml").write_text("<project")
    (folder / "test_mine.py").write_text("def test_mine():\n    assert True\n")
    status, printed = run_pytest(tmp_path, "scenarios", "-rA", "--junitxml=junit.xml")
    assert status == 1
    assert "4 failed, 2 passed, 1 xfailed" in printed
    named = {name: word for word, name in re.findall(r"^(PASSED|FAILED|XFAIL) scenarios/(\S+)", printed, re.MULTILINE)}
    assert named == {
        "good.xml::good": "PASSED",
        "test_mine.py::test_mine": "PASSED",
        "bad.xml::bad": "FAILED",
        "known.xml::known": "XFAIL",
        "better.xml::better": "FAILED",
        "known_and_bad.xml::known_and_bad": "FAILED",
        "wrong.xml::wrong": "FAILED",
    }
    assert "Traceback" not in printed
    assert not re.search(r"\.py:\d", printed), "no line of Python concerns the user"
    assert re.search(r"^scenarios/bad.xml:\d+:\d+: FAILS: final range_error below 1 mm, .* margin -", printed, re.M)
    assert re.search(r"^scenarios/better.xml:\d+:\d+: holds, though marked as failing: too slow: final", printed, re.M)
    assert re.search(
        r"^scenarios/wrong.xml:\d+:\d+: the bound of the final of 'range_error', which is in m", printed, re.M
    )
    cases = {case.get("name"): case for case in etree.parse(tmp_path / "junit.xml").iter("testcase")}
    assert {name for name, case in cases.items() if case.find("failure") is not None} == {
        "bad",
        "better",
        "known_and_bad",
        "wrong",
    }
    assert "too slow" in cases["known"].find("skipped").get("message")
    (about_one, *_) = cases["good"].iter("property")
    assert about_one.get("value").startswith("holds: ")


def test_selected_and_in_parallel(tmp_path: Path) -> None:
    for name in ("line_1", "line_2", "circle"):
        written(tmp_path, name)
    status, printed = run_pytest(tmp_path, "-n", "2", "-k", "line", "-v")
    assert status == 0
    assert "2 passed" in printed
    assert set(re.findall(r"PASSED (\S+)", printed)) == {"line_1.xml::line_1", "line_2.xml::line_2"}


def test_a_scenario_by_its_file_and_marks_ignored(tmp_path: Path) -> None:
    path = written(tmp_path, "known", "1 mm", "too slow")
    status, printed = run_pytest(tmp_path, "--runxfail", str(path))
    assert status == 1
    assert "known.xml:" in printed
    assert "fails as known: too slow" in printed


def test_files_of_others_are_left_alone(tmp_path: Path) -> None:
    bomb = '<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]><a x="&b;">&b;</a>'
    for name, data in {
        "empty.xml": b"",
        "binary.xml": bytes(range(256)),
        "other.xml": b"<scenario/>",
        "foreign.xml": b'<scenario xmlns="urn:other"/>',
        "inside.xml": f'<all><scenario xmlns="{NAMESPACE}"/></all>'.encode(),
        "prefixed.xml": f'<a xmlns:f="{NAMESPACE}"/>'.encode(),
        "encoding.xml": b'<?xml version="1.0" encoding="klingon"?><a/>',
        "bomb.xml": bomb.encode(),
        "declared.xml": f'<!DOCTYPE a><a x="{NAMESPACE}"/>'.encode(),
        "long.xml": b"<!--" + 1_000_000 * b" " + b"--><a/>",
        "schema.xml": f'<schema xmlns="http://www.w3.org/2001/XMLSchema" targetNamespace="{NAMESPACE}"/>'.encode(),
    }.items():
        (tmp_path / name).write_bytes(data)
        assert root_of(tmp_path / name) in ("", "binding"), name
    (tmp_path / "folder.xml").mkdir()
    status, printed = run_pytest(tmp_path)
    assert status == 5, "pytest's status where there is no test"
    assert "no tests ran" in printed


@pytest.mark.parametrize(
    "text",
    [
        '<scenario xmlns="{0}" name="x"/>',
        '<?xml version="1.0"?>\n<!-- {0} -->\n<f:variant xmlns:f="{0}"><f:title>',
        '<!DOCTYPE scenario [<!ENTITY a "b">]><scenario xmlns="{0}" name="&a;"/>',
        '<scenario xmlns="{0}" name=x/>',
        '<scenario xmlns="{0}">' + "<a/>" * 100_000,
        "<!--" + "notes " * 100_000 + '--><scenario xmlns="{0}"/>',
        "<!--" + "notes " * 100_000 + '<scenario xmlns="{0}"/>',
        '<scenario xmlns="urn:formation-cosim:scenario:l"/>',
        "<!--" + " " * MAX_BYTES,
    ],
)
def test_what_is_a_scenario_or_wants_to_be_one(tmp_path: Path, text: str) -> None:
    path = tmp_path / "one.xml"
    path.write_text(text.format(NAMESPACE), encoding="utf-8")
    assert root_of(path) in ("scenario", "variant", UNCLEAR)
    path.write_text(text.format(NAMESPACE), encoding="utf-16")
    assert root_of(path) in ("scenario", "variant", UNCLEAR)


def test_a_file_that_cannot_be_read_is_not_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path, "secret")

    def refuse(self: Path, *arguments: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    assert root_of(path) == UNCLEAR


def test_a_large_file_of_others_is_read_up_to_its_first_element(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "large.xml"
    path.touch()
    file = BytesIO(b"<all>" + b"<one/>" * 1_000_000)
    monkeypatch.setattr(Path, "open", lambda *_: nullcontext(file))
    assert root_of(path) == ""
    assert file.tell() < 100_000


def test_what_is_wrong_with_a_file_that_wants_to_be_a_scenario(tmp_path: Path) -> None:
    (tmp_path / "one.xml").write_text(f'<!DOCTYPE a><scenario xmlns="{NAMESPACE}"/>')
    status, printed = run_pytest(tmp_path)
    assert status == 1
    assert re.search(r"^one.xml:1:\d+: a scenario has no document type declaration", printed, re.MULTILINE)


def test_a_fault_of_ours_is_a_sentence(tmp_path: Path) -> None:
    written(tmp_path, "odd")
    written(tmp_path, "even")
    (tmp_path / "conftest.py").write_text(
        "import cosim.results.summary as s\nwhole = s.summarise\n"
        "def summarise(scenario, *others):\n"
        "    return whole(scenario, *others) if scenario.name == 'even' else [][0]\n"
        "s.summarise = summarise\n"
    )
    status, printed = run_pytest(tmp_path)
    assert status == 1
    assert "1 failed, 1 passed" in printed
    assert re.search(
        r"^odd.xml: a fault of Formation itself, IndexError: list index out of range", printed, re.MULTILINE
    )
    assert "Traceback" not in printed
    path = re.search(r"please report it, with (\S+) and", printed)
    assert path is not None
    assert "Traceback" in Path(path[1]).read_text(encoding="utf-8")
    Path(path[1]).unlink()


def test_a_mark_cannot_steer_a_terminal(tmp_path: Path) -> None:
    written(tmp_path, "known", "1 mm", "a&#x9b;31m b&#x202e;c")
    status, printed = run_pytest(tmp_path, "-rx")
    assert status == 0
    assert "a?31m b?c" in printed
    assert not set("\x9b\u202e") & set(printed)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such names")
@pytest.mark.parametrize("more", [(), ("-n", "1")], ids=["alone", "in parallel"])
def test_names_of_files_that_are_no_text_or_steer_a_terminal(tmp_path: Path, more: tuple[str, ...]) -> None:
    """They ended pytest: without JUnit XML, and in parallel without a test."""
    for name in ("a\udcff", "b\x1b[31m\u202e"):
        written(tmp_path, "own").rename(tmp_path / f"{name}.xml")
    status, said = run_pytest(tmp_path, "-v", "--junitxml=j.xml", *more)
    assert status == 0
    assert "2 passed" in said
    assert not set("\x1b\u202e\udcff") & set(said)
    assert (tmp_path / "j.xml").read_text("utf-8").count("<testcase ") == 2


def test_pytest_starts_as_fast_as_without() -> None:
    program = (
        "import cosim.pytest_plugin, sys; "
        "heavy = {'numpy', 'lxml', 'xarray', 'numba', 'fmpy', 'rich', 'cosim.master.simulation'}; "
        "print(sorted(heavy & set(sys.modules)))"
    )
    printed = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True, timeout=60)
    assert printed.stdout == "[]\n"


def test_a_study_is_a_test_that_a_suite_can_leave_out(tmp_path: Path) -> None:
    rest = LAST + '<worst of="last" below="1 mm"/>'
    write_study(tmp_path, sample='<sample method="random" runs="1"/>', rest=rest)
    (tmp_path / "base.xml").rename(tmp_path / "base.txt")
    text = (tmp_path / "study.xml").read_text()
    (tmp_path / "study.xml").write_text(text.replace("base.xml", "base.txt"))
    status, printed = run_pytest(tmp_path, "--strict-markers")
    assert status == 1
    assert re.search(r"^study.xml:5:\d+: FAILS: worst of last below 1 mm: 5\d+ mm, margin", printed, re.MULTILINE)
    status, printed = run_pytest(tmp_path, "-m", "not study")
    assert (status, "1 deselected" in printed) == (5, True)


def test_the_namespace_is_that_of_the_language() -> None:
    assert SNIFFED == NAMESPACE
