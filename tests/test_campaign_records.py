"""Single records, and what a campaign file may say beside runs and levels."""

import re
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from campaigns import LOOSE, RECORD, SMALL, FlatRenderer

from glint_aoa.benchmark import Kind
from glint_aoa.errors import SetupError
from glint_aoa.records.formats.hdf5 import (
    has_fields,
    open_hdf5,
    read_acquisition,
    read_truth,
)
from glint_aoa.records.points import write_point
from render_sim.campaign import (
    Campaign,
    load_campaign,
    point_acquisition,
    point_motion,
    simulate_campaign,
    simulate_point,
)
from render_sim.disturbance import LooseMass, loose_signals
from render_sim.drive import Series

ACQUIRED = """
[[record]]
name = "acquired"
duration = "1 s"
n_fields = 0
[record.excitation]
kind = "sine sweep"
plane = "pitch"
moments = ["900 in*lbf"]
shaker_off = "0.8 s"
[record.excitation.other_plane]
kind = "random"
moments = ["900 in*lbf"]
"""


def test_processes_change_no_bit(tmp_path):
    text = SMALL.replace("points = 3", "points = 2").split("[[run]]", maxsplit=1)[0]
    (tmp_path / "some.toml").write_text(text + ACQUIRED + LOOSE)
    campaign = load_campaign(tmp_path / "some.toml")
    one = list(simulate_campaign(campaign, tmp_path / "one", renderer="raytrace", seed=4))
    two = list(simulate_campaign(campaign, tmp_path / "two", renderer="raytrace", seed=4, jobs=2))
    assert len(one) == 3
    for first, second in zip(one, two, strict=True):
        if has_fields(first):
            np.testing.assert_array_equal(open_hdf5(first).read(0, 2), open_hdf5(second).read(0, 2))
        for name, channel in read_acquisition(first).channels.items():
            np.testing.assert_array_equal(
                channel.samples, read_acquisition(second).channels[name].samples
            )


@pytest.fixture
def with_record(tmp_path: Path) -> Campaign:
    path = tmp_path / "small.toml"
    path.write_text(SMALL + RECORD)
    return load_campaign(path)


def test_a_record_has_length_window_and_attitude_of_its_own(with_record):
    point = with_record.points[-1]
    recorded = simulate_point(with_record, point, renderer=FlatRenderer(rows=20), seed=2)
    assert recorded.fields.shape == (3, 20, 752)
    assert recorded.info.first_line == 133
    assert len(recorded.acquisition["ay_face"]) == 800
    assert recorded.truth["static_pitch_deg"][0] == pytest.approx(-0.3, abs=0.02)
    assert recorded.truth["yaw_deg"] == pytest.approx(2, abs=0.3)
    assert {key: recorded.meta[key] for key in ("run", "run_kind", "point", "shaker_off_s")} == {
        "run": "stop",
        "run_kind": "record",
        "point": "stop",
        "shaker_off_s": 0.4,
    }
    assert recorded.meta["nominal_yaw_deg"] == pytest.approx(2)
    assert recorded.meta["excitation"] == "yaw sine 9.8 Hz, off at 0.4 s"


def test_a_record_may_have_no_fields(with_record, tmp_path):
    (record,) = with_record.record
    plan = with_record.model_copy(
        update={"record": (record.model_copy(update={"n_fields": 0, "window": None}),)}
    )
    recorded = simulate_point(plan, plan.points[-1], renderer=FlatRenderer(), seed=2)
    write_point(tmp_path / "stop.h5", recorded)
    assert not has_fields(tmp_path / "stop.h5")
    assert set(read_truth(tmp_path / "stop.h5")) == {"static_pitch_deg", "bias_deg"}
    found = read_acquisition(tmp_path / "stop.h5")
    assert found.meta["trigger_time"] == "2026-01-12T08:30:00"


def test_the_shaker_is_silent_once_it_is_off(with_record):
    record = point_acquisition(with_record, with_record.points[-1], seed=2)
    force = record.channels["analyser_force_y"].values("N")
    assert np.ptp(force[:310]) > 5
    assert np.abs(force[330:]).max() < 0.1


def test_the_level_is_that_while_the_shaker_is_on(with_record):
    moment = point_acquisition(with_record, with_record.points[-1], seed=2).channels["yaw_moment"]
    assert np.ptp(moment.values("in*lbf")[:310]) == pytest.approx(2000, rel=5e-3)


@pytest.mark.usefixtures("flat")
def test_records_are_gone_on_with_as_well(with_record, tmp_path):
    first = list(simulate_campaign(with_record, tmp_path / "out", seed=1))
    before = [path.read_bytes() for path in first]
    first[-1].unlink()
    again = list(simulate_campaign(with_record, tmp_path / "out", seed=1, resume=True))
    assert again == first
    assert [path.read_bytes() for path in again] == before


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'shaker_off = "0.4 s"',
            'shaker_off = "1 s"',
            "stop: shaker_off at 1 s is not within the record of 1 s; "
            "give an earlier time or a longer duration",
        ),
        (
            '["2000 in*lbf"]',
            '["1 N*m", "2 N*m"]',
            "record[0]: a record has one level, excitation.moments 2; make it one record each",
        ),
        (
            "n_fields = 3",
            "n_fields = 0",
            "record[0]: window without fields; leave it out or give n_fields",
        ),
        ('name = "stop"', 'name = "yaw"', "a record is called yaw like a run; rename it"),
        (
            'name = "stop"',
            'name = "yaw-02"',
            "two points are called yaw-02; rename a run or record",
        ),
        (
            'frequency = "9.8 Hz"\nmoments = ["2000',
            'frequency = "400 Hz"\nmoments = ["2000',
            "record[0].excitation: 400 Hz is not below 400 Hz, half the acquisition's rate; "
            "lower it",
        ),
        (
            'frequency = "9.8 Hz"\nmoments = ["2000',
            'frequency = "9.8 Hz"\nband = ["5 Hz", "60 Hz"]\nmoments = ["2000',
            "record[0].excitation: band is not of kind sine, which has frequency",
        ),
        (
            'kind = "sine"\nplane = "yaw"\nfrequency = "9.8 Hz"\nmoments = ["2000',
            'kind = "random"\nplane = "yaw"\nband = ["60 Hz", "5 Hz"]\nmoments = ["2000',
            "record[0].excitation: band is empty; give its lower end, then its upper",
        ),
        (
            'kind = "sine"\nplane = "yaw"\nfrequency = "9.8 Hz"\nmoments = ["2000',
            'kind = "sine sweep"\nplane = "yaw"\nsweep_time = "3 s"\nmoments = ["2000',
            "stop: sweep_time of 3 s does not fit in the record of 1 s; "
            "shorten it or give a longer duration",
        ),
        (
            'shaker_off = "0.4 s"',
            '[record.excitation.other_plane]\nkind = "random"\nmoments = ["1 N*m", "2 N*m"]',
            "record[0].excitation: other_plane has 2 moments, the series 1; give as many",
        ),
    ],
)
def test_impossible_record_is_one_sentence(tmp_path, old, new, message):
    path = tmp_path / "campaign.toml"
    text = SMALL + RECORD
    changed = new.join(text.rsplit(old, 1))
    assert changed != text
    path.write_text(changed)
    with pytest.raises(SetupError, match=f"^{re.escape(f'{path}: {message}')}$"):
        load_campaign(path)


WRONG = """
[package]
scale = 1.004
temperature = "344.261 K"
warming = "6 K / hour"
scale_per_kelvin = "1e-3 / K"
"""


def test_the_packages_errors_are_in_the_file_and_its_temperature_beside_them(tmp_path):
    (tmp_path / "wrong.toml").write_text(SMALL + WRONG)
    (tmp_path / "right.toml").write_text(SMALL)
    wrong, right = (load_campaign(tmp_path / f"{name}.toml") for name in ("wrong", "right"))
    records = [point_acquisition(plan, plan.points[4], seed=2) for plan in (wrong, right)]
    one, other = (each.channels["aoa_filtered"].values("g_0").mean() for each in records)
    # 20 minutes after the start it is 2 K warmer
    assert one / other == pytest.approx(1.004 + 2e-3, abs=1e-5)
    assert records[0].channels["package_temperature"].values("K").mean() == pytest.approx(
        346.261, abs=0.005
    )
    np.testing.assert_array_equal(records[0].truth["bias_deg"], records[1].truth["bias_deg"])
    np.testing.assert_array_equal(
        records[0].channels["az_face"].samples, records[1].channels["az_face"].samples
    )


def test_a_loose_mass_is_felt_by_balance_and_bracket_alone(tmp_path):
    (tmp_path / "loose.toml").write_text(SMALL + RECORD + LOOSE)
    (tmp_path / "quiet.toml").write_text(SMALL + RECORD)
    loose, quiet = (
        point_acquisition(plan, plan.points[-1], seed=2).channels
        for plan in (load_campaign(tmp_path / f"{name}.toml") for name in ("loose", "quiet"))
    )
    changed = {
        name for name in quiet if not np.array_equal(loose[name].samples, quiet[name].samples)
    }
    felt = {"side_force", "yaw_moment", "ay_face"}
    assert changed == felt | {f"analyser_{name}" for name in felt}
    force, moment = (
        loose[name].values(unit) - quiet[name].values(unit)
        for name, unit in (("side_force", "N"), ("yaw_moment", "N*m"))
    )
    np.testing.assert_allclose(moment, 0.12 * force, rtol=0, atol=0.5)


def test_a_loose_mass_rattles_from_its_time_on():
    said = {"plane": "pitch", "mass": "2 kg", "station": "0.1 m", "travel": "1 mm"}
    loose = LooseMass.model_validate(
        said | {"band": ["9 Hz", "10 Hz"], "rattle": 7.0, "rattle_from": "30 s"}
    )
    rng = np.random.default_rng(5)
    signals = loose_signals(loose, period_s=64.0, rng=rng)
    assert set(signals) == {"normal_force", "pitch_moment", "az_face"}
    before, after = (signals["normal_force"].at(np.arange(a, a + 25, 1e-2)) for a in (2.0, 33.0))
    steady = {**said, "band": ["9 Hz", "10 Hz"]}
    usual = loose_signals(
        LooseMass.model_validate(steady), period_s=64.0, rng=np.random.default_rng(5)
    )["normal_force"]
    whole = usual.at(np.arange(0.0, 64.0, 1e-2))
    assert whole.std() == pytest.approx(2 * 1e-3 * (2 * np.pi * 9.5) ** 2, rel=0.2)
    np.testing.assert_allclose(before, usual.at(np.arange(2.0, 27.0, 1e-2)), atol=0.3)
    np.testing.assert_allclose(after, 7 * usual.at(np.arange(33.0, 58.0, 1e-2)), rtol=0.02)


def test_a_knock_nods_the_model_once(tmp_path):
    nod = '[record.knock]\ntime = "0.5 s"\nangle = "0.06 deg"\nwidth = "0.1 s"\n'
    still = RECORD.split("[record.excitation]", maxsplit=1)[0]
    (tmp_path / "nod.toml").write_text(SMALL + still + nod)
    plan = load_campaign(tmp_path / "nod.toml")
    moved = point_motion(plan, plan.points[-1], seed=2)
    time = np.array([0.0, 0.4, 0.5, 0.6, 1.0])
    pitch = np.arcsin(moved.motion.pose(time)[:, 2, 0]) - np.arcsin(
        moved.static.pose(time)[:, 2, 0]
    )
    expected = 0.06 * np.exp([-25, -1, 0, -1, -25])
    np.testing.assert_allclose(np.rad2deg(pitch), expected, rtol=0, atol=1e-9)


def test_the_comparison_knows_every_kind_of_excitation():
    kinds = get_args(Series.model_fields["kind"].annotation)
    assert {"off", *kinds} == set(get_args(Kind))


def test_both_planes_have_their_levels(tmp_path):
    both = RECORD.replace(
        'shaker_off = "0.4 s"',
        '[record.excitation.other_plane]\nkind = "random"\nmoments = ["900 in*lbf"]',
    )
    (tmp_path / "both.toml").write_text((SMALL + both).replace('"1 s"', '"8 s"'))
    plan = load_campaign(tmp_path / "both.toml")
    upright = tuple(m.model_copy(update={"out_of_plane": 0.0}) for m in plan.model.mode)
    plan = plan.model_copy(update={"model": plan.model.model_copy(update={"mode": upright})})
    record = point_acquisition(plan, plan.points[-1], seed=2)
    for name, level in (("yaw_moment", 2000), ("pitch_moment", 900)):
        assert np.ptp(record.channels[name].values("in*lbf")) == pytest.approx(level, rel=0.01)


def test_a_sweep_meets_the_resonance_when_its_frequency_does(tmp_path):
    swept = RECORD.replace(
        'kind = "sine"\nplane = "yaw"\nfrequency = "9.8 Hz"',
        'kind = "sine sweep"\nplane = "yaw"\nband = ["5 Hz", "15 Hz"]\nlaw = "linear"',
    ).replace('shaker_off = "0.4 s"', "")
    (tmp_path / "swept.toml").write_text((SMALL + swept).replace('"1 s"', '"40 s"'))
    plan = load_campaign(tmp_path / "swept.toml")
    channel = point_acquisition(plan, plan.points[-1], seed=2).channels["ay_face"]
    loudest = channel.time_s[np.argmax(np.abs(channel.values("m/s^2")))]
    assert 5 + loudest / 4 == pytest.approx(9.8, abs=0.4)  # it lags a little


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("scale =", "scael =", "unknown key package.scael; did you mean scale?"),
        ('"6 K / hour"', '"6 K"', "package.warming: '6 K' is not a quantity in K/s"),
        (
            "[package]",
            '[[sensor]]\nname = "az_nose"\n[package]',
            "sensor[0]: no sensor is called az_nose; choose one of aoa_unfiltered, ",
        ),
    ],
)
def test_errors_that_cannot_be_are_one_sentence(tmp_path, old, new, message):
    path = tmp_path / "wrong.toml"
    path.write_text((SMALL + WRONG).replace(old, new))
    with pytest.raises(SetupError, match=f"^{re.escape(f'{path}: {message}')}"):
        load_campaign(path)


def test_the_papers_records_show_its_figures():
    records = {p.name: p for p in load_campaign("paper").points if p.run_kind == "record"}
    off = [p for p in records.values() if p.series.shaker_off]
    assert [p.series.frequency for p in off] == [9.8, 19.5, 29.8]
    assert all(p.duration_s >= 2 * p.series.shaker_off for p in off)
    assert all(records[name].duration_s >= 85 for name in records if "regression" in name)
    filmed = [p for p in records.values() if p.n_fields]
    assert [(p.n_fields, p.window[1]) for p in filmed] == [(276, 20)] * 2  # 4.6 s


@pytest.mark.usefixtures("flat")
def test_the_truth_in_the_file_is_that_of_the_stored_poses(tmp_path):
    """The body's axis through two of its points, nose to the left, from the file alone."""
    (tmp_path / "a.toml").write_text(SMALL + RECORD)
    for path in simulate_campaign(load_campaign(tmp_path / "a.toml"), tmp_path / "out", seed=4):
        truth = read_truth(path)
        tail, nose = (truth["pose"] @ np.array([x, 0.0, 0.0, 1.0]) for x in (-0.3, 0.9))
        along = nose - tail
        level = np.hypot(along[..., 0], along[..., 1])
        pitch = np.degrees(np.arctan(along[..., 2] / level)).mean(axis=1)
        yaw = np.degrees(np.arctan(along[..., 1] / along[..., 0])).mean(axis=1)
        share = -tail[..., 0] / along[..., 0]
        height = 1e3 * (tail[..., 2] + share * along[..., 2]).mean(axis=1)
        np.testing.assert_allclose(truth["pitch_deg"], pitch, rtol=0, atol=1e-9)
        np.testing.assert_allclose(truth["yaw_deg"], yaw, rtol=0, atol=1e-9)
        np.testing.assert_allclose(truth["axis_intercept_mm"], height, rtol=0, atol=1e-9)
