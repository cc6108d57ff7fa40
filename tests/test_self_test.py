"""``formation inspect --self-test``: reference experiments of ours and of strangers, good, wrong and broken."""

import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import plants
from cosim.cli import main
from cosim.errors import InputError
from cosim.fmu.package import open_package
from cosim.fmu.reference_experiments import MANIFEST, read_experiments

from .commands import command
from .stub.broken import make_broken
from .stub.stub import make_fmu

FOLDER = MANIFEST.parent.as_posix()
Files = dict[str, str | bytes]

ROOT = """<fmiReferences xmlns:fmi-ls="http://fmi-standard.org/fmi-ls-manifest"
    fmi-ls:fmi-ls-name="org.fmi-standard.fmi-ls-ref" fmi-ls:fmi-ls-version="1.0.0-alpha.1">{}</fmiReferences>"""
RESULT = '<Related type="text/csv" source="out.csv" role="result"/>'
EXPERIMENT = '<Related type="application/x-ma-hs-experiments" source="tests.exp" role="experiment"/>'
TIMES = 'startTime="0" stopTime="0.2" stepSize="0.02"'


def experiments(inside: str, attributes: str = TIMES) -> Files:
    one = f'<Experiment name="one" {attributes}>{inside}</Experiment>'
    return {MANIFEST.name: ROOT.format(EXPERIMENT), "tests.exp": f'<Experiments name="tests">{one}</Experiments>'}


def with_files(fmu: Path, target: Path, files: Files) -> Path:
    """Copy an FMU with other files in the folder of the layered standard; None leaves a file out."""
    with zipfile.ZipFile(fmu) as source, zipfile.ZipFile(target, "w") as copy:
        for entry in source.infolist():
            if entry.filename.removeprefix(f"{FOLDER}/") not in files:
                copy.writestr(entry.filename, source.read(entry))
        for name, content in files.items():
            copy.writestr(f"{FOLDER}/{name}", content)
    return target


def content(fmu: Path, name: str) -> str:
    with zipfile.ZipFile(fmu) as source:
        return source.read(f"{FOLDER}/{name}").decode()


@pytest.fixture
def self_test(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[str, str]]:
    """Return a function that lets an FMU test itself and returns what is printed, each space once, and the errors."""

    def run(path: Path, *options: str, status: int = 0) -> tuple[str, str]:
        printed, warned = command(capsys, "inspect", "--self-test", path, *options, status=status)
        return " ".join(printed.split()), warned

    return run


@pytest.fixture(scope="module")
def stub(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An FMU of a stranger, without any experiment."""
    return make_fmu(tmp_path_factory.mktemp("stub"))


# What holds, and what does not ------------------------------------------------------------------------------


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_ours_agree(self_test: Callable[..., tuple[str, str]], fmi: str) -> None:
    printed, errors = self_test(plants.build("car_like", fmi=fmi))
    assert errors == ""
    assert re.findall(r"(\w+) \S+ \S+ \S+ s agrees", printed) == ["x", "y", "psi", "gamma", "v", "omega"]


def test_models_of_users_agree(self_test: Callable[..., tuple[str, str]], tmp_path: Path) -> None:
    """The one of docs/own_model.md, which has an output that is no state, and states that are no outputs."""
    page = (Path(__file__).parents[1] / "docs" / "own_model.md").read_text(encoding="utf-8")
    names: dict[str, Any] = {}
    exec(re.findall(r"```python\n(.*?)```", page, re.DOTALL)[0], names)
    printed, _ = self_test(plants.build(names["unicycle"], out=tmp_path))
    assert re.findall(r"(\w+) \S+ \S+ \S+ s agrees", printed) == [
        "x", "y", "theta", "w_right", "w_left", "speed"
    ]  # fmt: skip


def test_a_wrong_result_is_found_where_it_is(self_test: Callable[..., tuple[str, str]], tmp_path: Path) -> None:
    """The same FMU with one number of its references changed by a thousandth, and beyond its end."""
    built = plants.build("car_like")
    lines = content(built, "results.csv").splitlines()
    (row,) = [k for k, line in enumerate(lines) if line.startswith("1.2,")]
    cells = lines[row].split(",")
    cells[1] = repr(float(cells[1]) + 1e-3)
    lines[row] = ",".join(cells)
    printed, _ = self_test(with_files(built, tmp_path / "wrong.fmu", {"results.csv": "\n".join(lines)}), status=1)
    assert re.search(r" x 0\.001 \S+ 1\.2 s differs", printed)
    assert printed.count("agrees") == 5


def test_parameters_of_the_set_are_set(self_test: Callable[..., tuple[str, str]], tmp_path: Path) -> None:
    built = plants.build("car_like")
    other = content(built, "parameters.ssv").replace('"runge_kutta_4"', '"euler"')
    printed, _ = self_test(with_files(built, tmp_path / "euler.fmu", {"parameters.ssv": other}), status=1)
    assert "differs" in printed


def test_results_alone_are_of_the_default_experiment(
    self_test: Callable[..., tuple[str, str]], stub: Path, tmp_path: Path
) -> None:
    """As in the Reference FMUs of the Modelica Association; missing variables are named, and late samples, too."""
    files: Files = {
        MANIFEST.name: ROOT.format(RESULT),
        "out.csv": "time,x,gone,v\n0,0,1,0\n0.5,0,1,0\n1,0,1,0\n",
    }
    printed, errors = self_test(with_files(stub, tmp_path / "stub.fmu", files))
    assert re.findall(r"(\w) 0 1e-12 agrees", printed) == ["x", "v"]
    assert errors == "warning: out.csv: gone not compared: the FMU has no such variable\n"


def test_a_steady_run_without_references_is_a_smoke_test(
    self_test: Callable[..., tuple[str, str]], stub: Path, tmp_path: Path
) -> None:
    """The times stand with the analysis in newer drafts; another analysis is left out."""
    files = experiments(f"<TransientSimulation {TIMES}/>", "")
    files["tests.exp"] = str(files["tests.exp"]).replace(
        "</Experiments>", '<Experiment name="two"><Linearization/></Experiment></Experiments>'
    )
    printed, errors = self_test(with_files(stub, tmp_path / "stub.fmu", files))
    assert "one ran, but it has no reference results to compare with" in printed
    assert errors == "warning: the experiment 'two' is left out: Linearization is no transient simulation\n"


@pytest.mark.parametrize(
    ("behaviour", "message"),
    [
        ("segfault", "failed: its process crashed (SIGSEGV)"),
        ("exit", "failed: its process exited with status 7"),
        ("error", "failed: .*status 3.*; it logged: "),
    ],
)
def test_an_fmu_that_fails_ends_its_experiment_alone(
    self_test: Callable[..., tuple[str, str]], tmp_path: Path, behaviour: str, message: str
) -> None:
    fmu = make_fmu(tmp_path, behaviour=behaviour, when=0.1)
    printed, _ = self_test(with_files(fmu, tmp_path / "bad.fmu", experiments("")), status=1)
    assert re.search(message.replace("(", r"\(").replace(")", r"\)"), printed)


def test_an_fmu_that_may_not_be_unloaded_is_not(self_test: Callable[..., tuple[str, str]], tmp_path: Path) -> None:
    fmu = make_fmu(tmp_path, behaviour="thread")
    printed, _ = self_test(with_files(fmu, tmp_path / "thread.fmu", experiments("")))
    assert "one ran, but it has no reference results to compare with" in printed


def test_an_fmu_that_hangs_is_ended(self_test: Callable[..., tuple[str, str]], tmp_path: Path) -> None:
    fmu = make_fmu(tmp_path, behaviour="hang_stubborn", when=0.1)
    path = with_files(fmu, tmp_path / "hangs.fmu", experiments(""))
    printed, _ = self_test(path, "--time-limit", "0.5", status=1)
    assert "failed: it did not end within 0.5 s; its process was ended" in printed
    _, errors = self_test(path, "--time-limit", "0", status=2)
    assert "expected a number of seconds greater than zero" in errors


def test_values_beyond_the_end_are_missed(
    self_test: Callable[..., tuple[str, str]], stub: Path, tmp_path: Path
) -> None:
    files = experiments('<References source="out.csv"/>') | {"out.csv": "time,x\n0,0\n0.05,0\n7,0\n"}
    printed, _ = self_test(with_files(stub, tmp_path / "stub.fmu", files), status=1)
    assert "x no number 1e-12 7 s differs" in printed


def test_without_any_experiment(self_test: Callable[..., tuple[str, str]], stub: Path) -> None:
    _, errors = self_test(stub, status=2)
    assert "carries no reference experiment: it has no extra/org.fmi-standard.fmi-ls-ref/fmi-ls-manifest.xml" in errors


def test_inspect_says_that_there_is_one(capsys: pytest.CaptureFixture[str], stub: Path) -> None:
    for fmu, told in ((plants.build("car_like"), True), (stub, False)):
        assert main(["inspect", str(fmu)]) == 0
        assert ("--self-test replays its reference experiment" in capsys.readouterr().out) == told


# What is broken ---------------------------------------------------------------------------------------------


REFERENCES = '<References source="out.csv"/>'
STIMULI = '<Stimuli source="in.csv"/>'
PARAMETERS = '<Parameters source="set.ssv"/>'


def parameters(inside: str) -> str:
    return (
        '<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="1.0" '
        f'name="set"><ssv:Parameters>\n{inside}\n</ssv:Parameters></ssv:ParameterSet>'
    )


def parameter(name: str, value: str) -> Files:
    return experiments(PARAMETERS) | {
        "set.ssv": parameters(f'<ssv:Parameter name="{name}"><ssv:Real {value}/></ssv:Parameter>')
    }


BROKEN: dict[str, tuple[Files, str]] = {
    "no_xml": ({MANIFEST.name: "<fmiReferences>"}, r"manifest\.xml:1: is not well-formed XML: "),
    "other_root": ({MANIFEST.name: "<manifest/>"}, "the root element is manifest; expected fmiReferences"),
    "other_standard": (
        {MANIFEST.name: ROOT.format("").replace("fmi-ls-ref", "fmi-ls-xcp")},
        "is the manifest of 'org.fmi-standard.fmi-ls-xcp', not of org.fmi-standard.fmi-ls-ref",
    ),
    "entity": (
        {MANIFEST.name: '<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]><fmiReferences>&b;</fmiReferences>'},
        "declares a document type, which is not read",
    ),
    "huge": ({MANIFEST.name: "<fmiReferences>" + " " * 5_000_000 + "</fmiReferences>"}, "is larger than 4 MiB"),
    "nothing": ({MANIFEST.name: ROOT.format("")}, r"can be replayed: extra/\S+ names none"),
    "other_roles": (
        {MANIFEST.name: ROOT.format(EXPERIMENT.replace('"experiment"', '"experiment/uncertainty-analysis"'))},
        "can be replayed: tests.exp is left out: its role is experiment/uncertainty-analysis",
    ),
    "other_type": (
        {MANIFEST.name: ROOT.format(RESULT.replace("text/csv", "application/hdf5"))},
        "can be replayed: out.csv is left out: its type is 'application/hdf5', not text/csv",
    ),
    "absent": ({MANIFEST.name: ROOT.format(RESULT)}, "source='out.csv': the FMU has no such file"),
    "outside": (
        {MANIFEST.name: ROOT.format(RESULT.replace("out.csv", "../../../etc/passwd"))},
        "source='../../../etc/passwd' points outside of the FMU",
    ),
    "outside_in_code": (
        {MANIFEST.name: ROOT.format(RESULT.replace("out.csv", "%2e%2e/%2e%2e/%2e%2e/etc/passwd"))},
        "points outside of the FMU",
    ),
    "absolute": (
        {MANIFEST.name: ROOT.format(RESULT.replace("out.csv", "/etc/passwd"))},
        "source='/etc/passwd' points outside of the FMU",
    ),
    "remote": (
        {MANIFEST.name: ROOT.format(RESULT.replace("out.csv", "https://example.org/out.csv"))},
        "is no file in the FMU: expected a relative path",
    ),
    "no_name_of_a_file": (
        {MANIFEST.name: ROOT.format(RESULT.replace("out.csv", "a%00b"))},
        "source='a%00b': the FMU has no such file",
    ),
    "no_times": (experiments("", TIMES.replace("0.2", "soon")), r"tests\.exp:1: stopTime='soon' is no finite number"),
    "backwards": (experiments("", TIMES.replace("0.2", "-1")), "'one' ends at -1 s, begins at 0 s"),
    "too_many_steps": (experiments("", TIMES.replace("0.02", "1e-12")), "has more than 20000000 values with steps"),
    "no_tolerance": (experiments("", TIMES + ' tolerance="0"'), "has the tolerance 0; it must be more than zero"),
    "no_columns": (experiments(REFERENCES) | {"out.csv": "time\n0\n"}, "its first line names no columns"),
    "no_rows": (experiments(REFERENCES) | {"out.csv": "time,x\n"}, "out.csv: has no rows"),
    "binary": (experiments(REFERENCES) | {"out.csv": b"time,x\n\xff\n"}, "is not text in UTF-8"),
    "ragged": (experiments(REFERENCES) | {"out.csv": "time,x\n0,0\n1\n"}, r"out\.csv:3: has 1 cells, but the first"),
    "time_back": (experiments(REFERENCES) | {"out.csv": "time,x\n1,0\n0,0\n"}, r"out\.csv:3: the time is '0'"),
    "no_number": (experiments(REFERENCES) | {"out.csv": "time,x\n0,nan\n"}, r"out\.csv:2: 'x' is 'nan'"),
    "two_numbers": (experiments(REFERENCES) | {"out.csv": "time,x\n0,1 2\n"}, r"out\.csv:2: 'x' is '1 2'"),
    "nothing_known": (experiments(REFERENCES) | {"out.csv": "time,other\n0,1\n"}, "there is nothing to compare"),
    "no_input": (experiments(STIMULI) | {"in.csv": "time,x\n0,1\n"}, "'x' is a stimulus, but no input of the FMU"),
    "unknown_input": (
        experiments(STIMULI) | {"in.csv": "time,tau_driv\n0,1\n"},
        "the FMU has no variable 'tau_driv': did you mean 'tau_drive'",
    ),
    "unknown_parameter": (parameter("wheelbase", 'value="1"'), r"set\.ssv:2: the FMU has no variable 'wheelbase'"),
    "no_value": (parameter("a", ""), "the parameter 'a' has no value"),
    "wrong_value": (parameter("a", 'value="long"'), "the parameter 'a' cannot be 'long': it is of the type Real"),
    "other_unit": (
        parameter("a", 'value="1" unit="mm"'),
        "the parameter 'a' is in 'mm', but the FMU's variable in 'm'",
    ),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_what_is_broken_is_told(stub: Path, tmp_path: Path, kind: str) -> None:
    files, message = BROKEN[kind]
    package = open_package(with_files(stub, tmp_path / "stub.fmu", files))
    try:
        with pytest.raises(InputError, match=message) as raised:
            read_experiments(package)
        assert len(str(raised.value)) < 2000
    finally:
        package.close()


def test_too_much_is_refused(stub: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cosim.fmu.reference_series.MAX_CELLS", 10)
    monkeypatch.setattr("cosim.fmu.reference_experiments.MAX_EXPERIMENTS", 2)
    many = experiments("")
    many["tests.exp"] = f"<Experiments>{f'<Experiment {TIMES}/>' * 3}</Experiments>"
    long = experiments(REFERENCES) | {"out.csv": "time,x\n" + "0,0\n" * 10}
    for files, message in ((many, "there are more than 2 experiments"), (long, "has 22 cells, more than 10")):
        package = open_package(with_files(stub, tmp_path / "stub.fmu", files))
        with pytest.raises(InputError, match=message):
            read_experiments(package)
        package.close()


def test_an_fmu_that_breaks_rules_of_fmi(self_test: Callable[..., tuple[str, str]], tmp_path: Path) -> None:
    fmu = with_files(make_broken(tmp_path, "undefined_unit"), tmp_path / "unit.fmu", experiments(""))
    printed, summed_up = self_test(fmu)
    assert "one ran" in printed
    _, every = self_test(fmu, "--all")
    assert 0 < summed_up.count("unit.fmu breaks a rule of FMI") < every.count("unit.fmu breaks a rule of FMI")
    printed, refusal = self_test(fmu, "--strict", status=2)
    assert printed == ""
    assert refusal == f"{summed_up}error: the FMU {fmu} breaks rules of FMI, which --strict refuses\n"
