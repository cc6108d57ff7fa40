"""The documentation names things that exist."""

import json
import re
import runpy
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from lxml import etree

import cosim
import plants
from cosim.cli import main
from cosim.master.setup import set_up
from cosim.results.expectations import understood
from cosim.scenario.grammar import NAMESPACE, attributes_of, children_of, local_name
from cosim.scenario.reader import read_scenario
from cosim.scenario.scenario import Scenario
from cosim.studies.plan import Plan
from cosim.studies.read_keep import check_keep
from cosim.studies.reader import read_study
from cosim.studies.requirements import requirements_of

from .foreign.vehicles import require
from .stub.stub import make_fmu

ROOT = Path(__file__).parents[1]
SCENARIOS_PAGE = (ROOT / "docs" / "scenarios.md").read_text(encoding="utf-8")
STUDIES_PAGE = (ROOT / "docs" / "studies.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"^```xml\n(.*?)^```$", SCENARIOS_PAGE, re.MULTILINE | re.DOTALL)
ROBOTS_PAGE = (ROOT / "docs" / "robot_tools.md").read_text(encoding="utf-8")
ROBOT_EXAMPLES = re.findall(r"^```xml\n(.*?)^```$", ROBOTS_PAGE, re.MULTILINE | re.DOTALL)
STUDY_EXAMPLES = re.findall(r"^```xml\n(.*?)^```$", STUDIES_PAGE, re.MULTILINE | re.DOTALL)
SCENARIO_EXAMPLES = [example for example in EXAMPLES if not example.startswith("<binding")]
XS = "{http://www.w3.org/2001/XMLSchema}"

# What is called otherwise in one of the FMUs on the page.
ROVER = {
    "x": "pos_x",
    "y": "pos_y",
    "psi": "heading",
    "psi0": "heading0",
    "gamma": "steer",
    "gamma0": "steer0",
    "v": "speed",
    "omega": "steer_rate",
    "tau_drive": "drive_force",
    "tau_steer": "steer_torque",
    "a": "wheelbase",
}

# What the pieces on the page leave out.
REST = f"""<scenario xmlns="{NAMESPACE}" name="rest">
  <title>The rest</title>
  <simulation horizon="100 s" step="20 ms" seed="1"/>
  <plant id="clmr" model="car_like"/>
  <plant id="truck" model="tractor_trailer"/>
  <controller id="pid" name="neural-adaptive-pid" package="formation-controllers" version="~=0.1.0"/>
  <leader plant="clmr"><pose x="2.5 m" y="5.5 m" psi="0 deg" gamma="0 deg"/><torque tau_drive="8 N.m"/></leader>
  <follower id="follower_1" plant="clmr" controller="pid">
    <pose x="-5 m" y="0 m" psi="0 deg" gamma="0 deg"/><desired range="3 m" bearing="45 deg"/>
  </follower>
  <follower id="follower_2" plant="clmr" controller="pid">
    <pose x="-5 m" y="10 m" psi="0 deg" gamma="0 deg"/><desired range="3 m" bearing="-45 deg"/>
  </follower>
</scenario>"""


def test_the_page_on_results_names_every_variable_and_attribute(short_line: Scenario) -> None:
    result = cosim.run(short_line)
    named = set(re.findall(r"`(\w+)`", (ROOT / "docs" / "results.md").read_text(encoding="utf-8")))
    telemetry = set(re.findall(r"`(\w+)`", (ROOT / "controllers" / "README.md").read_text(encoding="utf-8")))
    components = {name for name in result.coords if str(name).endswith(("_component", "_component_units"))}
    assert set(result.data_vars) <= named | telemetry
    assert set(result.coords) - components <= named
    assert set(result.attrs) <= named


def test_the_verdict_on_the_page_on_results_is_of_the_expectation_at_its_place() -> None:
    page = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    (shown,) = map(json.loads, re.findall(r"```json\n(.*?)```", page, re.DOTALL))
    place = shown["where"]
    (found,) = (
        expectation
        for expectation in read_scenario(ROOT / place["file"]).expectations
        if (expectation.where.line, expectation.where.column) == (place["line"], place["column"])
    )
    assert understood(found).text == shown["expectation"]


def test_links_between_pages_lead_somewhere() -> None:
    pages = [*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("controllers/*.md"), *ROOT.glob("plants/**/*.md")]
    assert len(pages) > 5
    for page in pages:
        for target in re.findall(r"\]\((?!https?:)([^)#]+)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


def test_rows_of_tables_fit_a_page() -> None:
    pages = [
        page
        for folder in ("", "docs", "controllers", "plants", "plants/*", "examples/*")
        for page in ROOT.glob(f"{folder}/*.md".lstrip("/"))
    ]
    rows = [
        (page.name, line) for page in pages for line in page.read_text("utf-8").splitlines() if line.startswith("|")
    ]
    assert len(rows) > 300
    assert [(name, line) for name, line in rows if len(line) > 120] == []


def shown_commands() -> Iterator[str]:
    """Return every command line of ``formation`` that a page shows, in a line of its own or within a sentence."""
    for page in [ROOT / "README.md", *sorted(ROOT.glob("docs/*.md"))]:
        text = page.read_text(encoding="utf-8")
        blocks = "\n".join(re.findall(r"^```(?:sh|text|yaml)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL))
        lines = re.findall(r"^ *(?:- run: )?(?:.*&& )?(formation .+)$", blocks, re.MULTILINE)
        shown = [*lines, *re.findall(r"`(formation [^`\n]+)`", text)]
        told = dict.fromkeys(command.split("&&")[0] for command in shown)
        yield from (command for command in told if command.split()[1] != "COMMAND")  # which stands for any of them


@pytest.mark.parametrize("command", dict.fromkeys(shown_commands()))
def test_every_command_shown_is_one(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = [word for word in shlex.split(command, comments=True) if word not in (">", "...")][1:]
    known = set(re.findall(r"[a-z-]+", _help(["--help"], capsys).partition("commands:")[2]))
    assert words[0] in known
    usage = _help([words[0], "--help"], capsys)
    assert all(word in usage for word in words if word.startswith("--"))


def _help(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 0
    return capsys.readouterr().out


# The scenario language --------------------------------------------------------------------------------------


@pytest.fixture
def folder(scenarios: Path, tmp_path: Path) -> Path:
    """Return a copy of the scenarios, with the files that the page names."""
    copied = Path(shutil.copytree(scenarios, tmp_path / "scenarios", ignore=shutil.ignore_patterns("__pycache__")))
    (table,) = re.findall(r"^```csv\n(.*?)^```$", SCENARIOS_PAGE, re.MULTILINE | re.DOTALL)
    (copied / "wind.csv").write_text(table, encoding="utf-8")
    (binding,) = (example for example in EXAMPLES if example.startswith("<binding"))
    (copied / "vendor.binding.xml").write_text(binding, encoding="utf-8")
    plants.build("car_like", out=copied / "fmus").rename(copied / "fmus" / "my_robot.fmu")
    make_fmu(copied / "fmus", name="vendor", fmi="3.0", interface="both", arrays=True)
    make_fmu(copied / "fmus", name="rover", units="none", initial="parameters", drive=False, names=ROVER)
    make_fmu(copied / "fmus", name="with_gears", discrete=True)
    return copied


def completed(example: str) -> str:
    """Return an example from the page as a whole scenario: where it is a piece of one, with the rest."""
    if "<scenario" in example or "<variant" in example:
        return example
    root = etree.fromstring(REST)
    pieces = etree.fromstring(f'<pieces xmlns="{NAMESPACE}">{example}</pieces>')
    for piece in pieces:
        for other in root.findall(piece.tag):
            if other.get("id") == piece.get("id"):
                root.remove(other)
    elements = sorted([*root, *pieces], key=lambda element: children_of("scenario")[local_name(element)])
    root[:] = elements
    return etree.tostring(root, encoding="unicode")


def used() -> Iterator[etree._Element]:
    """Return every element of every example."""
    for example in EXAMPLES + STUDY_EXAMPLES + ROBOT_EXAMPLES:
        content = re.sub(r"<\?xml.*?\?>", "", example)
        yield from etree.fromstring(f'<pieces xmlns="{NAMESPACE}">{content}</pieces>').iterdescendants("*")


@pytest.mark.parametrize("example", SCENARIO_EXAMPLES, ids=range(len(SCENARIO_EXAMPLES)))
def test_every_example_can_be_run(folder: Path, example: str) -> None:
    path = folder / "example.xml"
    path.write_text(completed(example), encoding="utf-8")
    scenario = read_scenario(path)
    assert scenario.followers
    with ExitStack() as cleanup:
        assert set_up(scenario, cleanup, {}).followers


def test_what_tells_an_editor_where_the_schema_is_can_be_read(tmp_path: Path) -> None:
    old = f'<scenario xmlns="{NAMESPACE}" name="first">'
    heads = re.findall(r"^```text\n(.*?)\n```$", SCENARIOS_PAGE, re.MULTILINE | re.DOTALL)
    assert len(heads) == 2
    assert old in EXAMPLES[0]
    path = tmp_path / "first.xml"
    for head in heads:
        path.write_text(EXAMPLES[0].replace(old, head), encoding="utf-8")
        assert read_scenario(path).name == "first"
        assert "scenario-1.xsd" in read_scenario(path).text


def test_the_page_has_an_example_of_every_element_and_names_every_attribute() -> None:
    assert len(EXAMPLES) > 12
    elements = list(used())
    schema = etree.parse(ROOT / "cosim" / "schema" / "scenario-1.xsd")
    tags = {element.get("name") for element in schema.iter(XS + "element")}
    assert {local_name(element) for element in elements} == tags
    shown = {(local_name(element), name) for element in elements for name in element.attrib}
    prose = re.sub(r"^```.*?^```$", "", SCENARIOS_PAGE + STUDIES_PAGE + ROBOTS_PAGE, flags=re.MULTILINE | re.DOTALL)
    for tag in tags:
        for name in attributes_of(tag):
            assert (tag, name) in shown or re.search(rf"`[^`]*\b{name}\b[^`]*`", prose), f"{name} of <{tag}>"


def test_the_examples_of_a_study_make_one(tmp_path: Path) -> None:
    files = [example for example in STUDY_EXAMPLES if "<study" in example]
    for example in files:
        name = re.findall(r'<study [^>]*name="(\w+)"', example)[0]
        assert example == (ROOT / "studies" / f"{name}.xml").read_text(encoding="utf-8")
    whole = files[0]
    parts = [example for example in STUDY_EXAMPLES if example not in files]
    of = (ROOT / "scenarios").as_posix()
    place = re.escape('<sample method="sobol" runs="512"/>')
    head, tail = re.split(place, whole)
    payload, law, measures, requirements, given, keep, by_case, *_ = parts
    head = re.sub(r"<vary.*</vary>", lambda _: payload + law, head, flags=re.DOTALL)
    (envelopes,) = (part for part in parts if part.startswith("<envelope"))
    tail = tail.replace("  <envelope", measures + envelopes + "  <envelope", 1)
    tail = tail.replace("  <probability", requirements + given + "  <probability").replace('"settling"', '"settled"', 1)
    path = tmp_path / "study.xml"
    tail = tail.replace("</study>", f"{keep}</study>")
    path.write_text(f"{head}<sample method='random' runs='50'/>{tail}".replace("../scenarios", of), encoding="utf-8")
    study = read_study(path)
    assert len(Plan(study)) == 150
    check_keep(study, 150)
    assert len(requirements_of(study)) == 9
    assert len(study.envelopes) == 7
    seed = '<vary name="seed" select="simulation/@seed"><count from="1"/></vary>'
    tune = (
        '<tune values="k_d sigma K_1" evaluations="4" training="1" held_out="2" confidence="0.9"><cost of="r"/></tune>'
        '<measure name="r" figure="rms" signal="range_error" unit="m"/>'
    )
    text = head.split("</title>")[0] + "</title>" + by_case + seed + tune + "</study>"
    path.write_text(text.replace("../scenarios", of), encoding="utf-8")
    assert len(read_study(path).bases) == 2


def test_the_schema_documents_all_that_it_defines() -> None:
    schema = etree.parse(ROOT / "cosim" / "schema" / "scenario-1.xsd").getroot()
    defined = [*schema.iter(XS + "complexType", XS + "simpleType", XS + "attribute")]
    types = {kind.get("name"): kind for kind in schema.iterchildren(XS + "complexType")}
    defined += [e for e in schema.iterdescendants(XS + "element") if e.get("type") not in types]
    assert len(defined) > 100
    for item in defined:
        assert item.findtext(f"{XS}annotation/{XS}documentation", "").strip(), (
            f"{item.get('name')}, line {item.sourceline}"
        )


def test_all_elements_of_a_name_are_of_one_type() -> None:
    """Messages about an element rest on it."""
    schema = etree.parse(ROOT / "cosim" / "schema" / "scenario-1.xsd")
    types = {(element.get("name"), element.get("type")) for element in schema.iter(XS + "element")}
    assert len(types) == len(dict(types))


# Plants made elsewhere --------------------------------------------------------------------------------------


def test_the_page_on_plants_made_elsewhere(
    scenarios: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its commands and files, in their order: `swap` writes the binding as shown, then it is filled in."""
    require("pythonfmu")
    page = (ROOT / "docs" / "plants.md").read_text(encoding="utf-8")
    shutil.copytree(scenarios, tmp_path / "scenarios", ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "tests" / "foreign").mkdir(parents=True)
    shutil.copy(ROOT / "tests" / "foreign" / "rover.py", tmp_path / "tests" / "foreign")
    monkeypatch.chdir(tmp_path)
    binding = tmp_path / "scenarios" / "Rover.binding.xml"
    done = []
    for language, block in re.findall(r"^```(\w+)\n(.*?)^```$", page, re.MULTILINE | re.DOTALL):
        if language == "sh":
            for line in block.splitlines():
                program, *arguments = shlex.split(line)
                done.append(" ".join([program, *arguments[:1]]))
                if program == "formation":
                    assert main(arguments) == 0, capsys.readouterr().err
                elif program != "pip":
                    subprocess.run([sys.executable, "-m", program, *arguments], check=True, timeout=120)
        elif block.startswith("<?xml"):
            assert main(["check", "scenarios/clmr_line_Rover.xml"]) == 2
            binding.write_text(block, encoding="utf-8")
        elif language == "xml":
            assert " ".join(block.split()) in " ".join(binding.read_text(encoding="utf-8").split())
        elif language == "python":
            exec(block, {})
            assert "'gamma': '0.0" in capsys.readouterr().out
    assert done == [
        "pip install",
        "pythonfmu build",
        "formation inspect",
        "formation swap",
        "formation compare-plants",
        "formation check",
        "formation run",
    ]


def test_the_python_of_the_readme_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    (code,) = re.findall(r"^```python\n(.*?)^```$", (ROOT / "README.md").read_text(encoding="utf-8"), re.M | re.S)
    names: dict[str, Any] = {}
    exec(code, names)
    assert names["simulation"].finished
    torque = names["result"].torque.sel(robot="follower_3")
    assert (torque.sel(time=slice(40.0, 41.99)) == [-5.0, 0.0]).all()
    assert not (torque.sel(time=slice(42.0, 44.0)) == [-5.0, 0.0]).any()


def test_the_index_names_every_page() -> None:
    index = (ROOT / "docs" / "README.md").read_text(encoding="utf-8")
    assert [page.name for page in ROOT.glob("docs/*.md") if f"({page.name})" not in index] == ["README.md"]


def test_the_page_on_the_architecture_names_every_room() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    rooms = [folder.name for folder in (ROOT / "cosim").iterdir() if (folder / "__init__.py").exists()]
    assert [room for room in rooms if f"| `{room}` |" not in page] == []
    for path in re.findall(r"`([\w.]+(?:/[\w.]+)+)`", page):
        assert any((folder / path).exists() for folder in (ROOT, ROOT / "cosim")), path


def test_the_rooms_are_drawn_from_the_imports_as_they_are() -> None:
    rooms = runpy.run_path(str(ROOT / "studies" / "rooms.py"))
    arrows = rooms["known"]()
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    drawn = (ROOT / "docs" / "figures" / "rooms.svg").read_bytes()
    assert rooms["with_table"](page, arrows) == page, "python studies/rooms.py writes the table anew"
    assert rooms["picture"](arrows) == drawn, "python studies/rooms.py draws the picture anew"
    assert max(rooms["floors"](arrows).values()) < 9
