"""The reader of model descriptions, compared with FMPy's."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import fmpy
import pytest
from fmpy import validation
from lxml import etree

from cosim.fmu.description import PARSER
from cosim.fmu.description_reader import description_of
from tests.stub.stub import Options, description

TEXTS = (
    "fmiVersion",
    "modelName",
    "guid",
    "description",
    "author",
    "version",
    "copyright",
    "license",
    "generationTool",
    "generationDateAndTime",
    "variableNamingConvention",
    "numberOfContinuousStates",
    "numberOfEventIndicators",
)
INTERFACES = ("coSimulation", "modelExchange", "scheduledExecution")
FLAGS = ["modelIdentifier", "needsExecutionTool", "canBeInstantiatedOnlyOncePerProcess"]
VARIABLE = (
    "name",
    "valueReference",
    "type",
    "causality",
    "variability",
    "initial",
    "start",
    "unit",
    "displayUnit",
    "min",
    "max",
    "description",
    "sourceline",
    "intervalVariability",
    "shape",
)
STRUCTURE = ("outputs", "derivatives", "clockedStates", "eventIndicators", "initialUnknowns")

EVERYTHING_OF_FMI_3 = """<?xml version="1.0"?>
<fmiModelDescription fmiVersion="3.0" modelName="everything" instantiationToken="{1}" description="says all"
  author="a" version="1" copyright="c" license="l" generationTool="g" generationDateAndTime="2026-01-01T00:00:00Z"
  variableNamingConvention="structured">
  <ModelExchange modelIdentifier="me" needsCompletedIntegratorStep="true"/>
  <CoSimulation modelIdentifier="cs" canHandleVariableCommunicationStepSize="true" fixedInternalStepSize="0.01"/>
  <ScheduledExecution modelIdentifier="se" needsExecutionTool="true"/>
  <UnitDefinitions>
    <Unit name="rad/s"><BaseUnit rad="1" s="-1"/><DisplayUnit name="deg/s" factor="57.3"/></Unit>
    <Unit name="odd"/>
    <Unit name="K"><BaseUnit K="1" factor="2" offset="3"/></Unit>
  </UnitDefinitions>
  <TypeDefinitions>
    <Float64Type name="Rate" unit="rad/s" min="-3" max="3"/>
    <EnumerationType name="Gear"><Item name="low" value="1"/><Item name="high" value="4"/></EnumerationType>
  </TypeDefinitions>
  <DefaultExperiment startTime="0" stopTime="2" tolerance="1e-5" stepSize="0.02"/>
  <ModelVariables>
    <!-- a comment -->
    <Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>
    <UInt64 name="n" valueReference="1" causality="structuralParameter" variability="fixed" start="3"/>
    <Float64 name="x" valueReference="2" declaredType="Rate" initial="exact" start="1 2 3">
      <Dimension valueReference="1"/><Alias name="x.again" description="another" displayUnit="deg/s"/><Alias name="y"/>
    </Float64>
    <Float64 name="der(x)" valueReference="3" derivative="2" initial="calculated">
      <Dimension valueReference="1"/>
    </Float64>
    <Float32 name="m" valueReference="4" causality="input" start="0 0 0 0 0 0" unit="K" displayUnit="K">
      <Dimension start="2"/><Dimension start="3"/>
    </Float32>
    <Enumeration name="gear" valueReference="5" causality="parameter" start="4" declaredType="Gear"/>
    <String name="text" valueReference="6" causality="parameter" variability="fixed"><Start value="hello"/></String>
    <Binary name="blob" valueReference="7" causality="input"><Start value="00ff"/></Binary>
    <Clock name="tick" valueReference="8" causality="input" intervalVariability="triggered"/>
    <Int32 name="sampled" valueReference="9" causality="output" clocks="8" min="-1" max="7"/>
    <Boolean name="on" valueReference="10" causality="calculatedParameter" variability="tunable"/>
    <Float64 name="z" valueReference="11" causality="output"/>
  </ModelVariables>
  <ModelStructure>
    <Output valueReference="9"/>
    <Output valueReference="11" dependencies="2 4" dependenciesKind="constant dependent"/>
    <ContinuousStateDerivative valueReference="3" dependencies="" dependenciesKind=""/>
    <ClockedState valueReference="9"/>
    <InitialUnknown valueReference="3"/>
    <EventIndicator valueReference="11"/>
  </ModelStructure>
</fmiModelDescription>
"""
EVERYTHING_OF_FMI_2 = """<?xml version="1.0"?>
<fmiModelDescription fmiVersion="2.0" modelName="everything" guid="{2}" numberOfEventIndicators="5">
  <ModelExchange modelIdentifier="me" completedIntegratorStepNotNeeded="true"/>
  <CoSimulation modelIdentifier="cs" canBeInstantiatedOnlyOncePerProcess="true"/>
  <UnitDefinitions><Unit name="m"><BaseUnit m="1"/><DisplayUnit name="mm" factor="1000"/></Unit></UnitDefinitions>
  <TypeDefinitions>
    <SimpleType name="Gear">
      <Enumeration><Item name="low" value="1"/><Item name="high" value="4"/></Enumeration>
    </SimpleType>
    <SimpleType name="Length"><Real unit="m" min="0"/></SimpleType>
  </TypeDefinitions>
  <ModelVariables>
    <ScalarVariable name="x" valueReference="0" initial="approx" description="a state">
      <Real declaredType="Length" displayUnit="mm" start="1"/>
    </ScalarVariable>
    <ScalarVariable name="der(x)" valueReference="1"><Real derivative="1"/></ScalarVariable>
    <ScalarVariable name="gear" valueReference="2" causality="parameter" variability="fixed">
      <Enumeration declaredType="Gear" start="1"/>
    </ScalarVariable>
    <ScalarVariable name="out" valueReference="3" causality="output"><Real unit="m" max="9"/></ScalarVariable>
  </ModelVariables>
  <ModelStructure>
    <Outputs><Unknown index="4" dependencies="1 2" dependenciesKind="dependent fixed"/></Outputs>
    <Derivatives><Unknown index="2" dependencies=""/></Derivatives>
    <InitialUnknowns><Unknown index="1"/><Unknown index="4"/></InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>
"""


CASES = {
    "everything of FMI 3.0": EVERYTHING_OF_FMI_3,
    "everything of FMI 2.0": EVERYTHING_OF_FMI_2,
    **{
        f"a stub of FMI {fmi}, {interface}": description(Options(fmi=fmi, interface=interface))
        for fmi in ("1.0", "2.0", "3.0")
        for interface in ("co_simulation", "model_exchange")
    },
}


@pytest.mark.parametrize("text", CASES.values(), ids=CASES.keys())
def test_it_reads_what_fmpy_reads(text: str, tmp_path: Path) -> None:
    (tmp_path / "modelDescription.xml").write_text(text, encoding="utf-8")
    theirs: Any = fmpy.read_model_description(str(tmp_path), validate=False)
    own = description_of(etree.fromstring(text.encode(), PARSER))
    assert [getattr(own, name) for name in TEXTS] == [getattr(theirs, name) for name in TEXTS]
    for name in INTERFACES:
        found, expected = getattr(own, name), getattr(theirs, name)
        assert (found is None) == (expected is None)
        for flag in FLAGS if found is not None else ():
            assert getattr(found, flag) == getattr(expected, flag)
    assert table(own.modelVariables, VARIABLE) == table(theirs.modelVariables, VARIABLE)
    for name in ("derivative", "alias"):
        assert names(getattr(v, name) for v in own.modelVariables) == names(
            getattr(v, name) for v in theirs.modelVariables
        )
    assert [names(v.clocks) for v in own.modelVariables] == [names(v.clocks or ()) for v in theirs.modelVariables]
    for name in STRUCTURE:
        assert structure(getattr(own, name)) == structure(getattr(theirs, name))
    types = [v.declaredType for v in own.modelVariables], [v.declaredType for v in theirs.modelVariables]
    assert table(filter(None, types[0]), ("name", "unit", "min", "max")) == table(
        filter(None, types[1]), ("name", "unit", "min", "max")
    )
    assert [table(t.items, ("name", "value")) for t in types[0] if t] == [
        table(t.items, ("name", "value")) for t in types[1] if t
    ]
    bases = ["kg", "m", "s", "A", "K", "mol", "cd", "rad", "factor", "offset"]
    for unit, expected in zip(own.unitDefinitions, theirs.unitDefinitions, strict=True):
        assert unit.name == expected.name
        assert table(unit.displayUnits, ("name",)) == table(expected.displayUnits, ("name",))
        assert table(filter(None, [unit.baseUnit]), bases) == table(filter(None, [expected.baseUnit]), bases)
    assert validation.validate_model_description(own, validate_model_structure=True) == (
        validation.validate_model_description(theirs, validate_model_structure=True)
    )


def table(objects: Iterable[Any], attributes: Iterable[str]) -> list[list[Any]]:
    """Return attributes of objects, with lists as tuples."""
    values = [[getattr(one, name) for name in attributes] for one in objects]
    return [[tuple(value) if isinstance(value, list) else value for value in row] for row in values]


def names(objects: Iterable[Any]) -> list[str | None]:
    return [None if one is None else one.name for one in objects]


def structure(unknowns: Iterable[Any]) -> list[Any]:
    return [
        (u.variable.name, None if u.dependencies is None else names(u.dependencies), u.dependenciesKind, u.sourceline)
        for u in unknowns
    ]


@pytest.mark.parametrize("fmi", ["1.0", "2.0", "3.0"])
def test_aliases_have_one_identity(fmi: str) -> None:
    text = description(Options(fmi=fmi, discrete=True, aliases={"wheelbase": "a"}))
    read = description_of(etree.fromstring(text.encode(), PARSER))
    names: dict[tuple[str, int], list[str]] = {}
    for variable in read.modelVariables:
        names.setdefault(variable.identity, []).append(variable.name)
    assert [same for same in names.values() if len(same) > 1] == [["a", "wheelbase"]]


def test_value_references_before_fmi_3_are_counted_by_base_type() -> None:
    """An enumeration counts as a whole number (FMI 2.0, section 2.1.2)."""
    text = description(Options(discrete=True))
    for name, old in (("note", 53), ("direction", 52)):
        assert f'name="{name}" valueReference="{old}"' in text
    text = text.replace('"note" valueReference="53"', '"note" valueReference="51"')
    text = text.replace('"direction" valueReference="52"', '"direction" valueReference="51"')
    read = description_of(etree.fromstring(text.encode(), PARSER))
    identity = {variable.name: variable.identity for variable in read.modelVariables}
    assert identity["gear"] == identity["direction"] != identity["note"]


@pytest.mark.parametrize(
    ("fmi", "old", "new", "sentence"),
    [
        (
            "2.0",
            'numberOfEventIndicators="2"',
            'numberOfEventIndicators="-12"',
            "the number of event indicators is -12",
        ),
        (
            "1.0",
            'numberOfContinuousStates="6"',
            'numberOfContinuousStates="-6"',
            "the number of continuous states is -6",
        ),
        ("2.0", 'valueReference="2"', 'valueReference="-1"', "the value reference -1 is not within 0 to 4294967295"),
        ("3.0", 'valueReference="2"', 'valueReference="4294967298"', "the value reference 4294967298 is not within"),
    ],
)
def test_numbers_that_c_does_not_take(fmi: str, old: str, new: str, sentence: str) -> None:
    text = description(Options(fmi=fmi, interface="model_exchange", end_stop=0.3))
    assert old in text
    with pytest.raises(ValueError, match=sentence):
        description_of(etree.fromstring(text.replace(old, new).encode(), PARSER))


@pytest.mark.parametrize("fmi", ["1.0", "2.0"])
def test_a_comment_within_a_type_changes_nothing(fmi: str) -> None:
    tag, kind = ("Type", "RealType") if fmi == "1.0" else ("SimpleType", "Real")
    inner = f'<{kind} unit="m" min="1" max="2"/>'
    of = f'<fmiModelDescription fmiVersion="{fmi}" numberOfContinuousStates="0" modelIdentifier="a"><TypeDefinitions>'
    rest = """</TypeDefinitions><ModelVariables>
  <ScalarVariable name="a" valueReference="1"><Real declaredType="Length"/></ScalarVariable>
</ModelVariables></fmiModelDescription>"""
    (variable,) = description_of(
        etree.fromstring(f'{of}<{tag} name="Length"><!-- in m -->{inner}</{tag}>{rest}', PARSER)
    ).modelVariables
    assert variable.declaredType is not None
    assert (variable.declaredType.unit, variable.declaredType.min, variable.declaredType.max) == ("m", "1", "2")


def test_a_start_value_of_fmi_1_may_be_a_guess() -> None:
    text = """<fmiModelDescription fmiVersion="1.0" numberOfContinuousStates="0" modelIdentifier="a"><ModelVariables>
  <ScalarVariable name="a" valueReference="1"><Real start="1" fixed="false"/></ScalarVariable>
  <ScalarVariable name="b" valueReference="2"><Real start="1" fixed="true"/></ScalarVariable>
  <ScalarVariable name="c" valueReference="3"><Real start="1"/></ScalarVariable>
</ModelVariables></fmiModelDescription>"""
    found = description_of(etree.fromstring(text, PARSER)).modelVariables
    assert [variable.initial for variable in found] == ["approx", None, None]
