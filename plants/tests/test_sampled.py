"""FMUs of sampled models: when a tick is computed, what is refused, and saved states."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import fmpy
import pytest
from fmpy.validation import validate_fmu

import plants
from plants.errors import ModelError
from plants.factory.compile import compile_library, find_compiler
from plants.factory.platforms import host
from plants.sampled import Port, Sampled

from .driver import DISCARD, WARNING, Instance, Library, Refused
from .fmus import VERSIONS, Fmu

STEP = 0.25
MEMORY = "#ifndef MEMORY_H\n#define MEMORY_H\ntypedef struct {\n    double sum;\n} Memory;\n#endif\n"
TICK = """\
#include <math.h>
#include <stddef.h>

#include "model.h"

void model_start(const double *parameters, const int *integers, Memory *memory)
{
    (void)parameters;
    memory->sum = integers[0];
}

const char *model_tick(long long tick, const double *inputs, const double *parameters, const int *integers,
                       Memory *memory, struct Tool *tool, double *outputs)
{
    (void)integers;
    (void)tool;
    memory->sum += parameters[0] * inputs[0];
    outputs[0] = memory->sum;
    outputs[1] = (double)tick;
    return fabs(memory->sum) > 1e6 ? "the sum is beyond reason" : NULL;
}
"""
ADDER = Sampled(
    name="adder",
    description="Adds up its input",
    step=STEP,
    sources={"memory.h": MEMORY, "tick.c": TICK},
    last=4,
    inputs=(Port("robot.u", "m", "Summand", start=1.0),),
    parameters=(Port("k[1]", "1", "Gain", start=2.0, min=0.0, above=True, tunable=True),),
    outputs=(Port("sum", "m", "Sum"), Port("tick", "1", "Tick", depends=())),
    integers=(Port("seed", "", "Where to begin", start=10, min=0, max=100),),
)


@pytest.fixture(scope="module", params=VERSIONS)
def adder(request: pytest.FixtureRequest, own_caches: None, tmp_path_factory: pytest.TempPathFactory) -> Fmu:
    return built(ADDER, request.param, tmp_path_factory.mktemp("adder"))


@pytest.fixture(scope="module", params=VERSIONS)
def late(request: pytest.FixtureRequest, own_caches: None, tmp_path_factory: pytest.TempPathFactory) -> Fmu:
    return built(replace(ADDER, late=True), request.param, tmp_path_factory.mktemp("late"))


def built(model: Sampled, fmi: str, folder: Path) -> Fmu:
    path = plants.build(model, fmi=fmi)
    fmpy.extract(path, folder)
    description = fmpy.read_model_description(folder)
    references = {v.name: v.valueReference for v in description.modelVariables}
    (binary,) = (folder / "binaries").glob("*/*")
    token = description.guid or description.instantiationToken
    return Fmu(path, folder, Library(str(binary), fmi, token, max(references.values())), references)


@pytest.fixture
def one(adder: Fmu) -> Any:
    instance = Instance(adder.library, "co_simulation")
    yield instance
    instance.free()


def test_fmpy_finds_no_fault(adder: Fmu) -> None:
    assert validate_fmu(str(adder.path)) == []


def test_the_description_says_what_it_is(adder: Fmu) -> None:
    description = fmpy.read_model_description(adder.folder)
    by_name = {v.name: v for v in description.modelVariables}
    assert description.modelExchange is None
    assert not description.coSimulation.canHandleVariableCommunicationStepSize
    assert description.coSimulation.canGetAndSetFMUstate
    assert float(description.defaultExperiment.stepSize) == STEP
    assert (by_name["k[1]"].variability, by_name["seed"].variability) == ("tunable", "fixed")
    assert by_name["sum"].unit == "m"
    dependencies = {unknown.variable.name: [v.name for v in unknown.dependencies] for unknown in description.outputs}
    assert dependencies == {"sum": ["robot.u"], "tick": []}


def test_outputs_belong_to_the_inputs_of_the_same_time(one: Instance, adder: Fmu) -> None:
    u, total, tick = adder["robot.u"], adder["sum"], adder["tick"]
    one.start()
    for k in range(4):
        one.set({u: 99.0})
        assert one.get(total)[0] == 10.0 + 2.0 * k + 2.0 * 99.0  # computed, and not kept:
        one.set({u: 1.0})
        assert one.get(total, tick) == [10.0 + 2.0 * (k + 1), k]
        assert one.get(total, tick) == [10.0 + 2.0 * (k + 1), k]
        one.step(k * STEP, STEP)


def test_outputs_asked_for_before_inputs_are_set_are_those_of_the_last_tick(one: Instance, adder: Fmu) -> None:
    one.start()
    got = []
    for k in range(4):
        one.set({adder["robot.u"]: 10.0**k})
        one.step(k * STEP, STEP)
        got.append(one.get(adder["sum"], adder["tick"]))
    assert got == [[12.0, 0.0], [32.0, 1.0], [232.0, 2.0], [2232.0, 3.0]]


TOLD = """\
#include <stdlib.h>

#include "model.h"

struct Tool {
    double sum, before;
    long long tick;
};

struct Tool *model_open(const char *resources, const char **fault)
{
    (void)resources;
    *fault = "no memory";
    return calloc(1, sizeof(struct Tool));
}

const char *model_begin(struct Tool *tool, const double *parameters, const int *integers)
{
    (void)parameters;
    (void)integers;
    *tool = (struct Tool){.tick = -1};
    return NULL;
}

void model_end(struct Tool *tool)
{
    (void)tool;
}

void model_close(struct Tool *tool)
{
    free(tool);
}

void model_start(const double *parameters, const int *integers, Memory *memory)
{
    (void)parameters;
    (void)integers;
    memory->sum = 0.0;
}

const char *model_tick(long long tick, const double *inputs, const double *parameters, const int *integers,
                       Memory *memory, struct Tool *tool, double *outputs)
{
    (void)parameters;
    (void)integers;
    (void)memory;
    if (tick > tool->tick) tool->before = tool->sum; /* else once more, with other inputs */
    tool->tick = tick;
    tool->sum = tool->before + inputs[0];
    outputs[0] = tool->sum;
    return NULL;
}
"""


@pytest.mark.parametrize("fmi", VERSIONS)
def test_a_program_that_begins_anew_after_the_initialisation_gets_its_first_tick(
    fmi: str, own_caches: None, tmp_path: Path
) -> None:
    """Also if outputs were read before, and no input is set since."""
    told = built(
        Sampled(
            name="told",
            description="Adds up its input in a program beside it",
            step=STEP,
            sources={"memory.h": MEMORY, "told.c": TOLD},
            inputs=(Port("u", "m", "Summand", start=1.0),),
            outputs=(Port("sum", "m", "Sum"),),
            program=True,
        ),
        fmi,
        tmp_path,
    )
    one = Instance(told.library, "co_simulation")
    one.set({told["u"]: 3.0})
    one.initialize()
    assert one.get(told["sum"]) == [3.0]
    one.call("ExitInitializationMode")
    for tick in range(3):
        one.step(tick * STEP, STEP)
        assert one.get(told["sum"]) == [3.0 * (tick + 1)]
    one.free()


def test_late_outputs_come_with_the_step_whatever_the_master_asks(late: Fmu) -> None:
    assert validate_fmu(str(late.path)) == []
    outputs = fmpy.read_model_description(late.folder).outputs
    assert [list(unknown.dependencies) for unknown in outputs] == [[], []]
    u, total, tick = late["robot.u"], late["sum"], late["tick"]
    one = Instance(late.library, "co_simulation")
    one.set({u: 7.0})
    one.start()
    got = []
    for k in range(4):
        one.set({u: 10.0**k})  # the first one comes too late: the first tick has the input of the initialisation
        got.append(one.get(total, tick))
        one.step(k * STEP, STEP)
        after = one.get(total, tick)
    one.free()
    assert got == [[0.0, 0.0], [24.0, 0.0], [44.0, 1.0], [244.0, 2.0]]
    assert after == [2244.0, 3.0]


def test_a_step_over_several_ticks_holds_the_inputs(one: Instance, adder: Fmu) -> None:
    one.start()
    one.set({adder["robot.u"]: 5.0})
    one.step(0.0, 3 * STEP)
    assert one.get(adder["sum"], adder["tick"]) == [40.0, 2.0]
    one.set({adder["robot.u"]: 1.0})
    assert one.get(adder["sum"], adder["tick"]) == [42.0, 3.0]


@pytest.mark.parametrize("step", [0.1, 0.3, 1.0001 * STEP, 1e-9])
def test_other_steps_are_refused(one: Instance, step: float) -> None:
    one.start()
    with pytest.raises(Refused, match=r"must be the sample time of this FMU, 0.25 s, or a whole number of them"):
        one.step(0.0, step)


def test_beyond_its_courses_it_discards(one: Instance, adder: Fmu) -> None:
    one.start()
    one.set({adder["robot.u"]: 1.0})
    one.step(0.0, 5 * STEP)
    assert one.get(adder["sum"]) == [20.0]
    one.set({adder["robot.u"]: 1.0})
    with pytest.raises(Refused, match="knows its courses over time up to 1 s after the start"):
        one.step(5 * STEP, STEP)
    assert DISCARD in one.statuses


def test_a_step_over_ticks_is_discarded_after_the_last_one_that_is_known(one: Instance, adder: Fmu) -> None:
    one.start()
    one.set({adder["robot.u"]: 1.0})
    with pytest.raises(Refused, match=r"no value at time 1\.25 s"):
        one.step(0.0, 7 * STEP)
    assert one.get(adder["sum"], adder["tick"]) == [20.0, 4.0]


def test_a_tick_that_fails_says_why(one: Instance, adder: Fmu) -> None:
    one.start()
    one.set({adder["robot.u"]: 1e9})
    with pytest.raises(Refused, match="the sum is beyond reason at time 0 s"):
        one.step(0.0, STEP)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [("k[1]", 0.0, r"k\[1\] is 0 1 at time 0 s: must be greater than 0"), ("k[1]", -1.0, "must be greater than 0")],
)
def test_a_parameter_beyond_its_bounds_is_refused(
    one: Instance, adder: Fmu, name: str, value: float, message: str
) -> None:
    one.set({adder[name]: value})
    with pytest.raises(Refused, match=message):
        one.start()


def test_a_whole_number_beyond_its_bounds_is_refused(one: Instance, adder: Fmu) -> None:
    one.set_enumeration(adder["seed"], 101)
    with pytest.raises(Refused, match=r"parameter seed is 101 .*must be at most 100"):
        one.start()


def test_what_is_not_finite_is_refused(one: Instance, adder: Fmu) -> None:
    one.start()
    for value in (float("nan"), float("inf")):
        with pytest.raises(Refused, match=r"input robot\.u is set to .*: must be a finite number"):
            one.set({adder["robot.u"]: value})
    one.set({adder["robot.u"]: 1.0})
    assert one.get(adder["sum"]) == [12.0]


def test_inputs_that_nobody_sets_are_told_once(one: Instance) -> None:
    one.start()
    assert one.step(0.0, STEP) == WARNING
    assert "1 of 1 inputs were never set, and keep their start value: robot.u stays 1 m" in one.messages[-1][2]
    assert one.step(STEP, STEP) == 0


def test_parameters_act(one: Instance, adder: Fmu) -> None:
    one.set({adder["k[1]"]: 3.0})
    one.set_enumeration(adder["seed"], 50)
    one.start()
    one.set({adder["robot.u"]: 1.0})
    assert one.get(adder["sum"]) == [53.0]
    one.step(0.0, STEP)
    one.set({adder["k[1]"]: 0.5, adder["robot.u"]: 1.0})
    assert one.get(adder["sum"]) == [53.5]


def test_a_saved_state_goes_on_in_another_instance(adder: Fmu) -> None:
    first, second = (Instance(adder.library, "co_simulation") for _ in range(2))
    first.start()
    for k in range(2):
        first.set({adder["robot.u"]: 3.0})
        first.step(k * STEP, STEP)
    state = first.save()
    data = first.serialize(state)
    other = second.deserialize(data)
    second.restore(other)
    assert second.get(adder["sum"]) == [22.0]  # of the last tick, until an input is set
    for instance in (first, second):
        instance.set({adder["robot.u"]: 1.0})
        instance.step(2 * STEP, STEP)
        assert instance.get(adder["sum"]) == [24.0]
    with pytest.raises(Refused, match="not a state of this FMU: they hold impossible values"):
        second.deserialize(data[:-17] + b"\xff" * 17)  # among them whether inputs are fresh
    for instance, own in ((first, state), (second, other)):
        instance.forget(own)
        instance.free()


def test_model_exchange_is_refused(adder: Fmu) -> None:
    messages: list[str] = []
    address, _ = adder.library.instantiate("model_exchange", lambda *message: messages.append(message[2]))
    assert address is None
    assert "this FMU is for Co-Simulation only" in messages[-1]


def test_the_runtime_compiles_without_warnings(adder: Fmu) -> None:
    sources = sorted(path.relative_to(adder.folder).as_posix() for path in adder.folder.glob("sources/*.c"))
    strict = ("-Werror", "-Wshadow", "-Wconversion", "-O1")
    assert compile_library(find_compiler(), host(), adder.folder, sources, "adder", strict)


@pytest.mark.parametrize("change", [{"name": "9 lives"}, {"outputs": (Port("robot.u", "m", "The same"),)}])
def test_bad_models_are_refused(change: dict[str, Any]) -> None:
    with pytest.raises(ModelError):
        replace(ADDER, **change)
