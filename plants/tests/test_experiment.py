"""The reference experiment that each FMU carries, replayed by FMPy and read by nothing of ours."""

import csv
import io
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import fmpy
import numpy as np
import pytest
import sympy
from lxml import etree
from sympy.codegen.cfunctions import exp2, fma

import plants
from plants import numeric
from plants.factory.experiment import FOLDER, TOLERANCE, reference_experiment
from plants.factory.generate import generate
from plants.factory.table import tabulate
from plants.ode import TIME, Input, Limit, OdeModel, Output, State

from .fmus import MODELS, Fmu

MANIFEST = "fmi-ls-manifest.xml"
x, u = sympy.symbols("x u", real=True)


def growing(derivative: sympy.Expr, *limits: Limit, start: float = 1.0) -> OdeModel:
    return OdeModel("growing", "Grows", (State(x, "m", "x", start=start),), (derivative,), limits=limits)


def rows(text: str | bytes) -> np.ndarray:
    """Return a table of numbers as a structured array."""
    text = text.decode() if isinstance(text, bytes) else text
    return np.genfromtxt(io.StringIO(text), delimiter=",", names=True)


def replayed(fmu: Fmu, name: str, interface: str, **options: object) -> tuple[np.ndarray, np.ndarray]:
    """Return the references of an FMU and FMPy's results for it, at the same times."""
    folder = fmu.folder / FOLDER
    (experiment,) = etree.parse(folder / "experiments.exp").getroot()
    enumerations = {e.name: e for e in tabulate(MODELS[name]).integers}
    values: dict[str, float] = {}
    for parameter in etree.parse(folder / "parameters.ssv").iter("{*}Parameter"):
        key, value = parameter.get("name"), parameter[0].get("value")
        items = {item.name: item.value for item in enumerations[key].items} if key in enumerations else {}
        values[key] = items[value] if items else float(value)
    references = rows((folder / "results.csv").read_bytes())
    result = fmpy.simulate_fmu(
        str(fmu.folder),
        fmi_type=interface,
        stop_time=float(experiment.get("stopTime")),
        output_interval=float(experiment.get("stepSize")),
        start_values=values,
        input=rows((folder / "stimuli.csv").read_bytes()),
        output=references.dtype.names[1:],
        **options,
    )
    places = [np.abs(result["time"] - time).argmin() for time in references["time"]]
    np.testing.assert_allclose(result["time"][places], references["time"], atol=1e-9)
    return references, result[places]


@pytest.mark.parametrize("name", MODELS)
def test_co_simulation_reproduces_the_model(fmus: Callable[[str, str], Fmu], name: str, fmi: str) -> None:
    references, result = replayed(fmus(name, fmi), name, "CoSimulation")
    assert len(references) > 10
    for column in references.dtype.names[1:]:
        scale = np.abs(references[column]).max()
        assert scale > 0.0, "the experiment moves everything"
        np.testing.assert_allclose(result[column], references[column], atol=1e-8 * scale, rtol=0)


@pytest.mark.parametrize("name", plants.models())
def test_so_does_model_exchange(fmus: Callable[[str, str], Fmu], name: str, fmi: str) -> None:
    references, result = replayed(fmus(name, fmi), name, "ModelExchange", relative_tolerance=1e-9, record_events=False)
    for column in references.dtype.names[1:]:
        scale = np.abs(references[column]).max()
        np.testing.assert_allclose(result[column], references[column], atol=2e-5 * scale, rtol=0)


def test_it_agrees_with_the_numpy_functions() -> None:
    """The results come from the same equations as `plants.numeric` has."""
    model = MODELS["tractor_trailer"]
    found = reference_experiment(model, tabulate(model))
    functions = numeric.compile(model)
    references = rows(found.results)
    stimuli = rows(found.stimuli)[0]
    held = functions.inputs(**{i.name: stimuli[i.name] for i in model.inputs})
    state, p = functions.start(), functions.parameters()
    for k in range(5):
        state = functions.rk4(0.02 * k, state, held, p, 0.02)
    expected = [*state, *functions.outputs(0.1, state, held, p)]
    np.testing.assert_allclose(list(references[1])[1:], expected, atol=1e-9)


@pytest.mark.parametrize("name", MODELS)
def test_files_are_those_of_the_standard(fmus: Callable[[str, str], Fmu], name: str, fmi: str) -> None:
    folder = fmus(name, fmi).folder
    root = etree.parse(folder / FOLDER / MANIFEST).getroot()
    assert root.tag == "fmiReferences"
    space = "{http://fmi-standard.org/fmi-ls-manifest}"
    assert {key.removeprefix(space): value for key, value in root.attrib.items()} == {
        "fmi-ls-name": "org.fmi-standard.fmi-ls-ref",
        "fmi-ls-version": "1.0.0-alpha.1",
        "fmi-ls-description": "Layered Standard providing information on related files included in an FMU.",
    }
    assert [(r.get("role"), r.get("type")) for r in root] == [
        ("experiment/smoke-test", "application/x-ma-hs-experiments"),
        ("parameter", "application/x-ssp-parameter-set"),
        ("result", "text/csv"),
    ]
    assert all((folder / FOLDER / related.get("source")).is_file() for related in root)
    (experiment,) = experiments = etree.parse(folder / FOLDER / "experiments.exp").getroot()
    assert (experiments.tag, experiments.get("name")) == ("Experiments", name)
    assert dict(experiment.attrib) | {"description": "", "stopTime": ""} == {
        "name": "reference",
        "description": "",
        "startTime": "0",
        "stopTime": "",
        "stepSize": "0.02",
        "tolerance": str(TOLERANCE),
    }
    assert [child.tag for child in experiment] == ["Parameters", "Stimuli", "References"]
    assert all((folder / FOLDER / child.get("source")).is_file() for child in experiment)
    schema = Path(fmpy.__file__).parent / "ssp" / "schema" / "SystemStructureParameterValues.xsd"
    parameters = etree.parse(folder / FOLDER / "parameters.ssv")
    etree.XMLSchema(etree.parse(schema)).assertValid(parameters)
    table = tabulate(MODELS[name])
    assert [p.get("name") for p in parameters.iter("{*}Parameter")] == [
        entry.name for entry in (*table.parameters, *table.integers)
    ]
    told = (folder / "documentation" / "fmi-ls-ref.txt").read_text(encoding="utf-8")
    assert f"{experiment.get('stopTime')} s in communication steps of 0.02 s" in told
    assert "fmi-ls-ref.txt" in (folder / "documentation" / "index.html").read_text(encoding="utf-8")


def test_each_input_is_one_piece_behind_the_one_before() -> None:
    model = MODELS["car_like"]
    text = reference_experiment(model, tabulate(model)).stimuli
    table = list(csv.reader(io.StringIO(text)))
    assert [row[0] for row in table] == ["time", "0", "1", "1", "2", "2", "3", "3", "4", "4", "5"]
    assert table[1][1:4] == ["10", "0", "-5"]
    assert table[3][1:4] == ["-10", "10", "0"]


def test_inputs_keep_their_bounds() -> None:
    pushed = OdeModel(
        "pushed", "Pushed", (State(x, "m", "x"),), (u,), inputs=(Input(u, "m/s", "u", min=-0.2, max=0.7),)
    )
    stimuli = rows(reference_experiment(pushed, tabulate(pushed)).stimuli)
    assert (stimuli["u"].min(), stimuli["u"].max()) == (-0.2, 0.7)


@pytest.mark.parametrize(
    ("model", "latest"),
    [
        (growing(x**2), 0.5),  # infinite at 1 s
        (growing(5 * x, Limit(x, max=100.0)), 0.47),  # there at 0.92 s
        (growing(30 * x), 0.4),  # has diverged at 0.69 s
        (growing(sympy.sqrt(x - 2) - 1, start=2.1), 0.4),  # no real value below 2
    ],
)
def test_it_ends_in_good_time_before_trouble(model: OdeModel, latest: float) -> None:
    found = reference_experiment(model, tabulate(model))
    assert 0.02 <= found.stop <= latest
    assert not found.has_inputs
    references = rows(found.results)
    assert references["time"][-1] == found.stop
    assert np.isfinite(references["x"]).all()


@pytest.mark.parametrize("derivative", [sympy.log(-x), 1 / (x - 1), sympy.sqrt(-x)])
def test_without_a_first_step_there_is_none(derivative: sympy.Expr, tmp_path: Path) -> None:
    files = generate(growing(derivative), "2.0")
    assert [path for path in files if path.startswith("extra/") or "ls-ref" in path] == []
    assert b"Reference experiment" not in files["documentation/index.html"]
    with zipfile.ZipFile(plants.build(growing(derivative), out=tmp_path)) as fmu:
        assert not any(name.startswith("extra/") for name in fmu.namelist())


def carries(model: OdeModel) -> bool:
    return any(path.endswith("results.csv") for path in generate(model, "2.0"))


def test_functions_that_python_lacks_have_none() -> None:
    assert not carries(growing(-fma(x, x, x)))
    assert carries(growing(-exp2(x)))
    assert carries(growing(-sympy.erf(x)))


def test_the_largest_of_three_has_one() -> None:
    assert carries(growing(-sympy.Max(x, -1, -2 * x)))


@pytest.mark.parametrize(
    ("derivative", "output", "last"),
    [
        (sympy.Piecewise((1, sympy.Mod(TIME, 0.2) < 0.1), (0, True)), x, 0.08),  # a step at 0.1 s
        (-x, sympy.floor(TIME / 0.14), 0.12),
        (sympy.Heaviside(TIME - 0.29), x, 0.28),  # in the middle of the step to 0.3 s
        (sympy.Heaviside(TIME - 0.153), x, 5.0),  # at no stage of a step
        (-sympy.sign(x), x, 5.0),  # rests at the step
        (1.0 + 0 * x, (x + 0.1) ** 2 - x**2 - x / 5 - 0.01, 5.0),  # last bits are all there is
        (sympy.Heaviside(x - 1.0) + 1, x, 0.98),  # moved, the state reaches 1 at another step
    ],
)
def test_it_ends_before_a_result_depends_on_the_last_bit(
    derivative: sympy.Expr, output: sympy.Expr, last: float
) -> None:
    model = replace(growing(derivative, start=0.0), outputs=(Output(sympy.Symbol("y", real=True), output, "1", ""),))
    found = reference_experiment(model, tabulate(model))
    assert last - 0.1 <= found.stop <= last
