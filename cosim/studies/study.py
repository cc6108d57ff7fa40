"""A study as it is read: the scenario, what varies in it, how that is sampled, what is measured and what must hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from cosim.errors import Location
from cosim.scenario.document import Document
from cosim.scenario.edits import Change
from cosim.scenario.scenario import Expectation, Scenario
from cosim.studies.values import Values

COST = "cost"
"""The name of what a tuning makes least, for requirements."""


@dataclass(frozen=True)
class Target:
    """Where in the scenario a value goes: factor times the value, plus an offset.

    Attributes
    ----------
    select : str
        The XPath.
    factor, offset : tuple of float and str, or None
        A quantity; None to leave the value as it is.
    entry : int
        Which of several numbers with spaces between them it is, from 1; 0 for all that is there.
    """

    select: str
    factor: tuple[float, str] | None = None
    offset: tuple[float, str] | None = None
    where: Location = field(default_factory=lambda: Location(""))
    entry: int = 0


@dataclass(frozen=True)
class Vary:
    """A value that differs from run to run.

    Attributes
    ----------
    values : Values
        The values; of cases, their names.
    targets : tuple of Target
        Where the value goes; none for cases.
    cases : bool
        Whether each value is a change of the scenario's structure.
    crossed : bool
        Whether every draw is run with each of its values.
    case : str
        The case that alone has the value; empty if all have it.
    """

    name: str
    values: Values
    targets: tuple[Target, ...]
    cases: bool
    crossed: bool
    where: Location
    case: str = ""


@dataclass(frozen=True)
class Sample:
    """How the runs are chosen.

    Attributes
    ----------
    runs : int or None
        How many draws, of a sensitivity at most; None where it follows from the values.
    second_order : bool
        Whether a sensitivity is about pairs of values, too.
    """

    method: str
    runs: int | None
    seed: int
    where: Location
    second_order: bool = False


@dataclass(frozen=True)
class Cost:
    """A part of a sum: a measure over a quantity, which makes it a pure number.

    Attributes
    ----------
    of : int
        The index of the measure.
    per : float
        In the measure's unit; negative for a measure that is made greatest.
    """

    of: int
    per: float


@dataclass(frozen=True)
class Tune:
    """A search for the values with the least cost, in each case by itself.

    Attributes
    ----------
    values : tuple of int
        Which of the varied values are tuned.
    costs : tuple of Cost
        What is added up.
    method : str
        ``cma_es`` or ``tpe``.
    evaluations : int
        How many trials each case has, over all restarts.
    restarts : int
        How many searches there are, each from another start.
    batch : int
        How many trials a search asks for at once.
    seed : int
        Seed of the searches.
    training, held_out : tuple of int
        Numbers of the draws that each trial is run on, and on which the best one is compared with the scenario's own.
    confidence : float
        Of that comparison.
    prune : float or None
        A trial ends as soon as it is worse than the best one, with a probability of error of at most this.
    """

    values: tuple[int, ...]
    costs: tuple[Cost, ...]
    method: str
    evaluations: int
    restarts: int
    batch: int
    seed: int
    training: tuple[int, ...]
    held_out: tuple[int, ...]
    confidence: float
    prune: float | None
    fails: str
    where: Location


@dataclass(frozen=True)
class Search:
    """A search for the worst case.

    Attributes
    ----------
    runs : int
        How many it may make.
    batch : int
        How many it asks for at once.
    seed : int
        Its seed.
    early : bool
        Whether it ends with the batch in which a run fails.
    """

    runs: int
    batch: int
    seed: int
    early: bool
    fails: str
    where: Location


@dataclass(frozen=True)
class Measured:
    """A figure of each run.

    Attributes
    ----------
    over : str
        What it is of several followers: the ``worst`` one, the ``mean``, or the ``count`` of those that have a figure.
        Empty for a sum.
    greatest_is_worst : bool
        Whether the worst is the greatest.
    unit : str
        Its unit; empty for a pure number.
    parts : tuple of Cost
        Of a sum: the measures before it that are added up.
    """

    name: str
    over: str
    greatest_is_worst: bool
    unit: str
    where: Location
    parts: tuple[Cost, ...] = ()


@dataclass(frozen=True)
class Requirement:
    """What must hold of all runs together: an element with its attributes, see `cosim.studies.requirements`.

    Attributes
    ----------
    kind : str
        The element's name.
    attributes : dict
        Its attributes as they are written.
    given : tuple of Requirement
        Which values count alone.
    """

    kind: str
    attributes: Mapping[str, str]
    where: Location
    given: tuple[Requirement, ...] = ()

    @property
    def given_in_words(self) -> str:
        """Which values count alone; empty if all do."""
        told = " and ".join(f"{one.attributes['vary']} {one.attributes['is']}" for one in self.given)
        return f"given {told}" if told else ""


@dataclass(frozen=True)
class Keep:
    """Runs whose full results are kept.

    Attributes
    ----------
    words : frozenset of str
        ``all``, and the ``worst`` and the ``median`` run.
    ranges : tuple of (int, int)
        The first and the last number of runs.
    of : int or None
        The index of the measure that says which run is worst; None: the least margin of a run does.
    """

    words: frozenset[str]
    ranges: tuple[tuple[int, int], ...]
    of: int | None
    where: Location


@dataclass(frozen=True)
class Study:
    """Many runs of one scenario.

    Attributes
    ----------
    document : Document
        Its file; paths in it and in its scenarios are relative to the file's folder.
    bases : dict
        The scenario with the rules of one case of each value that has cases, by the indices of these cases. Its last
        expectations are the measures.
    vary, measures, requirements : tuple
        In the order of the file.
    sample : Sample
        How draws are chosen; of a search, those of what is not searched.
    own : dict
        What each scenario has where a value goes, by the XPath; by the indices of cases as `bases`.
    naming : dict
        The XPaths of values that name a file, an environment or a package; each with the name of its element.
    tune : Tune or None
        What is tuned.
    search : Search or None
        How the worst case is searched.
    changes : tuple
        Made in every scenario, before the study's own.
    keep : tuple of Keep
        The runs whose full results are kept.
    envelopes : tuple of Expectation
        Signals of which all runs are drawn together; see `cosim.studies.courses`.
    """

    document: Document
    name: str
    title: str
    vary: tuple[Vary, ...]
    sample: Sample
    measures: tuple[Measured, ...]
    requirements: tuple[Requirement, ...]
    bases: Mapping[tuple[int, ...], Scenario]
    own: Mapping[tuple[int, ...], Mapping[str, str]] = field(default_factory=dict)
    naming: Mapping[str, str] = field(default_factory=dict)
    tune: Tune | None = None
    search: Search | None = None
    changes: tuple[Change, ...] = ()
    keep: tuple[Keep, ...] = ()
    envelopes: tuple[Expectation, ...] = ()
