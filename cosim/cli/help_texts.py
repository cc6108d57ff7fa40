"""The end of each ``--help``: examples, and the meaning of the exit status."""

from __future__ import annotations

import argparse

_STATUS = {
    0: "done",
    1: "an expectation failed",
    2: "bad input, with file, line and column",
    3: "the simulation itself failed; everything recorded up to then is saved",
    70: "a fault of Formation itself; a file has its traceback",
    71: "the machine lacks something: space on the disk, memory, processes",
    130: "interrupted; everything recorded up to then is saved",
}
_OF = {
    "run": {0: "all expectations hold, or the run was left as asked", 1: None, 2: None, 3: None, 130: None},
    "resume": {
        0: "all expectations hold, or the run was left as asked",
        1: None,
        2: "bad input, such as a damaged checkpoint",
        3: None,
        130: None,
    },
    "study": {0: "all holds that must, or nothing was asked for", 1: "something does not hold", 2: None, 130: None},
    "show": {
        0: "all expectations held",
        1: "an expectation failed, or the result lacks samples of its run",
        2: None,
        3: "the simulation failed",
        130: "it was interrupted",
    },
    "judge": {0: "all expectations hold", 1: "an expectation failed, or could not be judged", 2: None},
    "check": {0: "the scenario can be run", 2: None},
    "inspect": {0: None, 1: "a self-test fails", 2: "bad input, such as an FMU without a reference experiment"},
    "compare-plants": {
        0: None,
        1: "the plants differ by more than --within allows, or neither moves by more than that",
        2: None,
        3: "a plant failed",
    },
}
"""Exit statuses of each command; None stands for the words of `_STATUS`."""
_OF_ALL = (70, 71)
"""Exit statuses of every command."""

_EXAMPLES = {
    "run": """\
formation run scenarios/clmr_line.xml
formation run scenarios/*.xml --out results --junit verdicts.xml
formation run mine.xml --set "//gain[@name='gamma_w']/@value=0.1" --seed 2
formation run mine.xml --controller pid=observer-pid
formation run mine.xml --checkpoint every=10s --until 40s
formation run mine.xml --environment pid=envs/new
formation run mine.xml --live --pace 1 --open""",
    "resume": """\
formation resume runs/clmr_line
formation resume runs/clmr_line --at "40 s" --set "//follower[@id='follower_1']/desired/@range=3 m\"""",
    "study": """\
formation study payload.xml
formation study payload.xml --runs 100 --workers 4""",
    "show": "formation show runs/clmr_line/result.nc",
    "report": """\
formation report runs/clmr_line
formation report runs/payload
formation report runs/clmr_line+seed=2 runs/clmr_line --out compared.html""",
    "export": """\
formation export runs/clmr_line
formation export runs/clmr_line --out drive.csv --out drive.mat
formation export runs/clmr_line --out drive.mcap --start-time 2026-05-04T09:30:00Z
formation export scenarios/clmr_line.xml --ssp clmr_line.ssp""",
    "import": "formation import clmr_line.ssp --out mine.xml",
    "judge": """\
formation judge drive.mcap --scenario scenarios/clmr_line.xml
formation judge my_bag --scenario mine.xml --map my_robots.xml --out drives""",
    "check": """\
formation check mine.xml
formation check scenarios/half_power.xml --resolved > scenarios/mine.xml""",
    "build": """\
formation build
formation build car_like --fmi 3 --platform all --out fmus""",
    "export-controller": """\
formation export-controller scenarios/convoy.xml
formation export-controller scenarios/mixed_team.xml --only pid --fmi 3 --platform all""",
    "inspect": """\
formation inspect my_robot.fmu
formation inspect --self-test my_robot.fmu""",
    "swap": "formation swap scenarios/convoy.xml --plant car=my_robot.fmu --out mine.xml",
    "compare-plants": """\
formation compare-plants car_like my_robot.fmu --binding-b my_robot.binding.xml
formation compare-plants old.fmu new.fmu --duration "10 s" --within "1 mm" --within "psi=0.1 deg\"""",
    "new": """\
formation new mine.xml
formation new trucks.xml --vehicle tractor_trailer --followers 4""",
    "examples": """\
formation examples
formation examples my_folder""",
    "list": "formation list",
    "env": """\
formation env create envs/new my-laws==0.2
formation env create envs/mine ./my_laws --share
formation env list envs/new""",
    "completion": """\
formation completion bash > ~/.local/share/bash-completion/completions/formation
formation completion zsh > ~/.zfunc/_formation
formation completion fish > ~/.config/fish/completions/formation.fish
formation completion powershell | Out-String | Invoke-Expression""",
}


class _Formatter(argparse.HelpFormatter):
    """Wraps text, but leaves indented lines unchanged."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        if "\n  " not in text:
            return super()._fill_text(text, width, indent)
        return "".join(indent + line for line in text.splitlines(keepends=True))


def explain(parser: argparse.ArgumentParser) -> None:
    """Add examples and exit statuses to the ``--help`` of a parser and of its commands."""
    parser.formatter_class = _Formatter
    parser.epilog = "\n\n".join(
        [
            _section("start", "formation examples\nformation run scenarios/clmr_line.xml\nformation new mine.xml"),
            "formation COMMAND --help shows its options and examples.",
            _statuses(_OF["run"]),
        ]
    )
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, command in action.choices.items():
                command.formatter_class = _Formatter
                sections = [_section("examples", _EXAMPLES[name])] if name in _EXAMPLES else []
                command.epilog = "\n\n".join([*sections, _statuses(_OF.get(name, {0: None, 2: None}))])


def _section(title: str, text: str) -> str:
    return "\n  ".join([f"{title}:", *text.splitlines()]).replace("%", "%%")


def _statuses(known: dict[int, str | None]) -> str:
    all_known = sorted((known | dict.fromkeys(_OF_ALL)).items())
    return _section("exit status", "\n".join(f"{code:<4} {said or _STATUS[code]}" for code, said in all_known))
