"""JUnit XML, by the structure that readers of it share, and from the command line."""

from pathlib import Path

import pytest
from lxml import etree

from cosim.cli import main
from cosim.errors import InputError, Location
from cosim.master.simulation import Simulation
from cosim.results.expectations import Verdict
from cosim.results.junit import Outcome, junit_xml
from cosim.results.summary import Summary
from cosim.tests.driving import FailsAt, watch

EXAMPLE = Path(__file__).with_name("example.xml")

# What the readers of JUnit XML agree on: those parts of Jenkins' junit-10.xsd that may occur here.
SCHEMA = etree.XMLSchema(
    etree.fromstring(
        """
<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema">
  <xs:complexType name="problem">
    <xs:simpleContent><xs:extension base="xs:string">
      <xs:attribute name="type" type="xs:string"/><xs:attribute name="message" type="xs:string"/>
    </xs:extension></xs:simpleContent>
  </xs:complexType>
  <xs:simpleType name="seconds">
    <xs:restriction base="xs:decimal"><xs:minInclusive value="0"/></xs:restriction>
  </xs:simpleType>
  <xs:attributeGroup name="counts">
    <xs:attribute name="tests" type="xs:nonNegativeInteger" use="required"/>
    <xs:attribute name="failures" type="xs:nonNegativeInteger" use="required"/>
    <xs:attribute name="errors" type="xs:nonNegativeInteger" use="required"/>
    <xs:attribute name="skipped" type="xs:nonNegativeInteger"/>
    <xs:attribute name="time" type="seconds"/>
  </xs:attributeGroup>
  <xs:element name="testsuites"><xs:complexType>
    <xs:sequence><xs:element ref="testsuite" minOccurs="0" maxOccurs="unbounded"/></xs:sequence>
    <xs:attributeGroup ref="counts"/>
  </xs:complexType></xs:element>
  <xs:element name="testsuite"><xs:complexType>
    <xs:sequence><xs:element ref="testcase" minOccurs="0" maxOccurs="unbounded"/></xs:sequence>
    <xs:attribute name="name" type="xs:string" use="required"/>
    <xs:attributeGroup ref="counts"/>
  </xs:complexType></xs:element>
  <xs:element name="testcase"><xs:complexType>
    <xs:sequence>
      <xs:choice minOccurs="0">
        <xs:element name="skipped" type="problem"/>
        <xs:element name="error" type="problem"/>
        <xs:element name="failure" type="problem"/>
      </xs:choice>
      <xs:element name="system-out" type="xs:string" minOccurs="0"/>
    </xs:sequence>
    <xs:attribute name="name" type="xs:string" use="required"/>
    <xs:attribute name="classname" type="xs:string" use="required"/>
    <xs:attribute name="time" type="seconds"/>
    <xs:attribute name="file" type="xs:string"/>
    <xs:attribute name="line" type="xs:nonNegativeInteger"/>
  </xs:complexType></xs:element>
</xs:schema>"""
    )
)


def parsed(document: bytes) -> etree._Element:
    """Return the root of a document that has the common structure and whose counts are right."""
    root = etree.fromstring(document)
    SCHEMA.assertValid(root)
    for element in (root, *root):
        for count, tag in (("tests", "testcase"), ("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
            assert int(element.get(count)) == len(list(element.iter(tag))), count
    return root


def verdict(robot: str, passed: bool, fails: str = "") -> Verdict:
    margin = 0.5 if passed else -0.5
    where = Location("base.xml", 70, 5)  # one.xml is a variant of it
    return Verdict("rms range_error below 1 m", robot, 1 - margin, 1.0, "m", margin, passed, fails, "", where)


def outcome(*verdicts: Verdict, **given: object) -> Outcome:
    summary = Summary("one", "completed", 1.0, (), None, None, (), verdicts)
    return Outcome("one", Path("one.xml"), 2.5, **{"summary": summary, **given})  # type: ignore[arg-type]


def test_a_case_for_each_verdict() -> None:
    root = parsed(junit_xml([outcome(verdict("a", True), verdict("b", False)), outcome(verdict("", True))]))
    assert root.get("time") == "5.000"
    cases = list(root[0])
    assert [case.get("name") for case in cases] == ["run", *(f"rms range_error below 1 m [{r}]" for r in "ab")]
    assert [case.get("classname") for case in cases] == ["one"] * 3
    places = [(case.get("file"), case.get("line")) for case in cases]
    assert places == [("one.xml", "1"), ("base.xml", "70"), ("base.xml", "70")]
    assert [child.tag for case in cases for child in case] == ["system-out", "failure", "system-out"]
    assert cases[2][0].get("message") == "1.5 m, margin -0.5 m (b)"
    assert root[1][1].get("name") == "rms range_error below 1 m"


def test_marks() -> None:
    root = parsed(junit_xml([outcome(verdict("a", True, "too slow"), verdict("b", False, "too slow"))]))
    (failure,) = root.iter("failure")
    assert "holds, though marked as failing: too slow" in failure.get("message")
    (skipped,) = root.iter("skipped")
    assert "fails as known: too slow" in skipped.get("message")


@pytest.mark.parametrize("error", [InputError("no such file", Location("one.xml")), KeyboardInterrupt()])
def test_errors(error: BaseException) -> None:
    root = parsed(junit_xml([outcome(summary=None, error=error)]))
    (told,) = root.iter("error")
    assert told.get("type") == type(error).__name__
    assert told.get("message") == (str(error) or "the run was ended")


def test_no_scenario_at_all() -> None:
    assert len(parsed(junit_xml([]))) == 0


def test_any_text() -> None:
    """Characters that XML cannot hold, in names and messages from files and from foreign code."""
    nasty = '\x00\x1b[31m\ud800\ufffe<&"]]>\U0001f600\n'
    error = InputError(nasty, Location(f"{nasty}.xml", 3))
    root = parsed(junit_xml([outcome(verdict(nasty, False, nasty), error=error)]))
    shown = '\ufffd\ufffd[31m\ufffd\ufffd<&"]]>\U0001f600'
    assert shown in root[0][0][0].get("message")
    assert shown in root[0][1].get("name")


# The command line -------------------------------------------------------------------------------------------


def written(folder: Path, name: str, below: str, fails: str = "") -> str:
    mark = f'fails="{fails}" ' if fails else ""
    text = EXAMPLE.read_text(encoding="utf-8").replace('"100 s"', '"0.2 s"').replace('name="example"', f'name="{name}"')
    expect = f'<expect><final signal="range_error" {mark}below="{below}"/></expect></scenario>'
    path = folder / f"{name}.xml"
    path.write_text(text.replace("</scenario>", expect), encoding="utf-8")
    return str(path)


def test_all_scenarios_of_a_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    watch(monkeypatch, FailsAt(5, ZeroDivisionError("no such luck")), lambda scenario: scenario.name == "broken")
    good, known = written(tmp_path, "good", "99 m"), written(tmp_path, "known", "1 mm", "too slow")
    wrong, broken = written(tmp_path, "wrong", "1 s"), written(tmp_path, "broken", "99 m")
    file = tmp_path / "reports" / "junit.xml"
    arguments = ["--out", str(tmp_path / "runs"), "--no-figure", "--junit", str(file)]
    assert main(["run", good, known, wrong, broken, "none.xml", *arguments]) == 3
    root = parsed(file.read_bytes())
    assert [suite.get("name") for suite in root] == ["good", "known", "wrong", "broken", "none"]
    assert [[child.get(n) for n in ("tests", "failures", "errors", "skipped")] for child in root] == [
        ["5", "0", "0", "0"],
        ["5", "0", "0", "4"],
        ["1", "0", "1", "0"],
        ["1", "0", "1", "0"],
        ["1", "0", "1", "0"],
    ]
    errors = [error.get("message") for error in root.iter("error")]
    assert errors[0].startswith(f"{wrong}:")
    assert "no such luck" in errors[1]
    assert float(root.get("time")) > 0
    printed = capsys.readouterr().out
    assert "holds  final range_error below 99 m" in printed
    assert "fails as known: too slow  final range_error below 1 mm" in printed


def test_what_is_known_to_fail_fails_all_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--out", str(tmp_path), "--no-figure"]
    assert main(["run", written(tmp_path, "known", "1 mm", "too slow"), *arguments]) == 1
    assert main(["run", written(tmp_path, "better", "99 m", "too slow"), *arguments]) == 0
    assert "holds, though marked as failing: too slow  final range_error" in capsys.readouterr().out


def test_a_file_that_cannot_be_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").touch()
    path = written(tmp_path, "good", "99 m")
    assert main(["run", path, "--out", str(tmp_path), "--junit", str(tmp_path / "file" / "junit.xml")]) == 2
    assert "choose another --junit" in capsys.readouterr().err
    assert not (tmp_path / "good").exists(), "that is known before anything is computed"


def test_an_interrupted_command_writes_what_it_knows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "junit.xml"
    good, other = written(tmp_path, "good", "99 m"), written(tmp_path, "other", "99 m")
    original = Simulation.__init__

    def interrupted(self: Simulation, scenario: object, *more: object, **options: object) -> None:
        if getattr(scenario, "name", "") == "other":
            raise KeyboardInterrupt
        original(self, scenario, *more, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(Simulation, "__init__", interrupted)
    assert main(["run", good, other, "--out", str(tmp_path), "--no-figure", "--junit", str(file)]) == 130
    assert [suite.get("errors") for suite in parsed(file.read_bytes())] == ["0", "1"]
