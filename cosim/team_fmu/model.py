"""The team's half of the loop as a sampled model: sensors, laws, actuators and desired places in C."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import formation_controllers as fc
import numpy as np

from cosim.control.team import Team
from cosim.control.team_here import TeamHere
from cosim.control.teams import team_of
from cosim.errors import InputError
from cosim.master.robot import RobotSetup
from cosim.master.setup import Setup
from cosim.master.teams import teams_of
from cosim.scenario.scenario import Scenario
from cosim.signals.actuators import actuators
from cosim.signals.random import words_of
from cosim.signals.sensors import pose_sensors
from cosim.team_fmu.c_text import block, number, numbers, table
from cosim.team_fmu.chains import ChainInC, stream_names
from cosim.team_fmu.courses import PLACE_OF, Courses
from cosim.team_fmu.law_in_host import LawInHost, files_of
from cosim.team_fmu.laws import PRIMITIVES, LawInC, is_translatable, law_in_c
from cosim.team_fmu.leader_in_c import LeaderInC
from cosim.team_fmu.ports import command_outputs, state_inputs
from cosim.translation import CSource, translate
from cosim.translation.names import identifier
from plants.sampled import Port, Sampled

_TEMPLATE = Path(__file__).parent / "template"
LARGEST_SEED = 2**31 - 1
"""Of the parameter; a scenario with a larger one has its seed built in."""


def team_model(scenario: Scenario, setup: Setup, controller: str) -> Sampled:
    """Return a controller of a scenario, with the followers that it serves, as a sampled model.

    Parameters
    ----------
    scenario, setup
        The scenario with its set-up.
    controller
        The id of the controller.

    Raises
    ------
    InputError
        No follower has this controller, or its law cannot be translated to C: the place, and what would be right.
    """
    made_of = [own for own in teams_of(scenario, setup) if own[0].source.id == controller]
    if not made_of:
        known = ", ".join(dict.fromkeys(follower.controller for follower in scenario.followers))
        raise InputError(f"no follower has the controller {controller!r}; there are {known}", scenario.where)
    return _Model(scenario, setup, [team_of(*own) for own in made_of]).sampled(controller)


class _Model:
    """The parts of the model; rows are those of the leader and of the followers of this controller."""

    def __init__(self, scenario: Scenario, setup: Setup, teams: Sequence[Team]) -> None:
        self._scenario, self._setup, self._teams = scenario, setup, teams
        self._places = sorted(int(row) for team in teams for row in team.rows)  # in the scenario
        self._followers = [setup.followers[row] for row in self._places]
        self._robots = [setup.leader, *self._followers]
        self._width = max(len(robot.kind.pose) for robot in self._robots)
        self._commands = max(len(robot.kind.command) for robot in self._followers)
        names = [robot.name for robot in self._robots]
        poses = [[role.name for role in robot.kind.pose] for robot in self._robots]
        commands = [[role.name for role in robot.kind.command] for robot in self._followers]
        step = scenario.step
        sensors = pose_sensors(scenario.seed, names, poses, [robot.sensor for robot in self._robots], step)
        acting = actuators(commands, [robot.actuator for robot in self._followers], step)
        self._sensors = ChainInC("sense", sensors, 0)
        self._actuators = ChainInC("actuate", acting, len(self._sensors.streams))
        self._delays = any(effect.element == "delay" for effect in acting.effects)
        self._laws: list[LawInC | LawInHost] = [
            law_in_c(team, str(k + 1), self._prepare)
            for k, team in enumerate(teams)
            if isinstance(team, TeamHere) and is_translatable(team)
        ]
        if len(self._laws) < len(teams):
            self._laws = [LawInHost(team, str(k + 1), k, setup.motion is not None) for k, team in enumerate(teams)]
        self._hosted = [law for law in self._laws if isinstance(law, LawInHost)]
        self._courses = Courses()
        self._leaders = [LeaderInC(law.label, law.team) for law in self._laws]
        self._inputs: list[Port] = []
        self._streams = self._sensors.streams + self._actuators.streams
        self._has_seed = bool(self._streams) and scenario.seed <= LARGEST_SEED
        self._law_of = {int(row): (law, index) for law in self._laws for index, row in enumerate(law.team.rows)}
        self._parameters: list[Port] = []
        self._outputs: list[Port] = []
        self._gains: dict[str, list[str]] = {law.label: [] for law in self._laws}
        self._results: list[str] = []
        self._state_variables()

    def _prepare(self, team: TeamHere) -> None:
        """Start a law that prepares states before the first tick."""
        setup, rows = self._setup, team.rows
        leader = np.array(setup.leader.pose, dtype=float), np.zeros(len(setup.leader.kind.velocity))
        desired = fc.Desired(*(np.ascontiguousarray(part[0][rows]) for part in setup.desired))
        team.controller.start(np.array([setup.followers[row].pose for row in rows]), fc.Leader(*leader), desired)

    # Variables ---------------------------------------------------------------------------------------------

    def _state_variables(self) -> None:
        setup, needs = self._setup, {row for law in self._laws if _needs(law) for row in law.team.rows}
        leader = setup.leader
        self._inputs += state_inputs(leader, velocities=True, accelerations=setup.motion is not None)
        shared = tuple(port.name for port in self._inputs)
        adds = any(robot.has_torque for robot in setup.followers)  # then to all, which takes the sign from a zero
        for row, (place, robot) in enumerate(zip(self._places, self._followers, strict=True)):
            own = list(state_inputs(robot, velocities=place in needs))
            self._inputs += own
            depends = (*shared, *(port.name for port in own))
            besides = robot.torque
            for column, port in enumerate(command_outputs(robot, depends)):
                self._outputs.append(port)
                besides_text = self._courses.of(f"{port.name}, besides the law's", besides[:, column])
                plus = f" + {besides_text}" if adds and besides_text != "-0.0" else ""
                self._results.append(f"acting[{row}][{column}]{plus}")
            law, index = self._law_of[place]
            for port, result in law.telemetry(index, robot.name, depends):
                self._outputs.append(port)
                self._results.append(result)
            for port, place_in_c in law.gains(index, robot.name):
                if place_in_c:
                    self._gains[law.label].append(f"{place_in_c} = parameters[{len(self._parameters)}];")
                self._parameters.append(port)

        self._place_of = {port.name: place for place, port in enumerate(self._inputs)}

    def _input(self, robot: RobotSetup, entry: str) -> str:
        return f"inputs[{self._place_of[f'{robot.name}.{entry}']}]"

    # The model ---------------------------------------------------------------------------------------------

    def sampled(self, controller: str) -> Sampled:
        """Return the model."""
        scenario = self._scenario
        entries = [
            *(entry for law in self._laws for entry in law.entries),
            *(entry for leader in self._leaders for entry in leader.entries),
            *self._sensors.entries,
            *self._actuators.entries,
        ]
        source = translate(
            "team",
            entries,
            about=f"The controller {controller} of {scenario.name}: its law, sensors and actuators.",
            primitives=(*PRIMITIVES, *LeaderInC.primitives),
        )
        tick = self._tick(source)
        memory = self._memory(source)
        sources = {
            source.header_name: source.header,
            source.source_name: source.source,
            "memory.h": memory,
            "model.c": self._start_and_tick(controller, source, tick),
        }
        if self._streams:
            sources |= {name: (_TEMPLATE / name).read_text("utf-8") for name in ("streams.c", "streams.h")}
            sources["ziggurat.h"] = _ziggurat()
        resources: dict[str, bytes] = {}
        if self._hosted:
            own, resources = files_of(self._hosted, self._parameters)
            sources |= own
        seed = Port("seed", "", "Seed of the noise", start=scenario.seed, min=0, max=LARGEST_SEED)
        laws = ", ".join(dict.fromkeys(law.team.law.source.name for law in self._laws))
        return Sampled(
            name=identifier(f"{scenario.name}_{controller}"),
            description=f"The followers' half of {scenario.name}: sensors, {laws} and actuators",
            step=scenario.step,
            sources=sources,
            last=self._courses.last,
            stop=scenario.horizon,
            inputs=self._inputs,
            parameters=self._parameters,
            outputs=self._outputs,
            integers=(seed,) if self._has_seed else (),
            pages=self._pages(laws),
            program=bool(self._hosted),
            resources=resources,
        )

    def _pages(self, laws: str) -> dict[str, Sequence[str]]:
        package = self._laws[0].team.law
        robots = ", ".join(robot.name for robot in self._followers)
        return {
            "What it is": [
                f"It takes the true poses of the leader and of {robots}, measures them by the scenario's sensors, lets "
                f"the law {laws} of {package.package} {package.version} compute commands, and passes these through the "
                "actuators. Desired places over time are in it. All units are SI.",
                f"The law runs every {self._scenario.period * self._scenario.step:.12g} s"
                + ("; in between commands are held." if self._scenario.period > 1 else "."),
                self._how(package.package, package.version),
            ]
        }

    def _how(self, package: str, version: str) -> str:
        if not self._hosted:
            return "Its C is translated from the law's Python, whose names and comments it keeps."
        return (
            f"The law is Python, which a process beside the FMU runs: it needs an environment with {package} {version}."
            " The FMU's file resources/interpreter.txt names its interpreter, and the environment variable "
            "FORMATION_LAW_PYTHON another one."
        )

    def _memory(self, source: CSource) -> str:
        members = [
            *(f"{law.remembered(source)} team_{law.label};" for law in self._laws),
            f"double command[{len(self._followers)}][{self._commands}]; /* held until the law's next tick */",
            *self._sensors.members,
            *self._actuators.members,
            *([f"Stream streams[{len(self._streams)}];"] if self._streams else []),
        ]
        includes = '#include "team.h"\n' + ('#include "streams.h"\n' if self._streams else "")
        types = "".join(f"{law.type_in_c()}\n" for law in self._hosted)
        return (
            "/* What the team remembers from tick to tick. */\n#ifndef MEMORY_H\n#define MEMORY_H\n\n"
            f"{includes}\n{types}typedef struct {{\n{block(members)}}} Memory;\n\n#endif\n"
        )

    def _start_and_tick(self, controller: str, source: CSource, tick: str) -> str:
        courses = "\n\n".join(self._courses.tables)
        tables = [*self._sensors.tables, *self._actuators.tables]
        functions = [self._sensors.function, self._actuators.function]
        parts = [
            f"/* The controller {controller} of {self._scenario.name}: when what is computed. */\n"
            f'#include "{"child" if self._hosted else "model"}.h"\n\n'
            "#include <math.h>\n#include <stddef.h>\n#include <stdint.h>\n#include <string.h>",
            *tables,
            courses,
            PLACE_OF if any("place_of(" in function for function in (*functions, tick)) else "",
            *functions,
            self._start(),
            tick,
        ]
        return "\n\n".join(part.strip("\n") for part in parts if part) + "\n"

    def _start(self) -> str:
        lines: list[str] = []
        for law in self._laws:
            lines += law.starts()
        if self._streams:
            words = words_of(self._scenario.seed).tolist()
            if self._has_seed:
                lines.append("const uint32_t seed[4] = {(uint32_t)integers[0], 0, 0, 0};")
            else:
                lines.append(f"const uint32_t seed[{len(words)}] = {{{', '.join(f'{word}u' for word in words)}}};")
            lines += [
                f"for (int i = 0; i < {len(self._streams)}; i++) {{",
                f"    stream_begin(&memory->streams[i], seed, {len(words)}, stream_names[i]);",
                "}",
            ]
        unused = ["(void)parameters;", *([] if self._has_seed else ["(void)integers;"])]
        head = "void model_start(const double *parameters, const int *integers, Memory *memory)"
        names = stream_names(self._streams) + "\n\n" if self._streams else ""
        return f"{names}{head}\n{{\n{block([*unused, *lines])}}}"

    def _tick(self, source: CSource) -> str:
        robots, width = len(self._robots), self._width
        lines = ["/* Sense */", f"double measured[{robots}][{width}];"]
        for row, robot in enumerate(self._robots):
            entries = [self._input(robot, role.name) for role in robot.kind.pose] + ["NAN"] * width
            lines += [f"measured[{row}][{column}] = {entries[column]};" for column in range(width)]
        if self._sensors.function:
            lines.append("sense(tick, measured, memory);")
        lines += ["", "/* Control */"]
        period = self._scenario.period
        control = [
            line
            for law, leader in zip(self._laws, self._leaders, strict=True)
            for line in self._law(law, leader, source)
        ]
        lines += (
            [f"if (tick % {period} == 0) {{", *(f"    {line}" if line else "" for line in control), "}"]
            if period > 1
            else control
        )
        lines += ["", "/* Actuate */"]
        lines += [
            f"double acting[{len(self._followers)}][{self._commands}];",
            "memcpy(acting, memory->command, sizeof acting);",
        ]
        if self._actuators.function:
            lines.append("actuate(tick, acting, memory);")
        lines.append("")
        for index, (port, result) in enumerate(zip(self._outputs, self._results, strict=True)):
            unit = f" [{port.unit}]" if port.unit else ""
            lines.append(f"outputs[{index}] = {result}; /* {port.name}{unit} */")
        lines += ["(void)parameters;", "(void)integers;", "(void)tool;", "return NULL;"]
        head = (
            "const char *model_tick(long long tick, const double *inputs, const double *parameters,\n"
            "                       const int *integers, Memory *memory, struct Tool *tool, double *outputs)"
        )
        return f"{head}\n{{\n{block(lines)}}}"

    def _law(self, law: LawInC | LawInHost, leader: LeaderInC, source: CSource) -> Iterator[str]:
        team, taken = law.team, law.taken
        yield from law.declares(source)
        for index, row in enumerate(team.rows.tolist()):
            robot, own = self._setup.followers[row], 1 + self._places.index(row)
            for column in range(len(team.vehicle.pose)):
                yield f"{taken}.pose[{index}][{column}] = measured[{own}][{column}];"
            for column, role in enumerate(robot.kind.velocity):
                value = self._input(robot, role.name) if _needs(law) else "NAN"
                yield f"{taken}.velocity[{index}][{column}] = {value};"
            for part in fc.Desired._fields:
                for column in range(2):
                    course = getattr(self._setup.desired, part)[:, row, column]
                    value = self._courses.of(f"{robot.name}: {part}[{column}]", course)
                    yield f"{taken}.{part.replace('q', 'q_d', 1)}[{index}][{column}] = {value};"
        kind = self._setup.leader.kind
        velocities = [self._input(self._setup.leader, role.name) for role in kind.velocity]
        accelerations = (
            [self._input(self._setup.leader, f"der_{role.name}") for role in kind.velocity]
            if self._setup.motion is not None
            else ["0.0"] * len(kind.velocity)
        )
        yield from leader.lines(source, taken, "measured[0]", velocities, accelerations)
        yield from law.ticks(self._gains[law.label])
        commands = len(team.vehicle.command)
        for index, row in enumerate(team.rows.tolist()):
            own = self._places.index(row)
            robot = self._setup.followers[row].name
            for column in range(self._commands):
                if column >= commands:
                    yield f"memory->command[{own}][{column}] = NAN;"
                    continue
                yield (
                    f"if (!isfinite({law.command}[{index}][{column}])) "
                    f'return "the law\'s command for {robot} is not finite";'
                )
                yield f"memory->command[{own}][{column}] = {law.command}[{index}][{column}];"
        yield ""


def _needs(law: LawInC | LawInHost) -> bool:
    return law.team.measured


def _ziggurat() -> str:
    """Return NumPy's tables of the ziggurat, which Numba has."""
    from numba.np.random import _constants as tables

    text = "/* The layers of the ziggurat, as NumPy has them. */\n#ifndef ZIGGURAT_H\n#define ZIGGURAT_H\n\n"
    text += "#include <stdint.h>\n\n"
    text += numbers("double ziggurat_heights[256]", tables.fi_double) + "\n\n"
    text += numbers("double ziggurat_widths[256]", tables.wi_double) + "\n\n"
    text += table("uint64_t ziggurat_inside[256]", (f"{int(n)}u" for n in tables.ki_double.tolist())) + "\n\n"
    text += f"static const double ziggurat_tail = {number(tables.ziggurat_nor_r)};\n"
    text += f"static const double ziggurat_tail_scale = {number(tables.ziggurat_nor_inv_r)};\n\n#endif\n"
    return text
