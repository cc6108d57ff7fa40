"""Seeded mutations of scenarios, archives and model descriptions."""

from __future__ import annotations

import io
import random
import re
import zipfile

NAMESPACE = "urn:formation-cosim:scenario:1"
VALUES = [
    "",
    " ",
    "0",
    "-0",
    "-1",
    "1",
    "1e308",
    "1e-320",
    "1e400",
    "-1e308",
    "nan",
    "inf",
    "0 s",
    "-1 s",
    "1e308 s",
    "1e-320 s",
    "1e99 s",
    "1e15 s",
    "0.02 s",
    "100 s",
    "99.99 s",
    "1e308 m",
    "1e-300 m",
    "-1 m",
    "0 m",
    "1e308 N.m",
    "360 deg",
    "1e308 deg",
    "9" * 30,
    "0" * 5000,
    "9" * 5000,
    "1_000",
    "١٢",
    "1 kg",
    "1 m2/s3",
    "1 m99999999",
    "a",
    "leader",
    "follower_1",
    "follower_1 follower_1",
    "x",
    "psi",
    "a" * 200,
    "a" * 5000,
    "../..",
    "/",
    ".",
    "/dev/zero",
    "a/" * 3000,
    "\u202e\u009b",
    "&#0;",
    "&amp;",
    "{}",
    "%s",
    "on",
    "true",
    "cvode",
    "pose",
    "range_error",
    "car_like",
    "tractor_trailer",
    "none.fmu",
]
ENCODINGS = [
    "GBK",
    "UTF-16",
    "UTF-7",
    "idna",
    "undefined",
    "hex",
    "Shift_JIS",
    "latin-1",
    "ascii",
    "bogus",
    "punycode",
    "utf_8",
]
XPATHS = [
    "//gain[1]/@value",
    "//*[@at]",
    "simulation/@seed",
    "//follower[{n}]",
    "//follower//noise/@x",
    "//*[count(//*) > {n}]",
    "//*[//*[//*]]/@x",
    "//parameter[@name='a']/@value",
    "//gain[@name='{v}']/@value",
    "/scenario",
    ".",
    "..",
    "/",
    "//@*",
    "//*[",
    "//text()",
    "//comment()",
    "1 + 1",
    "'a'",
    "//*/following::*",
    "//plant | //event",
    "id('a')",
    "//leader/..",
    "//*[position() = last()]",
    "{v}",
    "//*[contains(., '{v}')]",
    "namespace::*",
    "//*[. = //*]",
    "//desired",
    "//expect/*",
]
_ATTRIBUTE = re.compile(r'([\w:.-]+)="([^"]*)"')
_ELEMENT = re.compile(r"<(\w+)([^<>]*)/>|<(\w+)([^<>]*)>[^<>]*</\3>")
_MANY = (0, 2, 3, 50)


def scenario(text: str, rng: random.Random) -> bytes:
    """Return a scenario, or a variant of ``base.xml``, with one to four mutations."""
    if rng.random() < 0.2:
        return _variant(rng).encode("utf-8", "surrogatepass")
    for _ in range(rng.randint(1, 3)):
        text = rng.choice((_value, _value, _value, _element, _element, _name, _declaration))(text, rng)
    data = text.encode("utf-8", "surrogatepass")
    return flipped(data, rng) if rng.random() < 0.2 else data


def setting(rng: random.Random) -> str:
    """Return a change as the command line takes it."""
    return f"{_xpath(rng)}={rng.choice(VALUES)}"


def markup(text: str, rng: random.Random) -> str:
    """Return XML with another value, element, name or declaration."""
    return rng.choice((_value, _value, _element, _name, _declaration))(text, rng)


def archive(data: bytes, rng: random.Random) -> bytes:
    """Return a mutated FMU: its bytes, the files in it, or its model description."""
    if rng.random() < 0.4:
        return flipped(data, rng)
    with zipfile.ZipFile(io.BytesIO(data)) as whole:
        content = {name: whole.read(name) for name in whole.namelist()}
    if rng.random() < 0.8:
        text = content["modelDescription.xml"].decode("utf-8")
        for _ in range(rng.randint(1, 3)):
            text = markup(text, rng)
        content["modelDescription.xml"] = text.encode("utf-8", "surrogatepass")
        if rng.random() < 0.1:
            content["modelDescription.xml"] = flipped(content["modelDescription.xml"], rng)
    else:
        name = rng.choice(list(content))
        content[rng.choice(("../a", "/a", "a/../../b", "C:\\a", "", "modelDescription.xml/a", "binaries"))] = (
            content.pop(name)
        )
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w", rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))) as mutated:
        for name, part in content.items():
            mutated.writestr(zipfile.ZipInfo(name), part)
    return target.getvalue()


def flipped(data: bytes, rng: random.Random) -> bytes:
    """Return some bytes with a few changed, cut out, repeated or inserted."""
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 5, 20))):
        at, length = rng.randrange(len(changed) + 1), rng.choice((1, 1, 4, 50, 1000))
        kind = rng.randrange(4)
        if kind == 0 and at < len(changed):
            changed[at] = rng.choice((0, 255, 60, 34, rng.randrange(256)))
        elif kind == 1:
            del changed[at : at + length]
        elif kind == 2:
            changed[at:at] = changed[at : at + length]
        else:
            changed[at:at] = rng.randbytes(min(length, 50))
    return bytes(changed)


def _variant(rng: random.Random) -> str:
    rules = []
    for _ in range(rng.randint(1, 4)):
        inner = rng.choice(
            ("", "<x/>", '<event at="1 s" robots="leader"><stop/></event>', '<gain name="a" value="1"/>', "<!-- a -->")
        )
        kind = rng.choice(("set", "remove", "replace", "insert"))
        name = "into" if kind == "insert" else "select"
        value = f' value="{_escaped(rng.choice(VALUES))}"' if kind == "set" else ""
        content = inner * rng.choice((1, 1, 3, 200)) if kind in ("replace", "insert") else ""
        rules.append(f'<{kind} {name}="{_escaped(_xpath(rng))}"{value}>{content}</{kind}>')
    return f'<variant xmlns="{NAMESPACE}" name="v" of="base.xml"><title>t</title>{"".join(rules)}</variant>'


def _xpath(rng: random.Random) -> str:
    one = rng.choice(XPATHS).replace("{n}", str(rng.randint(0, 9))).replace("{v}", rng.choice(VALUES))
    if rng.random() < 0.2:
        one = f"//*[{one}]"
    if rng.random() < 0.2:
        at = rng.randrange(len(one) + 1)
        one = one[:at] + rng.choice("[]()/'\"@*.|$") + one[at:]
    return one


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")


def _value(text: str, rng: random.Random) -> str:
    found = list(_ATTRIBUTE.finditer(text))
    if not found:
        return text
    one = rng.choice(found)
    old = one[2]
    value = rng.choice(
        [*VALUES, rng.choice(found)[2], f"-{old}", re.sub(r"[0-9.]+", rng.choice(("0", "1e308", "7")), old)]
    )
    return f"{text[: one.start(2)]}{value if '&' in value else _escaped(value)}{text[one.end(2) :]}"


def _name(text: str, rng: random.Random) -> str:
    found = list(re.finditer(r"(?<=[<\s])[A-Za-z_]\w*(?=[=\s/>])", text))
    if len(found) < 2:
        return text
    one = rng.choice(found)
    return text[: one.start()] + rng.choice([rng.choice(found)[0], "xmlns:a", "a", "é"]) + text[one.end() :]


def _element(text: str, rng: random.Random) -> str:
    found = list(_ELEMENT.finditer(text))
    if not found:
        return text
    one, other = rng.choice(found), rng.choice(found)
    if rng.random() < 0.5:
        return text[: one.start()] + one[0] * rng.choice(_MANY) + text[one.end() :]
    return text[: other.start()] + one[0] + text[other.start() :]


def _declaration(text: str, rng: random.Random) -> str:
    declared = rng.choice(
        (
            f'<?xml version="1.0" encoding="{rng.choice(ENCODINGS)}"?>',
            '<?xml version="1.1"?>',
            '<!DOCTYPE a [<!ENTITY b "c">]>',
            "\ufeff",
            "",
        )
    )
    return declared + re.sub(r"^<\?xml[^>]*\?>", "", text) if rng.random() < 0.5 else text
