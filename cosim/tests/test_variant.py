"""A variant is another scenario with a few changes, in which every element still knows where it was written."""

import re
import shutil
import sys
import time
from pathlib import Path

import pytest
from lxml import etree

import cosim.scenario.document
from cosim.errors import InputError
from cosim.scenario.document import MAX_BYTES, read_document
from cosim.scenario.grammar import NAMESPACE, local_name
from cosim.scenario.reader import read_scenario

EXAMPLE = Path(__file__).with_name("example.xml")


@pytest.fixture
def base(tmp_path: Path) -> Path:
    """Return a copy of the example, to be varied."""
    return Path(shutil.copy(EXAMPLE, tmp_path / "base.xml"))


def write(path: Path, rules: str, of: str = "base.xml", title: str = "<title>A variant</title>") -> Path:
    """Write a variant whose rules begin in line 3."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        f'<variant xmlns="{NAMESPACE}" name="{path.stem}" of="{of}">\n{title}\n{rules}\n</variant>\n', encoding="utf-8"
    )
    return path


def refused(path: Path, *changes: str) -> str:
    with pytest.raises(InputError) as caught:
        read_scenario(path, changes)
    return str(caught.value)


def found(path: Path, xpath: str) -> list[etree._Element]:
    """Return the nodes that an XPath without namespaces selects in the resolved text."""
    root = etree.fromstring(read_document(path).text.encode())
    for element in root.iter("*"):
        element.tag = local_name(element)
    return root.xpath(xpath)


# What a variant says ----------------------------------------------------------------------------------------


def test_a_variant_has_a_name_a_title_and_a_description_of_its_own(base: Path, tmp_path: Path) -> None:
    path = write(tmp_path / "v.xml", "")
    scenario = read_scenario(path)
    assert (scenario.name, scenario.title, scenario.path) == ("v", "A variant", path)
    assert found(path, "description") == [], "the base's is not about the variant"
    path = write(tmp_path / "w.xml", "", title="<title>W</title><description>Why not.</description>")
    assert found(path, "description/text()") == ["Why not."]
    assert found(path, "/*/*[position() <= 3]")[2].tag == "simulation"


def test_the_rest_is_the_base(base: Path, tmp_path: Path) -> None:
    varied, original = read_scenario(write(tmp_path / "v.xml", "")), read_scenario(base)
    for name in ("plants", "controllers", "leader", "followers", "step", "ticks", "seed"):
        assert getattr(varied, name) == getattr(original, name), "places included"


def test_set(base: Path, tmp_path: Path) -> None:
    path = write(
        tmp_path / "v.xml",
        '<set select="//gain[@name=\'W_m\']/@value" value="100"/>\n<set select="//noise/@*" value="2 mm"/>\n'
        "<set select=\"//noise/@*[name() = 'psi' or name() = 'gamma']\" value=\" 3   mrad \"/>",
    )
    scenario = read_scenario(path)
    assert {gain.name: gain.value for gain in scenario.controllers["pid"].gains}["W_m"] == "100"
    (noise,) = scenario.followers[0].sensor
    assert list(noise.attributes.values()) == ["2 mm", "2 mm", "3 mrad", "3 mrad"], "in this order"


def test_replace_by_several_in_the_same_place(base: Path, tmp_path: Path) -> None:
    path = write(
        tmp_path / "v.xml",
        "<replace select=\"//gain[@name='k_d']\"><!-- two of them -->"
        '<gain name="guard" value="0.1"/><gain name="k_d" value="20"/></replace>',
    )
    gains = [gain.name for gain in read_scenario(path).controllers["pid"].gains]
    assert gains[2:6] == ["Lambda_1", "guard", "k_d", "epsilon_t"]
    assert "<!-- two of them -->" in read_document(path).text


@pytest.mark.parametrize(
    ("into", "element", "before", "after"),
    [
        ("//controller", '<gain name="guard" value="0.1"/>', "gain", None),
        (".", '<controller id="c" name="a" package="b" version="1"/>', "controller", "sensor"),
        (".", '<input name="tau_d_y"><constant value="1 N"/></input>', "actuator", "leader"),
        (".", "<expect><regular/></expect>", "follower", None),
        ("//follower[1]", '<gain name="K_p" value="20"/>', "desired", None),
        ("//follower[1]/desired", '<change from="1 s" to="2 s" range="4 m"/>', None, None),
        ("/scenario/sensor", '<delay time="20 ms"/>', "noise", None),
    ],
)
def test_insert_where_it_belongs(
    base: Path, tmp_path: Path, into: str, element: str, before: str | None, after: str | None
) -> None:
    path = write(tmp_path / "v.xml", f'<insert into="{into}">{element}</insert>')
    (tag,) = re.findall(r"^<(\w+)", element)
    inserted = found(path, f"({into})//{tag}[last()]")[-1] if into != "." else found(path, f"{tag}[last()]")[0]
    neighbours = (inserted.getprevious(), inserted.getnext())
    assert [None if n is None else n.tag for n in neighbours] == [before, after]


def test_insert_into_several_with_their_comments(base: Path, tmp_path: Path) -> None:
    path = write(
        tmp_path / "v.xml",
        '<insert into="follower">\n  <!-- heavier -->\n  <parameter name="m_c" value="40 kg"/>\n'
        '  <!-- softer -->\n  <gain name="K_p" value="5"/>\n</insert>',
    )
    scenario = read_scenario(path)
    assert [[p.value for p in follower.parameters] for follower in scenario.followers] == [["40 kg"]] * 4
    assert {str(follower.gains[0].where) for follower in scenario.followers} == {f"{path}:7:3"}
    follower = re.search(r'  <follower id="follower_2".*?</follower>', scenario.text, re.DOTALL)
    assert follower
    assert follower[0] == (
        '  <follower id="follower_2" plant="clmr" controller="pid">\n'
        '    <pose x="-5 m" y="10 m" psi="0 deg" gamma="0 deg"/>\n'
        '    <desired range="3 m" bearing="-45 deg"/>\n'
        "    <!-- heavier -->\n"
        '    <parameter name="m_c" value="40 kg"/>\n'
        "    <!-- softer -->\n"
        '    <gain name="K_p" value="5"/>\n'
        "  </follower>"
    )


def test_the_layout_of_the_base_is_kept(base: Path, tmp_path: Path) -> None:
    old = '    <gain name="W_m" value="1000"/>\n  </controller>\n'
    text = base.read_text(encoding="utf-8")
    assert old in text
    base.write_text(text.replace(old, old.replace("/>\n", "/> <!-- as printed -->\n")), encoding="utf-8")
    path = write(
        tmp_path / "v.xml",
        '<insert into="controller"><gain name="guard" value="0.1"/></insert><remove select="//parameter[last()]"/>'
        '<insert into="."><input name="tau_d_y"><constant value="1 N"/></input></insert>',
    )
    resolved = read_document(path).text
    for piece in (
        '    <gain name="W_m" value="1000"/> <!-- as printed -->\n'
        '    <gain name="guard" value="0.1"/>\n'
        "  </controller>\n\n  <sensor>\n",
        '    <parameter name="solver" value="euler"/>\n  </plant>\n\n  <controller ',
        '  </actuator>\n  <input name="tau_d_y">\n    <constant value="1 N"/>\n  </input>\n\n  <leader ',
    ):
        assert piece in resolved


def test_remove_elements_and_attributes(base: Path, tmp_path: Path) -> None:
    path = write(tmp_path / "v.xml", '<remove select="follower[position() > 2]"/>\n<remove select="//noise/@psi"/>')
    scenario = read_scenario(path)
    assert [follower.id for follower in scenario.followers] == ["follower_1", "follower_2"]
    assert [list(effect.attributes) for effect in scenario.followers[0].sensor] == [["x", "y", "gamma"]]


def test_rules_are_applied_in_the_order_written(base: Path, tmp_path: Path) -> None:
    insert = '<insert into="."><expect><regular/></expect></insert>'
    change = '<set select="//gain[1]/@value" value="{}"/>'
    path = write(tmp_path / "v.xml", f'{change.format(1)}{insert}<remove select="expect"/>{change.format(2)}')
    assert found(path, "//gain[1]/@value") == ["2"]
    assert read_scenario(path).expectations == ()
    assert "'expect' selects nothing" in refused(write(path, f'<remove select="expect"/>{insert}'))


def test_set_on_the_command_line_comes_after_the_variant(base: Path, tmp_path: Path) -> None:
    path = write(tmp_path / "v.xml", '<set select="//simulation/@seed" value="5"/>')
    assert read_scenario(path).seed == 5
    assert read_scenario(path, ["//simulation/@seed=6"]).seed == 6


def test_a_variant_of_a_variant(base: Path, tmp_path: Path) -> None:
    write(tmp_path / "a.xml", '<set select="//simulation/@seed" value="5"/><remove select="follower[3]"/>')
    path = write(tmp_path / "b.xml", '<set select="//simulation/@horizon" value="50 s"/>', of="a.xml")
    scenario = read_scenario(path)
    assert (scenario.name, scenario.seed, scenario.horizon, len(scenario.followers)) == ("b", 5, 50, 3)


def test_the_resolved_text_is_the_same_scenario(base: Path, tmp_path: Path) -> None:
    write(tmp_path / "a.xml", '<insert into="follower"><gain name="K_p" value="5"/></insert>')
    resolved = read_scenario(write(tmp_path / "b.xml", '<remove select="follower[1]"/>', of="a.xml"))
    saved = tmp_path / "saved.xml"
    saved.write_text(resolved.text, encoding="utf-8")
    again = read_scenario(saved)
    assert again.text == resolved.text
    assert [f.gains[0].value for f in again.followers] == ["5", "5", "5"]
    assert "<!--" not in resolved.text
    assert resolved.text.startswith("<?xml")
    assert "<variant" not in resolved.text


# Paths ------------------------------------------------------------------------------------------------------


def test_a_path_stays_relative_to_the_file_where_it_was_written(base: Path, tmp_path: Path) -> None:
    base.write_text(base.read_text().replace('model="car_like"', 'fmu="fmus/car.fmu"'))
    write(
        tmp_path / "more" / "a.xml",
        '<insert into="."><expect>'
        '<compare measure="rms" signal="range_error" factor="1" scenario="a.xml"/></expect></insert>'
        '<insert into="."><input name="f"><table file="wind.csv" column="w"/></input></insert>'
        '<set select="plant[@fmu=\'../fmus/car.fmu\']/@id" value="car"/><set select="//@plant" value="car"/>',
        of="../base.xml",
    )
    for path in (
        write(tmp_path / "more" / "b.xml", "", of="a.xml"),
        write(tmp_path / "other" / "c.xml", "", of="../more/a.xml"),
        write(tmp_path / "d.xml", "", of=str(tmp_path / "more" / "a.xml")),
    ):
        scenario = read_scenario(path)
        assert scenario.plants["car"].fmu is not None
        assert scenario.plants["car"].fmu.resolve() == tmp_path / "fmus" / "car.fmu"
        assert scenario.expectations[0].path("scenario").resolve() == tmp_path / "more" / "a.xml"
        assert scenario.inputs[0].waves[0].path("file").resolve() == tmp_path / "more" / "wind.csv"


def test_a_path_that_a_variant_sets_is_relative_to_the_variant(base: Path, tmp_path: Path) -> None:
    base.write_text(base.read_text().replace('model="car_like"', 'fmu="car.fmu"'))
    path = write(tmp_path / "more" / "v.xml", '<set select="plant/@fmu" value="own.fmu"/>', of="../base.xml")
    assert read_scenario(path).plants["clmr"].fmu == tmp_path / "more" / "own.fmu"
    rename = '<set select="plant/@id" value="x"/><set select="//@plant" value="x"/>'
    other = write(tmp_path / "more" / "w.xml", rename, of="../base.xml")
    fmu = read_scenario(other).plants["x"].fmu
    assert fmu is not None
    assert fmu.resolve() == tmp_path / "car.fmu", "another attribute of the same element was set elsewhere"


@pytest.mark.skipif(sys.platform == "win32", reason="needs links")
def test_a_place_has_no_detours_unless_they_lead_elsewhere(base: Path, tmp_path: Path) -> None:
    write(tmp_path / "more" / "v.xml", "", of="../base.xml")
    assert read_scenario(tmp_path / "more" / "v.xml").followers[0].where.file == str(base)
    (tmp_path / "deep" / "er").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "deep" / "er", target_is_directory=True)
    (tmp_path / "deep" / "base.xml").write_text(base.read_text())
    write(tmp_path / "link" / "v.xml", "", of="../base.xml")
    where = read_scenario(tmp_path / "link" / "v.xml").followers[0].where.file
    assert where == f"{tmp_path}/link/../base.xml", "the folder above is that of the link's target"


# Places -----------------------------------------------------------------------------------------------------


def test_every_element_keeps_its_place(base: Path, tmp_path: Path) -> None:
    path = write(
        tmp_path / "v.xml",
        '<set select="follower[2]/@id" value="second"/>\n'
        '<insert into="follower[3]"><gain name="K_p" value="5"/></insert>\n'
        '<remove select="//noise/@psi"/>',
    )
    scenario = read_scenario(path)
    assert str(scenario.followers[0].where) == f"{base}:47:3"
    assert str(scenario.followers[1].where) == f"{path}:3:1", "where it was set"
    assert str(scenario.followers[2].where) == f"{base}:55:3"
    assert str(scenario.followers[2].gains[0].where) == f"{path}:4:28"
    assert str(scenario.followers[0].sensor[0].where) == f"{path}:5:1", "where an attribute was removed"
    assert str(scenario.plants["clmr"].where) == f"{base}:13:3"


@pytest.mark.parametrize(
    ("rules", "place", "sentence"),
    [
        ('<set select="//gian/@value" value="1"/>', "v.xml:3:1", "<set> select: '//gian/@value' selects nothing"),
        ('<set select="//gain[" value="1"/>', "v.xml:3:1", "'//gain[' is not an XPath"),
        ('<set select="follower" value="1"/>', "v.xml:3:1", "selects something other than an attribute"),
        ('<replace select="follower"><follower/></replace>', "v.xml:3:1", "selects 4 nodes: expected one element"),
        ('<replace select="//@seed"><follower/></replace>', "v.xml:3:1", "selects 1 nodes: expected one element"),
        ('<replace select="."><follower/></replace>', "v.xml:3:1", "the scenario itself cannot be replaced"),
        ('<replace select="leader">\n<leadr/></replace>', "v.xml:4:1", "<leadr> is not expected in <scenario>"),
        ('<replace select="leader"/>', "v.xml:3:1", "<replace> is incomplete; expected next: an element of a scenario"),
        ('<insert into="leaders"><pose/></insert>', "v.xml:3:1", "<insert> into: 'leaders' selects nothing"),
        ('<insert into="//@id"><pose/></insert>', "v.xml:3:1", "selects something other than an element"),
        ('<insert into="title"><pose/></insert>', "v.xml:3:22", "<pose> is not expected in <title>; expected: no ele"),
        ('<insert into=".">\n <sensor/></insert>', "v.xml:4:2", "<sensor> is not expected here in <scenario>"),
        ('<insert into=".">\n <expect/></insert>', "v.xml:4:2", "<expect> is incomplete; expected next: <settled>"),
        ('<remove select="."/>', "v.xml:3:1", "only elements and attributes can be removed"),
        ('<remove select="//title/text()"/>', "v.xml:3:1", "only elements and attributes can be removed"),
        ('<remove select="event"/>', "v.xml:3:1", "<remove> select: 'event' selects nothing"),
        ('<remove select="leader/pose/@x | follower[1]/pose"/>', "base.xml:49:5", "<desired> is not expected here"),
        ('<remove select="follower"/>', "v.xml:1:1", "<scenario> is incomplete; expected next: <follower>"),
        ('<remove select="//simulation/@seed"/>', "v.xml:3:1", "<simulation> lacks the attribute 'seed'"),
        ('<set select="//simulation/@step" value="2"/>', "v.xml:3:1", 'step="2" of <simulation> is not a time'),
        (
            '<set select="//simulation/@step" value="30 ms"/>',
            "v.xml:3:1",
            "is not a whole number of communication steps",
        ),
        (
            '<insert into="controller"><gain name="K_p" value="1"/></insert>',
            "v.xml:3:27",
            "'K_p' is given twice; first",
        ),
        ('<sett select="a" value="b"/>', "v.xml:3:1", "<sett> is not expected here in <variant>; expected: <desc"),
        ('<set select="a"/>', "v.xml:3:1", "<set> lacks the attribute 'value'"),
        ('<set select="" value="1"/>', "v.xml:3:1", 'select="" of <set> is not an XPath, such as'),
        ('<insert into="."><x xmlns="urn:x"/></insert>', "v.xml:3:18", "{urn:x}x is not part of the scenario language"),
    ],
)
def test_bad_rules(base: Path, tmp_path: Path, rules: str, place: str, sentence: str) -> None:
    error = refused(write(tmp_path / "v.xml", rules))
    assert error.startswith(f"{tmp_path / place}: ")
    assert sentence in error


def test_who_broke_a_base_is_told(base: Path, tmp_path: Path) -> None:
    path = write(tmp_path / "v.xml", '<remove select="follower[1]/pose"/>')
    assert refused(path).endswith(f"(as changed by {path})")


def test_a_second_place_in_another_file_is_named_in_full(base: Path, tmp_path: Path) -> None:
    path = write(tmp_path / "v.xml", '<insert into="controller"><gain name="K_p" value="1"/></insert>')
    assert refused(path).endswith(f"the gain 'K_p' is given twice; first at {base}:24:5")


def test_a_base_must_be_valid_by_itself(base: Path, tmp_path: Path) -> None:
    base.write_text(base.read_text().replace('seed="1"', ""))
    error = refused(write(tmp_path / "v.xml", '<remove select="simulation"/>'))
    assert error == f"{base}:11:3: <simulation> lacks the attribute 'seed'"


# Chains -----------------------------------------------------------------------------------------------------


def test_a_base_that_is_missing(tmp_path: Path) -> None:
    path = write(tmp_path / "v.xml", "", of="bsae.xml")
    assert refused(path) == f'{path}:1:1: of="bsae.xml" of <variant>: there is no such file'


def test_a_base_that_is_too_large(base: Path, tmp_path: Path) -> None:
    base.write_bytes(b" " * (MAX_BYTES + 1))
    assert 'of="base.xml" of <variant>: is larger than 4 MiB' in refused(write(tmp_path / "v.xml", ""))


def test_a_circle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write(Path("a.xml"), "", of="b.xml")
    write(Path("b.xml"), "", of="./a.xml")
    assert refused(Path("a.xml")) == "b.xml:1:1: the variant refers back to itself: a.xml -> b.xml -> a.xml"
    write(Path("c.xml"), "", of="c.xml")
    assert refused(Path("c.xml")) == "c.xml:1:1: the variant refers back to itself: c.xml -> c.xml"


def test_a_circle_through_a_link(tmp_path: Path) -> None:
    write(tmp_path / "a.xml", "", of="link.xml")
    (tmp_path / "link.xml").symlink_to("a.xml")
    assert "refers back to itself" in refused(tmp_path / "a.xml")


def test_a_chain_without_end(base: Path, tmp_path: Path) -> None:
    for i in range(cosim.scenario.document.MAX_VARIANTS + 1):
        last = write(tmp_path / f"{i}.xml", "", of=f"{i - 1}.xml" if i else "base.xml")
    assert read_scenario(tmp_path / "19.xml").name == "19"
    assert "a chain has at most 20 variants, this one has more: " in refused(last)


def test_many_elements_into_many(base: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two lists of a file multiply: a small file can make a large scenario."""
    monkeypatch.setattr("cosim.scenario.variant.MAX_ELEMENTS", 2000)
    gains = "".join(f'<gain name="g_{i}" value="1"/>' for i in range(600))
    error = refused(write(tmp_path / "v.xml", f'<insert into="follower">{gains}</insert>'))
    assert "v.xml:3:" in error
    assert error.endswith("the scenario grows to more than 2000 elements here")


def test_xpaths_that_would_not_end(base: Path, tmp_path: Path) -> None:
    nested = "//*[count(." * 6 + "//*" + ") > 0]" * 6
    error = refused(write(tmp_path / "v.xml", f'<set select="{nested}/@nothing" value="1"/>'))
    assert error.startswith(f"{tmp_path / 'v.xml'}:3:1: <set> select: ")
    assert "which takes too long" in error
    with pytest.raises(InputError, match="which takes too long"):
        read_scenario(base, [f"{nested}/@nothing=1"])
    with pytest.raises(InputError, match="selects nothing"):  # the same at each node, it is asked for once
        read_scenario(base, [f"{nested.replace('.', '')}/@nothing=1"])


def test_more_rules_than_can_be_followed(base: Path, tmp_path: Path) -> None:
    gains = "".join(f'<gain name="g_{i}" value="1"/>' for i in range(4000))
    rules = "\n".join('<set select="//gain[1]/@value" value="1"/>' for _ in range(5000))
    error = refused(write(tmp_path / "v.xml", f'<insert into="controller">{gains}</insert>\n{rules}'))
    assert re.match(rf"{re.escape(str(tmp_path))}/v.xml:\d+:1: <set> is one rule too many: ", error)


@pytest.mark.parametrize("tag", ["event", "plant"])
def test_insertion_takes_a_time_that_grows_with_the_number(base: Path, tmp_path: Path, tag: str) -> None:
    one = {
        "event": '<event at="1 s" robots="leader"><stop/></event>',
        "plant": '<plant id="p{}" model="car_like"/>',
    }[tag]

    def seconds(number: int) -> float:
        elements = "".join(one.format(i) for i in range(number))
        path = write(tmp_path / "v.xml", f'<insert into="/scenario">{elements}</insert>')
        started = time.process_time()
        assert len(read_document(path).root.findall(f"{{*}}{tag}")) >= number
        return time.process_time() - started

    assert min(seconds(8000) for _ in range(2)) < 10 * min(seconds(2000) for _ in range(2))  # the square would be 16


def test_entities_are_refused_in_variants_too(base: Path, tmp_path: Path) -> None:
    path = write(tmp_path / "v.xml", "")
    path.write_text('<!DOCTYPE variant [<!ENTITY a SYSTEM "file:///etc/passwd">]>\n' + path.read_text())
    assert refused(path).startswith(f"{path}:1:19: a scenario has no document type declaration")
