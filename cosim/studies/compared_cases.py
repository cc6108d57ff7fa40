"""Which two cases of a value an envelope compares: their courses on the same draw are subtracted."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cosim.scenario.scenario import Expectation
from cosim.scenario.written_element import Written
from cosim.studies.courses import Envelope
from cosim.studies.draws import check_two_cases, value_named
from cosim.studies.study import Study
from cosim.studies.values import Finite

COMPARED = ("vary", "case", "than")
"""The attributes that say it; the runs are the same without them."""


@dataclass(frozen=True)
class ComparedCases:
    """Two cases.

    Attributes
    ----------
    place : int
        The index of the value.
    case, than : str
        The case, and the one that is subtracted.
    """

    place: int
    case: str
    than: str

    def __str__(self) -> str:
        """Return them in words."""
        return f"{self.case} minus {self.than}"


def compared_cases(study: Study, envelope: Expectation) -> ComparedCases | None:
    """Return the cases that an envelope compares; None if it compares none.

    Raises
    ------
    InputError
        They make no sense; with the envelope's place.
    """
    given = [name for name in COMPARED if name in envelope]
    if not given:
        return None
    written = Written(envelope.kind, envelope.attributes, envelope.where, Path())
    name, case, than = map(written.get, COMPARED)
    if len(given) < len(COMPARED):
        missing = next(one for one in COMPARED if one not in given)
        raise written.error(f"<envelope> compares two cases by vary=..., case=... and than=...: add {missing}=...")
    place = value_named(study, written, name)
    check_two_cases(study, written, place, case, than, "a case less itself is always zero")
    return ComparedCases(place, case, than)


def check_compared(study: Study) -> None:
    """Refuse envelopes that compare what cannot be compared; raises InputError with their places."""
    for written in study.envelopes:
        compared = compared_cases(study, written)
        if compared is None:
            continue
        having = [index for index, vary in enumerate(study.vary) if vary.cases]
        if compared.place not in having:
            continue
        at, values = having.index(compared.place), study.vary[compared.place].values
        assert isinstance(values, Finite)
        texts = list(values.texts)
        for cases, scenario in study.bases.items():
            if cases[at] == texts.index(compared.case):
                other = study.bases[(*cases[:at], texts.index(compared.than), *cases[at + 1 :])]
                if not np.array_equal(Envelope(written, scenario).times, Envelope(written, other).times):
                    raise written.error(
                        f"{compared}: the two have other instants: end the envelope by to=..., or give both the same "
                        "horizon and step"
                    )
