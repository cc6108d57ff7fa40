"""What a study keeps of the course of each run, and the picture of all of them together."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib.path import Path as Outline

import cosim
from cosim.errors import InputError
from cosim.results.files import save
from cosim.results.result import Result
from cosim.studies.bundles import Bundle, _less
from cosim.studies.conduct import StudyOutcome, check_study, conduct
from cosim.studies.courses import Envelope
from cosim.studies.figure_envelope import _drawn, draw, picture, swept
from cosim.studies.plan import Plan
from cosim.studies.reader import read_study
from cosim.studies.store import FILE, Store
from cosim.studies.table import as_result
from cosim.tests.studies import LAST, SEEDS, small_study, write_study

PATHS = '<envelope signal="pose"/>'
SHORTER = """<vary name="law" cross="yes">
  <case name="long"/>
  <case name="short"><set select="simulation/@horizon" value="0.1 s"/></case>
</vary>"""
LAWS = """<vary name="law" cross="yes">
  <case name="soft"><set select="//gain[@name='K_p']/@value" value="1"/></case>
  <case name="stiff"><set select="//gain[@name='K_p']/@value" value="20"/></case>
</vary>"""
ERRORS = '<envelope signal="range_error" unit="mm" from="0.1 s" samples="3"/>'


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> tuple[StudyOutcome, Path]:
    """Return a study of four runs with two envelopes, and its folder."""
    folder = tmp_path_factory.mktemp("study")
    study = small_study(folder, sample='<sample method="random" runs="4"/>', rest=LAST + PATHS + ERRORS)
    return conduct(study, folder, workers=0), folder


def test_what_is_kept_is_the_result_of_each_run(kept: tuple[StudyOutcome, Path]) -> None:
    outcome, folder = kept
    paths, errors = outcome.bundles
    assert errors.envelope.times.tolist() == pytest.approx([0.1, 0.16, 0.2])
    for run, path, error in zip(Plan(outcome.study), paths.values, errors.values, strict=True):
        result = cosim.run(folder / "base.xml", run.changes)
        expected = 1000.0 * result["range_error"].sel(time=errors.envelope.times, method="nearest")
        assert np.array_equal(error[..., 0], expected.T.values.astype(np.float32))
        places = [result["leader_pose"].values[:, np.newaxis, :2], result["pose"].values[..., :2]]
        assert np.array_equal(path, np.concatenate(places, axis=1).swapaxes(0, 1).astype(np.float32))
    assert paths.robots == ("leader", *errors.robots)
    assert paths.worst is not None
    assert paths.number == outcome.rows[paths.worst].number == min(outcome.rows, key=lambda row: row.least).number


def test_a_course_far_from_the_origin_is_as_exact_as_one_near_it(kept: tuple[StudyOutcome, Path]) -> None:
    outcome, folder = kept
    (paths, _), run = outcome.bundles, Result.of(cosim.run(folder / "base.xml"))
    pose = run["pose"]
    shift = np.zeros(pose.values.shape[2])
    shift[:2] = 500_000.0, 5_000_000.0  # as of coordinates in a national grid
    far = replace(run, data_vars={**run.data_vars, "pose": replace(pose, values=pose.values + shift)})
    own, moved = (paths.envelope.read(paths.envelope.course(one)) for one in (run, far))
    assert own.values.dtype == np.float32, "a study keeps little"
    assert moved.robots == own.robots
    np.testing.assert_allclose(moved.values[1:] - shift[:2], own.values[1:], rtol=0, atol=1e-5)
    difference = _less(moved, own)
    np.testing.assert_allclose(difference.values[1:], np.broadcast_to(shift[:2], own.values[1:].shape), atol=1e-5)


def test_the_store_has_them_and_memory_has_not(kept: tuple[StudyOutcome, Path]) -> None:
    outcome, folder = kept
    assert not any(row.courses for row in outcome.rows)
    with Store(folder, "small") as store:
        assert not any(row.courses for row in store.rows.values())
        assert [len(courses) for courses in store.courses(outcome.rows)] == [2] * 4
        other = replace(outcome.rows[0], key="without")
        store.append([other])
        assert [len(courses) for courses in store.courses([other, outcome.rows[0]])] == [0, 2]
    again = conduct(outcome.study, folder, workers=0)
    assert again.made == 0
    assert all(np.array_equal(one.values, two.values) for one, two in zip(again.bundles, outcome.bundles, strict=True))
    lines = (folder / FILE).read_text(encoding="utf-8").splitlines()
    assert max(map(len, lines)) < 4000, "a run keeps little"


def test_a_study_that_asks_for_none_keeps_none(tmp_path: Path, kept: tuple[StudyOutcome, Path]) -> None:
    keys = check_study(kept[0].study)[1].scenarios
    study = small_study(tmp_path, rest=LAST)
    (tmp_path / "base.xml").write_bytes((kept[1] / "base.xml").read_bytes())
    assert check_study(study)[1].scenarios != keys, "runs without a course are not taken for those with one"
    assert '"courses"' not in kept[0].rows[0].to_json()


def made_of(kept: tuple[StudyOutcome, Path], index: int, values: np.ndarray, **other: object) -> StudyOutcome:
    """Return an outcome with one bundle of given values (runs, R, T, C)."""
    outcome, _ = kept
    bundle = replace(outcome.bundles[index], values=values.astype(np.float32), ended=len(values), **other)
    return replace(outcome, bundles=(bundle,))


def test_a_band_over_time_is_that_of_the_data(kept: tuple[StudyOutcome, Path]) -> None:
    values = np.random.default_rng(1).normal(size=(101, 1, 3, 1))
    values[0, 0, 2] = np.nan
    (panel,) = draw(made_of(kept, 1, values, robots=("a",), worst=7, number=8)).subfigs[0].axes
    seen = values.astype(np.float32)[:, 0, :, 0]
    middle, worst = panel.lines
    assert np.array_equal(middle.get_ydata(), np.nanmedian(seen, axis=0).astype(np.float64))
    assert np.array_equal(worst.get_ydata(), seen[7])
    for band, (low, high) in zip(panel.collections, ((0.0, 1.0), (0.05, 0.95)), strict=True):
        edges = band.get_paths()[0].vertices
        for time, course in zip(kept[0].bundles[1].envelope.times, seen.T, strict=True):
            drawn = edges[edges[:, 0] == time][:, 1]
            ends = np.nanquantile(course, [low, high], method="inverted_cdf")
            assert (drawn.min(), drawn.max()) == tuple(ends)
    assert (panel.get_xlabel(), panel.get_ylabel()) == ("time [s]", "range_error [mm]")


def test_an_outline_of_paths_holds_as_many_runs_as_it_says(kept: tuple[StudyOutcome, Path]) -> None:
    along = np.linspace(0.0, 2.0, 11)
    random = np.random.default_rng(2)
    places = np.stack([np.sin(along) * 9, 9 - np.cos(along) * 9], axis=-1) + random.normal(size=(100, 1, 2)) * 0.3
    for share in (1.0, 0.9):
        outline = swept(places, share)
        for at in range(11):
            middle = np.median(places[:, at], axis=0)
            inside = outline.contains_points(middle + (1.0 - 1e-9) * (places[:, at] - middle))
            assert inside.sum() >= 100 * share, "there are its neighbours' polygons, too"
        assert Outline.contains_point(outline, places[:, 5].mean(axis=0))
        far = places[:, 5].mean(axis=0) + np.array([2.0, -2.0])
        assert not outline.contains_point(far)
    far_off = np.hypot(*(places[:, 0] - np.median(places[:, 0], axis=0)).T).argmax()
    assert not swept(places[:, :2], 0.9).contains_point(places[far_off, 0])
    robots, times = 1, len(along)
    outcome = made_of(kept, 0, places[:, np.newaxis], robots=("a",), worst=3, number=4)
    (panel,) = draw(outcome).subfigs[0].axes
    assert (panel.get_xlabel(), panel.get_ylabel(), panel.get_aspect()) == ("x [m]", "y [m]", 1.0)
    middle, _start, worst = panel.lines
    assert len(panel.patches) == 2 * robots
    assert len(middle.get_xdata()) == times
    assert np.allclose(worst.get_xydata(), places[3], atol=1e-6)
    assert panel.get_legend().get_texts()[-1].get_text() == "run 4, the worst"


def test_runs_that_end_early_are_in_it_as_long_as_they_last() -> None:
    places = np.zeros((3, 4, 2))
    places[..., 0] = np.arange(4)
    places[2, 2:] = np.nan
    places[2, :2, 1] = 1.0
    outline = swept(places, 1.0)
    assert outline.contains_point((0.5, 0.5))
    assert not outline.contains_point((2.5, 0.5))
    assert len(swept(np.full((3, 4, 2), np.nan), 1.0).vertices) == 0


def test_there_is_a_picture_of_each_case_and_it_says_what_it_leaves_out(kept: tuple[StudyOutcome, Path]) -> None:
    outcome, _ = kept
    assert picture(outcome).startswith(b"\x89PNG")
    many = [replace(outcome.bundles[at % 2], title=f"law {at}", broken=2, ended=9) for at in range(7)]
    figure = draw(replace(outcome, bundles=tuple(many)))
    assert len(figure.subfigs) == 6
    assert figure.get_suptitle().endswith("the first 6 of 7 pictures")
    assert figure.subfigs[3].get_suptitle() == (
        "law 3; light: all of 4 of 9 runs; dark: 90 % of them at each instant; line: median; 2 broken runs are left out"
    )


def test_each_case_is_drawn_of_its_own_scenario(tmp_path: Path) -> None:
    path = write_study(tmp_path, SHORTER + SEEDS, '<sample method="random" runs="2"/>', LAST + PATHS)
    outcome = conduct(read_study(path), tmp_path, workers=0)
    assert [bundle.title for bundle in outcome.bundles] == ["law long", "law short"]
    assert [bundle.envelope.times[-1] for bundle in outcome.bundles] == pytest.approx([0.2, 0.1])
    assert [len(bundle.values) for bundle in outcome.bundles] == [2, 2]


def test_the_table_has_them(kept: tuple[StudyOutcome, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    outcome, _ = kept
    save(as_result(outcome), tmp_path / "runs.nc")
    table = xr.load_dataset(tmp_path / "runs.nc")
    paths, errors = outcome.bundles
    assert table["envelope_2"].dims == ("run", "envelope_2_robot", "envelope_2_time")
    assert table["envelope_2"].attrs["units"] == "mm"
    assert np.array_equal(table["envelope_2"].values, errors.values[..., 0])
    leader = table["envelope_1"].sel(run=3, envelope_1_robot="leader", envelope_1_axis="y")
    assert np.array_equal(leader.values, paths.values[2, 0, :, 1])
    monkeypatch.setattr("cosim.studies.envelope_table.MOST_NUMBERS", errors.values.size)
    assert "envelope_1" not in as_result(outcome).data_vars
    assert "envelope_2" in as_result(outcome).data_vars


def test_runs_of_cases_have_their_own_instants_in_the_table(tmp_path: Path) -> None:
    errors = ERRORS.replace("0.1 s", "0.06 s")
    study = small_study(tmp_path, SHORTER + SEEDS, '<sample method="random" runs="2"/>', LAST + errors)
    table = as_result(conduct(study, tmp_path, workers=0)).dataset["envelope_1"]
    assert table["envelope_1_time"].values == pytest.approx([0.06, 0.08, 0.1, 0.12, 0.2])
    there = np.isfinite(table.values[:, 0]).astype(int)
    assert there.tolist() == [[1, 0, 0, 1, 1], [1, 1, 1, 0, 0]] * 2


def test_a_run_of_another_step_has_its_own_instants_alone(tmp_path: Path) -> None:
    vary = '<vary name="step" select="simulation/@step"><list values="20 ms, 40 ms"/></vary>'
    text = '<envelope signal="range_error" unit="mm"/>'
    study = small_study(tmp_path, vary, '<sample method="grid"/>', LAST + text)
    (bundle,) = conduct(study, tmp_path, workers=0).bundles
    fine, coarse = bundle.values[:, 0, :, 0]
    assert np.isfinite(fine).all()
    assert np.isfinite(coarse).tolist() == [True, False] * 5 + [True]
    drawn = _drawn(bundle)[1, 0, :, 0]
    assert drawn[1::2] == pytest.approx(0.5 * (coarse[:-2:2] + coarse[2::2]))
    result = cosim.run(tmp_path / "base.xml", ["simulation/@step=40 ms"])["range_error"][:, 0]
    assert coarse[::2] == pytest.approx(1000.0 * result.values, rel=1e-6)


def test_two_cases_are_compared_draw_by_draw(tmp_path: Path) -> None:
    text = ERRORS.replace("/>", ' vary="law" case="soft" than="stiff"/>')
    size = '<sample method="random" runs="3"/>'
    study = small_study(tmp_path, LAWS + SEEDS, size, LAST + ERRORS + text)
    outcome = conduct(study, tmp_path, workers=0)
    soft, stiff, less = outcome.bundles
    assert (less.title, less.of, less.ended, less.broken) == ("law soft minus stiff", "pairs of runs", 3, 0)
    assert np.array_equal(less.values, soft.values - stiff.values)
    assert np.abs(less.values).max() > 0.0
    assert "all of 3 pairs of runs" in draw(outcome).subfigs[2].get_suptitle()
    assert "envelope_1" in as_result(outcome).data_vars
    assert "envelope_2" not in as_result(outcome).data_vars
    other = text.replace('"soft" than="stiff"', '"stiff" than="soft"')
    again = conduct(small_study(tmp_path, LAWS + SEEDS, size, LAST + ERRORS + other), tmp_path, workers=0)
    assert again.made == 0, "what is compared needs no other runs"
    assert np.array_equal(again.bundles[2].values, -less.values)


def test_a_difference_of_signals_is_that_of_the_results(tmp_path: Path) -> None:
    text = '<envelope signal="pose" component="x" minus_robot="follower_2" robots="follower_1" unit="mm"/>'
    study = small_study(tmp_path, sample='<sample method="random" runs="1"/>', rest=LAST + text)
    (bundle,) = conduct(study, tmp_path, workers=0).bundles
    pose = cosim.run(tmp_path / "base.xml", Plan(study)[0].changes)["pose"].sel(pose_component="x")
    expected = 1000.0 * (pose.sel(robot="follower_1") - pose.sel(robot="follower_2"))
    assert bundle.robots == ("follower_1",)
    assert bundle.values[0, 0, :, 0] == pytest.approx(expected.values, rel=1e-6)


COMPARED = '<envelope signal="range_error" unit="m" vary="{}" case="{}" than="{}"/>'


@pytest.mark.parametrize(
    ("vary", "envelope", "said"),
    [
        ("LAWS", COMPARED.format("law", "soft", "soft"), "a case less itself is always zero"),
        ("LAWS", COMPARED.format("law", "soft", "hard"), "'law' has no value 'hard'"),
        ("LAWS", COMPARED.format("lav", "soft", "stiff"), "nothing varies that is named 'lav': did you mean 'law'"),
        ("LAWS", COMPARED.format("seed", "1", "2"), "'seed' is not crossed"),
        ("LAWS", COMPARED.replace(' than="{}"', "").format("law", "soft"), "and than=...: add than="),
        ("LAWS", COMPARED.replace("range_error", "pose").format("law", "soft", "stiff"), "needs component=..., one of"),
        ("SHORTER", COMPARED.format("law", "long", "short"), "long minus short: the two have other instants"),
    ],
)
def test_cases_that_cannot_be_compared(tmp_path: Path, vary: str, envelope: str, said: str) -> None:
    varied = {"LAWS": LAWS, "SHORTER": SHORTER}[vary] + SEEDS
    with pytest.raises(InputError, match=f"study.xml:.*{said}"):
        check_study(small_study(tmp_path, varied, rest=LAST + "\n" + envelope))


@pytest.mark.parametrize(
    ("envelope", "said"),
    [
        ('<envelope signal="range_error"/>', "study.xml:6:.*<envelope> needs unit=..., such as that of the signal"),
        ('<envelope signal="range_eror" unit="m"/>', "study.xml:6:.*no signal 'range_eror'.*did you mean"),
        ('<envelope signal="range_error" unit="s"/>', "study.xml:6:.*the unit of the envelope of 'range_error'"),
        ('<envelope signal="torque" unit="N.m"/>', "study.xml:6:.*needs component="),
        ('<envelope signal="pose" robots="nobody"/>', "study.xml:6:.*'nobody' has no signal 'pose'"),
        ('<envelope signal="pose" from="2 s"/>', "study.xml:6:.*not within the run of 0.2 s"),
        ('<envelope signal="pose" to="1 m"/>', 'study.xml:6:.*to="1 m" of <envelope>'),
    ],
)
def test_an_envelope_that_makes_no_sense_is_refused_with_its_place(tmp_path: Path, envelope: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        check_study(small_study(tmp_path, rest=LAST + "\n" + envelope))


def test_too_much_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study = small_study(tmp_path, rest=LAST + "\n" + '<envelope signal="pose" samples="1000000000000"/>')
    ((scenario, (written,)),) = ((one, study.envelopes) for one in study.bases.values())
    assert len(Envelope(written, scenario).times) == 11, "no more than there are"
    monkeypatch.setattr("cosim.studies.courses.MOST_NUMBERS", 20)
    with pytest.raises(InputError, match=r"study.xml:6:.*numbers a run, which is more than 20: give fewer samples="):
        check_study(study)


def test_bundle_is_small(kept: tuple[StudyOutcome, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    outcome, folder = kept
    monkeypatch.setattr("cosim.studies.bundles._MOST", outcome.bundles[0].values[0].size * 2)
    paths: Bundle = conduct(outcome.study, folder, workers=0).bundles[0]
    assert len(paths.values) <= 3
    assert (paths.ended, paths.number) == (4, outcome.bundles[0].number)
    assert paths.worst is not None
    assert np.array_equal(paths.values[paths.worst], outcome.bundles[0].values[outcome.bundles[0].worst or 0])
