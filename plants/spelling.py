"""How people write units elsewhere, respelled as expressions: ``Nm`` as ``N.m``, ``°`` as ``deg``, ``m²`` as ``m2``.

A respelling is a proposal for an error message. No unit is read through it.
"""

import re
import unicodedata

_WORDS = {
    "deg": "° º degree degrees degs",
    "rad": "radian radians rads",
    "rev": "revolution revolutions turn turns",
    "m": "metre metres meter meters mtr",
    "cm": "centimetre centimetres centimeter centimeters",
    "mm": "millimetre millimetres millimeter millimeters",
    "km": "kilometre kilometres kilometer kilometers",
    "s": "sec secs second seconds",
    "ms": "msec msecs millisecond milliseconds",
    "min": "mins minute minutes",
    "h": "hr hrs hour hours",
    "g": "gram grams",
    "kg": "kilo kilos kgs kilogram kilograms kilogramme kilogrammes",
    "t": "ton tons tonne tonnes",
    "N": "newton newtons",
    "kN": "kilonewton kilonewtons",
    "N.m": "nm newtonmetre newtonmetres newtonmeter newtonmeters",
    "kN.m": "knm",
    "N.mm": "nmm",
    "N.cm": "ncm",
    "N.s": "ns",
    "J": "joule joules",
    "W": "watt watts",
    "V": "volt volts",
    "A": "amp amps ampere amperes",
    "K": "kelvin",
    "Pa": "pascal pascals",
    "Hz": "hertz",
    "Ohm": "ω",
    "%": "percent",
    "m/s": "mps",
    "km/h": "kmh kph kmph",
    "rev/min": "rpm upm",
    "1": "- none dimensionless",
}
_MEANT = {word: unit for unit, words in _WORDS.items() for word in words.split()}
_MEANT |= {unit.casefold(): unit for unit in _WORDS if len(unit) > 1}

_SYMBOLS = str.maketrans({"−": "-", "μ": "u", "⁄": "/"})
_TIMES = re.compile(r"\s*[*·⋅•×∙]\s*|\s+")
_FACTOR = re.compile(r"(.*?)([+-]?[0-9])?", re.DOTALL)


def respelled(text: str) -> str:
    """Return the unit expression that a text probably means; it may be no valid one."""
    text = unicodedata.normalize("NFKC", text.strip().replace("º", "°")).translate(_SYMBOLS)  # "m²" becomes "m2"
    if text.casefold() in _MEANT:  # as a whole: "rev/min" is a word here, and so is "-"
        return _MEANT[text.casefold()]
    text = re.sub(r"\s*/\s*", "/", re.sub(r"\*\*|\^", "", text))
    numerator, *denominators = text.split("/")
    below = ".".join(_product(factor.strip("()")) for factor in denominators)
    above = _product(numerator) or "1"
    return above + (f"/({below})" if "." in below else f"/{below}" if below else "")


def _product(text: str) -> str:
    factors = _TIMES.sub(".", text.strip(" ()")).split(".")
    return ".".join(_factor(factor) for factor in factors)


def _factor(text: str) -> str:
    match = _FACTOR.fullmatch(text)
    assert match is not None, "any text is a symbol and perhaps an exponent"
    symbol, exponent = match[1], match[2] or ""
    return _MEANT.get(symbol.casefold(), symbol) + exponent
