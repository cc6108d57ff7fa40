"""The command line ``formation``.

Exit status: 0 all expectations hold; 1 an expectation failed; 2 bad input; 3 the simulation itself failed;
70 a fault of Formation itself; 71 the machine lacks something; 130 interrupted. A command imports its libraries when it
runs, so that the others start at once.
"""

from __future__ import annotations

import argparse
import gc
import os
import signal
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from importlib.metadata import version
from pathlib import Path

from cosim.cli.completing import SHELLS
from cosim.cli.console import err, refused
from cosim.cli.ending import ended_by
from cosim.cli.help_texts import explain
from cosim.cli.options import Lazy, Parser
from cosim.compiling import told
from cosim.errors import OutputError
from cosim.master.interrupt import SIGNALS, HeldSignals

INTERRUPTED = 130


def entry() -> None:
    """Run the command line and exit with its status."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # more would only wait; without them NumPy raises SIGINT
    try:
        status = _status(None)
    except KeyboardInterrupt:  # one more, while another one was dealt with
        status = INTERRUPTED
    for number in SIGNALS:  # the command has ended, and its status stands
        signal.signal(number, signal.SIG_IGN)
    exec("")  # if Ctrl-C has struck in a text that was executed, as for a dataclass, `python -m` ends by it otherwise
    gc.freeze()  # without it the interpreter searches all objects of the libraries for garbage before it ends
    sys.exit(status)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    handlers = {number: signal.getsignal(number) for number in SIGNALS}
    try:
        return _status(arguments)
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


def _status(arguments: Sequence[str] | None) -> int:
    try:
        options = _parser().options(arguments)
    except Exception as error:
        return ended_by(error)[1]
    try:
        _interrupt_by_signals()
        started = time.perf_counter()
        function = _function(options.command)
        options.imports = time.perf_counter() - started
        refused()  # by an earlier command
        with told(_tell_compiling):
            status = function(options)
        if (why := refused()) is not None and status == 0:
            raise OutputError(f"standard output cannot be written: {why.strerror}") from why
        return status
    except KeyboardInterrupt:
        with suppress(KeyboardInterrupt), HeldSignals():
            err().print("interrupted")
        return INTERRUPTED
    except (Exception, SystemExit) as error:  # code of others may call sys.exit()
        return ended_by(error)[1]


def _tell_compiling() -> None:
    err().print("compiling controllers and the simulation loop for this machine; the next run finds them compiled")


def _interrupt_by_signals() -> None:
    """Let `kill`, `timeout` and the end of a terminal clean up as Ctrl-C does.

    Ctrl-C, too: a script that starts a command in the background lets it ignore SIGINT, and the command would react to
    it in one moment and not in the next. `nohup` stays what it is.
    """
    for number in SIGNALS:
        if number.name != "SIGHUP" or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler)


def _kinds() -> list[str]:
    from cosim.scenario.first_scenario import kinds_with_example

    return list(kinds_with_example())


def _completion(options: argparse.Namespace) -> int:
    from cosim.cli.completing import completion

    return completion(_parser(), options.shell)


_COMMANDS = {
    "run": "cosim.cli.run.run",
    "resume": "cosim.cli.resuming.resume",
    "study": "cosim.cli.studying.study",
    "show": "cosim.cli.show.show",
    "report": "cosim.cli.reporting.report",
    "export": "cosim.cli.exporting.export",
    "import": "cosim.cli.importing.import_system",
    "export-controller": "cosim.cli.exporting_controllers.export_controllers",
    "judge": "cosim.cli.judging.judge",
    "check": "cosim.cli.check.check",
    "build": "cosim.cli.build.build",
    "inspect": "cosim.cli.inspecting.inspect",
    "swap": "cosim.cli.swapping.swap_plants",
    "compare-plants": "cosim.cli.comparing.compare",
    "new": "cosim.cli.new_scenario.new",
    "examples": "cosim.cli.new_scenario.copy_examples",
    "list": "cosim.cli.listing.inventory",
    "env": "cosim.cli.environments.environments",
    "completion": "cosim.cli._completion",
}
"""The function behind each command; it takes the options and returns the exit status."""


def _function(command: str) -> Callable[[argparse.Namespace], int]:
    module, _, name = _COMMANDS[command].rpartition(".")
    function: Callable[[argparse.Namespace], int] = getattr(import_module(module), name)
    return function


def _parser() -> Parser:
    parser = Parser(prog="formation", description="Co-simulation test bench for formations of wheeled robots.")
    parser.add_argument("--version", action="version", version=f"formation-cosim {version('formation-cosim')}")
    commands = parser.add_subparsers(title="commands", dest="command", required=True, metavar="COMMAND")

    def command(name: str, about: str) -> argparse.ArgumentParser:
        return commands.add_parser(name, help=about, description=f"{about[0].upper()}{about[1:]}.")

    run = command("run", "run scenarios and write results, summary, figure and page to DIR/NAME/")
    _add_scenarios(run)
    _add_strict(run, otherwise="")
    run.add_argument("--out", type=Path, default=Path("runs"), metavar="DIR", help="folder of the results (runs)")
    run.add_argument("--no-figure", dest="figure", action="store_false", help="draw no figure")
    run.add_argument("--no-report", dest="report", action="store_false", help="write no page for the browser")
    run.add_argument("--junit", type=Path, metavar="FILE.xml", help="write all verdicts as JUnit XML")
    run.add_argument(
        "--pace",
        type=float,
        metavar="FACTOR",
        help="keep pace with FACTOR times real time (1: real time), and report ticks that came late",
    )
    run.add_argument(
        "--live",
        action="store_true",
        help="show the run on a page in the browser while it goes on, at an address that is printed; on a terminal the "
        "page stays until its last viewer leaves or Ctrl-C, elsewhere a page that nobody looks at ends with the run",
    )
    run.add_argument("--open", action="store_true", help="open the live page in the browser")
    run.add_argument("--port", type=int, metavar="N", help="port of the live page (any that is free)")
    run.add_argument(
        "--paused", action="store_true", help="wait at the first tick until the live page lets the run go on"
    )
    run.add_argument("--timing", action="store_true", help="print where the time went")
    _add_course(run)

    resume = command("resume", "go on with a run that was killed, interrupted or left, or branch off from a moment")
    resume.add_argument("folder", type=Path, metavar="DIR", help="the folder of a run with checkpoints, runs/NAME")
    resume.add_argument("--at", metavar="TIME", help="the moment from which the run goes on (the last checkpoint)")
    resume.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="XPATH=VALUE",
        help="from there on, set the attribute or text that an XPath selects; the result goes to a folder of its own",
    )
    resume.add_argument("--horizon", metavar="TIME", help="an earlier end of the run, such as '60 s'")
    resume.add_argument(
        "--no-expectations", dest="expectations", action="store_false", help="leave out all expectations"
    )
    _add_course(resume)
    resume.add_argument("--out", type=Path, metavar="DIR", help="folder of a run with changes (beside DIR)")
    resume.add_argument("--no-figure", dest="figure", action="store_false", help="draw no figure")
    resume.add_argument("--no-report", dest="report", action="store_false", help="write no page for the browser")
    resume.add_argument(
        "--pace", type=float, metavar="FACTOR", help="keep pace with FACTOR times real time (1: real time)"
    )
    resume.add_argument("--timing", action="store_true", help="print where the time went")
    resume.set_defaults(strict=False)

    study = command("study", "make the many runs of a study, and judge them together")
    study.add_argument("study", type=Path, metavar="STUDY.xml")
    study.add_argument("--workers", type=int, metavar="N", help="processes that make the runs (one a processor)")
    study.add_argument("--scheduler", metavar="ADDRESS", help="let the workers of a scheduler of Dask make the runs")
    study.add_argument("--runs", type=int, metavar="N", help="make the first N runs only, for a first look")
    study.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="XPATH=VALUE",
        help="set the attribute or text that an XPath selects, in every run",
    )
    study.add_argument(
        "--keep",
        default="",
        metavar="RUNS",
        help='keep the full results of some runs, too: all, worst, median, or numbers such as "3" or "5 to 9"',
    )
    study.add_argument("--no-figure", dest="figure", action="store_false", help="draw no figure")
    study.add_argument("--no-report", dest="report", action="store_false", help="write no page for the browser")
    study.add_argument("--junit", type=Path, metavar="FILE.xml", help="write the verdicts as JUnit XML")
    study.add_argument("--out", type=Path, default=Path("runs"), metavar="DIR", help="folder of the results (runs)")

    show = command("show", "show the summary of a finished run, with its exit status")
    show.add_argument("results", nargs="+", type=Path, metavar="RESULT.nc", help="a result, or the folder of a run")
    show.add_argument("--figure", type=Path, metavar="FILE.png", help="also draw the figure")
    show.add_argument(
        "--panels",
        choices=("all", "paper"),
        default="all",
        help="panels of the figure: of all that the run has (all), or those of the paper's Figure 6 (paper)",
    )

    report = command("report", "write the page that shows a finished run or study in a browser, or compares runs")
    report.add_argument(
        "results", nargs="+", type=Path, metavar="RESULT.nc", help="a result, or the folder of a run or of a study"
    )
    report.add_argument(
        "--out",
        type=Path,
        metavar="FILE.html",
        help="file of the page (report.html beside the result; of several, here)",
    )

    export = command(
        "export",
        "write a finished run for other tools: MCAP of ROS 2, CSV, MATLAB, moving pictures; or a scenario as FMUs for "
        "other masters: SSP",
    )
    export.add_argument(
        "result",
        type=Path,
        metavar="RESULT.nc",
        help="a result, or the folder of a run; with --ssp or --fmu a scenario",
    )
    export.add_argument(
        "--out",
        action="append",
        type=Path,
        metavar="FILE",
        help="the file, whose ending states the format: .mcap, .csv, .mat, .gif, .png or .mp4 (result.mcap beside the "
        "result)",
    )
    export.add_argument(
        "--start-time",
        default="0",
        metavar="TIME",
        help="time of the run's start in .mcap, as in 2026-05-04T09:30:00Z or as seconds since 1970 (0)",
    )
    film = export.add_argument_group("moving pictures (.gif, .png, .mp4)")
    film.add_argument("--from", dest="begin", metavar="TIME", help="time in the run at which it begins, such as '20 s'")
    film.add_argument("--to", dest="end", metavar="TIME", help="time in the run at which it ends")
    film.add_argument("--speed", type=float, metavar="FACTOR", help="times real time (it lasts about 12 s)")
    film.add_argument("--fps", type=float, default=20.0, metavar="NUMBER", help="frames per second (20)")
    film.add_argument("--size", default="800x450", metavar="WxH", help="width and height in pixels (800x450)")

    system = export.add_argument_group("scenarios for other masters")
    system.add_argument("--ssp", type=Path, metavar="FILE.ssp", help="write the scenario as a system of FMUs")
    system.add_argument("--ssp-version", choices=["1.0", "2.0"], default="1.0", help="version of SSP (1.0)")
    system.add_argument("--fmu", type=Path, metavar="FILE.fmu", help="write the whole formation as one FMU")
    _add_changes(system)

    load = command("import", "make a scenario of an SSP, a system of FMUs")
    load.add_argument("ssp", type=Path, metavar="FILE.ssp")
    load.add_argument(
        "--out",
        type=Path,
        metavar="NAME.xml",
        help="file of the scenario (here, named after the SSP); its FMUs and bindings go to NAME_files/ beside it",
    )
    load.add_argument("--force", action="store_true", help="overwrite files")

    team = command("export-controller", "make FMUs of a scenario's controllers, with their sensors and actuators")
    team.add_argument("scenario", type=Path, metavar="SCENARIO.xml")
    team.add_argument("--only", action="append", default=[], metavar="ID", help="only the controller ID (all)")
    _add_build(team)
    _add_changes(team)

    judge = command("judge", "judge a recorded drive by the expectations of a scenario")
    judge.add_argument(
        "recording",
        type=Path,
        metavar="RECORDING",
        help="an MCAP file, a ROS 2 bag, a CSV file, or the result of a run",
    )
    judge.add_argument("--scenario", type=Path, required=True, metavar="SCENARIO.xml", help="whose expectations")
    judge.add_argument(
        "--map", type=Path, metavar="MAPPING.xml", help="the mapping, which says where the recording has the poses"
    )
    judge.add_argument(
        "--start",
        metavar="TIME",
        help="time in the recording at which the scenario begins, in seconds or as a date (that of the first poses)",
    )
    judge.add_argument("--junit", type=Path, metavar="FILE.xml", help="write the verdicts as JUnit XML")
    judge.add_argument(
        "--out", type=Path, metavar="DIR", help="write result, summary and page of the drive to DIR/NAME/"
    )
    _add_changes(judge)

    check = command("check", "check scenarios and show their content, without running them")
    _add_scenarios(check)
    _add_strict(check)
    check.add_argument(
        "--resolved",
        action="store_true",
        help="print only the XML of the scenario, with all variants and edits applied",
    )

    build = command("build", "build FMUs of the built-in models")
    build.add_argument("models", nargs="*", metavar="MODEL", help="built-in models to build (all)")
    _add_build(build)

    inspect = command("inspect", "show the content of an FMU, and the kinds of vehicle that it could be")
    inspect.add_argument("fmu", type=Path, metavar="FILE.fmu")
    inspect.add_argument("--all", action="store_true", help="show all variables and warnings, however many")
    inspect.add_argument(
        "--self-test", action="store_true", help="replay the reference experiments in the FMU, and compare"
    )
    inspect.add_argument(
        "--time-limit",
        type=float,
        default=60.0,
        metavar="SECONDS",
        help="time limit for an experiment of --self-test (60)",
    )
    _add_strict(inspect)

    swap = command("swap", "replace plants of a scenario by other FMUs: write a variant, and bindings to complete")
    swap.add_argument("scenario", type=Path, metavar="SCENARIO.xml")
    swap.add_argument(
        "--plant",
        action="append",
        required=True,
        metavar="ID=FILE.fmu",
        help="a plant of the scenario, and the FMU that replaces it",
    )
    swap.add_argument(
        "--binding",
        action="append",
        default=[],
        metavar="ID=FILE.xml",
        help="a plant, and the binding of its FMU; without it, a binding is proposed and written",
    )
    swap.add_argument(
        "--no-probe",
        dest="probe",
        action="store_false",
        help="run no FMU; by default an FMU with open questions is driven for a second, to see which outputs move",
    )
    swap.add_argument(
        "--out",
        type=Path,
        metavar="FILE.xml",
        help="file of the variant (beside the scenario, named after scenario and FMU)",
    )
    swap.add_argument("--force", action="store_true", help="overwrite files")

    compare = command("compare-plants", "drive two plants with the same commands and show how far apart they are")
    _add_comparison(compare)

    new = command("new", "write a commented scenario to start from")
    new.add_argument(
        "file", type=Path, metavar="NAME.xml", help="file of the scenario; its name is the scenario's name"
    )
    new.add_argument(
        "--vehicle", choices=Lazy(_kinds), default="car_like", metavar="KIND", help="kind of vehicle (car_like)"
    )
    new.add_argument("--followers", type=int, default=2, metavar="N", help="number of followers (2)")
    new.add_argument("--force", action="store_true", help="overwrite the file")

    examples = command("examples", "copy the scenarios that come with Formation into a folder")
    examples.add_argument(
        "folder", type=Path, nargs="?", default=Path("scenarios"), metavar="DIR", help="the folder (scenarios)"
    )
    examples.add_argument("--force", action="store_true", help="overwrite files")

    command("list", "list plants, controllers and scenarios, and the path of the schema")

    env = command("env", "make a Python environment for controllers, or list the controllers in one")
    env.add_argument("action", choices=["create", "list"], help="make the environment, or list what is in it")
    env.add_argument("folder", type=Path, metavar="DIR", help="the folder of the environment")
    env.add_argument(
        "packages",
        nargs="*",
        metavar="PACKAGE",
        help="packages to install: each a name with its version, as in 'my-laws==0.2', a wheel, or a project's folder",
    )
    env.add_argument("--python", default="", metavar="PYTHON", help="the Python of the environment (Formation's own)")
    env.add_argument(
        "--wheels", type=Path, metavar="DIR", help="take packages from this folder of wheels, and download nothing"
    )
    env.add_argument(
        "--share",
        action="store_true",
        help="use NumPy, Numba and other libraries beside Formation; only the packages that are named are installed",
    )

    completion = command("completion", "print the script that makes a shell complete the command line")
    completion.add_argument("shell", choices=SHELLS)

    explain(parser)
    return parser


def _add_strict(command: argparse.ArgumentParser, otherwise: str = " (default: a warning)") -> None:
    command.add_argument("--strict", action="store_true", help=f"refuse an FMU that breaks a rule of FMI{otherwise}")


def _add_course(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--checkpoint",
        metavar="every=TIME",
        help="write a checkpoint every TIME of the run, such as every=10s, from which formation resume goes on",
    )
    command.add_argument(
        "--until", metavar="TIME", help="leave the run at this time, after a checkpoint; nothing is judged yet"
    )


def _add_scenarios(command: argparse.ArgumentParser) -> None:
    command.add_argument("scenarios", nargs="+", type=Path, metavar="SCENARIO.xml")
    _add_changes(command)


def _add_changes(command: argparse.ArgumentParser | argparse._ArgumentGroup) -> None:
    command.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="XPATH=VALUE",
        help="set the attribute or text that an XPath selects, as in '//gain[@name=\"gamma_w\"]/@value=0.1'",
    )
    command.add_argument("--seed", type=int, metavar="N", help="seed of the noise, in place of the scenario's")
    command.add_argument("--horizon", metavar="TIME", help="end of the run, in place of the scenario's, such as '2 s'")
    command.add_argument(
        "--no-expectations", dest="expectations", action="store_false", help="leave out all expectations"
    )
    command.add_argument("--plant", action="append", default=[], metavar="ID=FMU", help="use this FMU for the plant ID")
    command.add_argument(
        "--binding",
        action="append",
        default=[],
        metavar="ID=FILE.xml",
        help="use this binding for the plant ID; the file assigns variables of the FMU to roles",
    )
    command.add_argument(
        "--untrusted",
        action="append",
        default=[],
        type=Path,
        metavar="DIR",
        help="run each plant whose FMU is in this folder in a process of its own",
    )
    command.add_argument(
        "--controller",
        action="append",
        default=[],
        metavar="ID=NAME",
        help="use this control law for the controller ID, with its default gains for all followers; a controller that "
        "has this law already keeps its gains",
    )
    command.add_argument(
        "--environment",
        action="append",
        default=[],
        metavar="ID=DIR",
        help="run the law of the controller ID, with its gains, in the Python environment in this folder",
    )


def _add_build(command: argparse.ArgumentParser) -> None:
    command.add_argument("--fmi", choices=["2", "3"], default="2", help="version of FMI (2)")
    command.add_argument(
        "--platform",
        action="append",
        metavar="NAME",
        help="platform to build for, such as windows-x86_64, or 'all' (this machine)",
    )
    command.add_argument("--out", type=Path, default=Path("fmus"), metavar="DIR", help="folder of the FMUs (fmus)")


def _add_comparison(command: argparse.ArgumentParser) -> None:
    for side in "ab":
        command.add_argument(side, metavar=f"{side.upper()}.fmu", help="an FMU, or the name of a built-in model")
    for side in "ab":
        name = side.upper()
        command.add_argument(
            f"--binding-{side}", metavar="FILE.xml", help=f"binding of {name}, which assigns its variables to roles"
        )
        command.add_argument(
            f"--interface-{side}",
            choices=["co_simulation", "model_exchange"],
            default="",
            help=f"interface of {name} to use (co_simulation)",
        )
        command.add_argument(
            f"--solver-{side}",
            choices=["euler", "runge_kutta_4", "cvode"],
            default="",
            help=f"solver of {name} in Model Exchange (runge_kutta_4)",
        )
        command.add_argument(
            f"--start-{side}",
            choices=["first_step"],
            default="",
            help=f"ignore the outputs of {name} before its first step",
        )
        command.add_argument(
            f"--parameter-{side}", action="append", default=[], metavar="NAME=VALUE", help=f"a parameter of {name}"
        )
    command.add_argument(
        "--parameter",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a parameter of both, by its name or its role, such as 'a=1.5 m'",
    )
    command.add_argument("--duration", default="20 s", metavar="TIME", help="length of the drive (20 s)")
    command.add_argument("--step", default="20 ms", metavar="TIME", help="communication step (20 ms)")
    command.add_argument(
        "--pose",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="an entry of the initial pose, such as 'psi=30 deg'",
    )
    command.add_argument(
        "--torque",
        type=Path,
        metavar="FILE.csv",
        help="a table with 'time [s]' and the commands, such as 'tau_drive [N.m]' (default: steps and sines)",
    )
    command.add_argument("--seed", type=int, default=1, metavar="N", help="seed of the phases of the sines (1)")
    command.add_argument(
        "--within",
        action="append",
        default=[],
        metavar="[ROLE=]VALUE",
        help="largest difference allowed, such as '1 mm' or 'psi=0.1 deg'; exit status 1 beyond it",
    )
    command.add_argument("--out", type=Path, metavar="DIR", help="folder of the results (runs/A_and_B)")
    command.add_argument("--no-figure", dest="figure", action="store_false", help="draw no figure")
