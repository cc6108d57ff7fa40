"""Model descriptions that break a rule of FMI are read as far as possible, and the broken rules are listed."""

import re
from pathlib import Path

import pytest
from lxml import etree

from cosim.cli import main
from cosim.errors import InputError
from cosim.fmu.description import shortened, summed_up
from cosim.fmu.package import open_package
from cosim.fmu.vehicle import open_fmu
from tests.stub.stub import make_fmu

from .test_fmu_archive import entries, zipped


def changed(path: Path, out: Path, *replacements: tuple[str, str]) -> Path:
    content = entries(path)
    xml = content["modelDescription.xml"].decode()
    for old, new in replacements:
        assert old in xml
        xml = xml.replace(old, new)
    return zipped(out, {**content, "modelDescription.xml": xml.encode()})


BREACHES = {
    "an unknown element": ("3.0", ("<ModelVariables>", "<Extra/><ModelVariables>")),
    "annotations": ("3.0", ("</ModelStructure>", '</ModelStructure><Annotations><Note type="x"/></Annotations>')),
    "an unknown attribute": ("2.0", ('name="tau_drive"', 'name="tau_drive" previous="3"')),
    "a capability in the root": ("2.0", ("<fmiModelDescription ", '<fmiModelDescription needsExecutionTool="false" ')),
    "a date of its own": ("2.0", ("<fmiModelDescription ", '<fmiModelDescription generationDateAndTime="1.4.2024" ')),
}


@pytest.mark.parametrize("breach", BREACHES)
def test_breaches_of_the_schema_are_warnings(tmp_path: Path, breach: str, capsys: pytest.CaptureFixture[str]) -> None:
    fmi, replacement = BREACHES[breach]
    path = changed(make_fmu(tmp_path, fmi=fmi), tmp_path / "a.fmu", replacement)
    fmu = open_fmu(path)
    fmu.close()
    assert any(re.match(r"line \d+: (Element|Attribute|The attribute)", problem) for problem in fmu.problems)
    assert main(["inspect", str(path)]) == 0
    assert "a.fmu breaks a rule of FMI: line " in capsys.readouterr().err
    assert main(["inspect", "--strict", str(path)]) == 2
    printed = capsys.readouterr()
    assert "it can be driven as it is" in printed.out
    assert "breaks rules of FMI, which --strict refuses" in printed.err


def test_check_warns_or_refuses_and_run_refuses_on_request(
    tmp_path: Path, scenarios: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = changed(make_fmu(tmp_path), tmp_path / "a.fmu", BREACHES["a date of its own"][1])
    text = (scenarios / "convoy.xml").read_text("utf-8")
    scenario = tmp_path / "convoy.xml"
    scenario.write_text(re.sub(r"    <parameter [^>]*/>\n", "", text), "utf-8")
    arguments = ["check", str(scenario), "--plant", f"car={path}"]
    assert main(arguments) == 0
    assert "a.fmu breaks a rule of FMI: line " in capsys.readouterr().err
    assert main([*arguments, "--strict"]) == 2
    assert "which --strict refuses" in capsys.readouterr().err
    assert main(["run", *arguments[1:], "--strict", "--out", str(tmp_path / "runs")]) == 2
    assert "which --strict refuses" in capsys.readouterr().err
    assert not (tmp_path / "runs").exists()  # nothing has been started


def test_our_own_fmus_break_no_rule(tmp_path: Path) -> None:
    import plants

    for model in plants.models():
        for fmi in ("2", "3"):
            package = open_package(plants.build(model, fmi=fmi))
            package.close()
            assert package.problems == ()


def test_equal_problems_are_told_once() -> None:
    problems = [f'The unit "kg" of variable "m{i}" (line {i}) is not defined.' for i in range(40)]
    assert summed_up([*problems, "another"]) == [f"{problems[0]} (39 more like it)", "another"]
    assert len(shortened("name, " * 3000)) == 300


@pytest.mark.parametrize(
    ("name", "legal"),
    [
        ("a", True),
        ("axle[2,3].wheel_1.'x y'[1].der", True),
        ("der(axle[1].v,2)", True),
        (r"'it\'s'", True),
        ("2a", False),
        ("a.", False),
        ("a b", False),
        ("a[]", False),
        ("der(a", False),
        ("a" * 5000 + "!", False),
    ],
)
def test_structured_names(tmp_path: Path, name: str, legal: bool) -> None:
    convention = ("<fmiModelDescription ", '<fmiModelDescription variableNamingConvention="structured" ')
    stub = make_fmu(tmp_path, names={"v": name})
    if 'variableNamingConvention="' in entries(stub)["modelDescription.xml"].decode():
        convention = ('variableNamingConvention="flat"', 'variableNamingConvention="structured"')
    package = open_package(changed(stub, tmp_path / "a.fmu", convention))
    package.close()
    assert [p for p in package.problems if "naming convention" in p] == [
        f'"{name}" (line {v.sourceline}) is not a legal variable name for naming convention "structured"'
        for v in package.description.modelVariables
        if v.name == name and not legal
    ]


@pytest.mark.parametrize(
    ("fmi", "replacement", "said"),
    [
        (
            "2.0",
            ('index="1"', 'index="99"'),
            r"line \d+: the attribute index of <Unknown> refers to the variable number ",
        ),
        ("2.0", ("<Real ", '<Real derivative="99" '), r"line \d+: the attribute derivative of <Real> refers to the "),
        (
            "3.0",
            ('<Output valueReference="1"', '<Output valueReference="99"'),
            "valueReference of <Output> refers to the ",
        ),
        (
            "3.0",
            ('<Output valueReference="1" dependencies="', '<Output valueReference="1" dependencies="99 '),
            "dependencies of <Output>",
        ),
        ("3.0", ('<Output valueReference="1"', "<Output"), "The attribute 'valueReference' is required but missing"),
    ],
)
def test_references_that_lead_nowhere(tmp_path: Path, fmi: str, replacement: tuple[str, str], said: str) -> None:
    path = changed(make_fmu(tmp_path, fmi=fmi), tmp_path / "a.fmu", replacement)
    with pytest.raises(InputError, match=said) as caught:
        open_package(path)
    assert "list index" not in str(caught.value)
    assert "99" in str(caught.value) or "missing" in said


def test_a_description_is_parsed_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It may have a hundred thousand variables."""
    stub, parsed, parse = make_fmu(tmp_path), [], etree.parse

    def counted(source: object, *more: object) -> object:
        parsed.append(str(source))
        return parse(source, *more)

    monkeypatch.setattr(etree, "parse", counted)
    assert main(["inspect", str(stub)]) == 0
    assert "variable communication step" in " ".join(capsys.readouterr().out.split())
    assert len([name for name in parsed if name.endswith("modelDescription.xml")]) == 1
