import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from campaigns import SMALL, FlatRenderer

from glint_aoa.errors import OutputError, SetupError
from glint_aoa.records.formats.hdf5 import (
    open_hdf5,
    read_acquisition,
    read_truth,
)
from render_sim.campaign import (
    Campaign,
    load_campaign,
    point_acquisition,
    point_motion,
    simulate_campaign,
    simulate_point,
)
from render_sim.excitation import peak_to_peak
from render_sim.modes import balance_moment, modal_angles
from render_sim.scene import paper_scene


@pytest.fixture
def small(tmp_path: Path) -> Campaign:
    path = tmp_path / "small.toml"
    path.write_text(SMALL)
    return load_campaign(path)


def test_paper_has_its_numbers_of_points():
    campaign = load_campaign("paper")
    driven = [p for p in campaign.points if p.run_kind == "dynamic" and p.series is not None]
    assert Counter(p.series.plane for p in driven) == {"yaw": 49, "pitch": 42}
    yaw_angles = {round(np.rad2deg(p.angle_rad), 6) for p in driven if p.series.plane == "yaw"}
    assert yaw_angles == {0.0, 4.3, 6.0}


@pytest.mark.parametrize("name", ["paper", "demo"])
def test_runs_stand_between_points_with_the_shaker_off(name):
    campaign = load_campaign(name)
    for run in campaign.run:
        points = [p for p in campaign.points if p.run == run.name]
        assert points[0].series is None
        assert points[-1].series is None
        assert all(p.series is not None for p in points[1:-1])
        assert [p.progress for p in (points[0], points[-1])] == [0.0, 1.0]


@pytest.mark.parametrize("name", ["paper", "demo"])
def test_sweep_goes_from_minus_6_to_6_by_whole_degrees(name):
    points = [p for p in load_campaign(name).points if p.run_kind == "sweep"]
    angles = np.rad2deg([p.angle_rad for p in points])
    np.testing.assert_allclose(angles, np.arange(-6, 7), atol=1e-12)


def test_demo_shows_every_excitation_up_to_the_largest_moments():
    points = [p for p in load_campaign("demo").points if p.series is not None]
    assert Counter(p.series.plane for p in points) == {"yaw": 14, "pitch": 12}
    assert {p.series.kind for p in points} == {"sine", "modulated sine", "random"}
    for plane in ("yaw", "pitch"):
        largest = max(p.moment_n_m for p in points if p.series.plane == plane)
        assert largest > 5000 * 0.1129848


def test_point_names_are_in_order(small):
    assert [p.name for p in small.points] == [
        "sweep-01",
        "sweep-02",
        "sweep-03",
        "yaw-01",
        "yaw-02",
        "yaw-03",
    ]
    assert [p.order for p in small.points] == list(range(6))


def test_level_is_the_peak_to_peak_moment_over_the_record():
    campaign = load_campaign("demo")
    point = next(p for p in campaign.points if p.series and p.series.kind == "random")
    force = point_motion(campaign, point, seed=5).forces["pitch"]
    angles = modal_angles(campaign.model, force, "pitch")
    moment = balance_moment(campaign.model, force, angles, "pitch")
    assert peak_to_peak(moment, duration_s=8.0) == pytest.approx(point.moment_n_m, rel=1e-9)


def test_recorded_moment_of_a_random_point_has_its_level():
    campaign = load_campaign("demo")
    point = next(p for p in campaign.points if p.name == "pitch-random-04")
    record = point_acquisition(campaign, point, seed=5)
    moment = record.channels["pitch_moment"].values("in*lbf")
    assert np.ptp(moment) == pytest.approx(5200, rel=5e-3)


@pytest.mark.parametrize(
    ("name", "bias_deg"), [("yaw-0deg-sine-06", -0.217), ("pitch-sine-06", -0.174)]
)
def test_largest_bias_is_that_of_table_4(name, bias_deg):
    campaign = load_campaign("demo")
    point = next(p for p in campaign.points if p.name == name)
    bias = point_acquisition(campaign, point).truth["bias_deg"]
    assert bias.mean() == pytest.approx(bias_deg, abs=0.005)


def test_static_pitch_drifts_by_run_and_linearly_within():
    campaign = load_campaign("paper")
    offsets, changes = [], []
    for run in campaign.run:
        points = [p for p in campaign.points if p.run == run.name]
        pitch = [
            np.arcsin(point_motion(campaign, p, seed=8).static.pose(np.zeros(()))[2, 0])
            for p in (points[0], points[len(points) // 2], points[-1])
        ]
        middle = pitch[0] + points[len(points) // 2].progress * (pitch[2] - pitch[0])
        assert pitch[1] == pytest.approx(middle, abs=1e-12)
        offsets.append(np.rad2deg(np.mean(pitch[::2]) - run.angle))
        changes.append(np.rad2deg(pitch[2] - pitch[0]))
    assert 0.0015 < np.std(offsets) < 0.0045
    assert 0.00075 < np.std(changes) < 0.00225


def test_points_do_not_depend_on_each_other(small):
    """The same name and seed give the same motion, whatever else is in the campaign."""
    alone = small.model_copy(update={"sweep": ()})
    time = np.linspace(0, 1, 7)
    poses = [
        point_motion(c, next(p for p in c.points if p.name == "yaw-02"), seed=3).motion.pose(time)
        for c in (small, alone)
    ]
    np.testing.assert_array_equal(*poses)


def test_seed_changes_the_phases(small):
    point = small.points[4]
    forces = [
        point_motion(small, point, seed=seed).forces["yaw"].amplitude[0] for seed in (0, 0, 1)
    ]
    assert forces[0] == forces[1]
    assert abs(forces[0] - forces[2]) > 1e-6


def test_simulated_point_is_whole(small):
    recorded = simulate_point(small, small.points[4], renderer=FlatRenderer(), seed=2)
    assert recorded.fields.shape == (2, 92, 752)
    assert recorded.info.trigger_time == "2026-01-12T08:20:00"
    assert len(recorded.acquisition.channels) == 28
    assert set(recorded.truth) >= {"pitch_deg", "pose", "static_pitch_deg", "bias_deg"}
    versions, plan_hash = recorded.meta["versions"], recorded.meta["plan_hash"]
    assert re.fullmatch("[0-9a-f]{16}", plan_hash)
    assert recorded.meta == {
        "campaign": "small",
        "run": "yaw",
        "run_kind": "dynamic",
        "point": "yaw-02",
        "excitation": "yaw sine 9.8 Hz",
        "excitation_plane": "yaw",
        "excitation_kind": "sine",
        "nominal_moment_in_lb": pytest.approx(3000),
        "nominal_angle_deg": pytest.approx(4.3),
        "nominal_yaw_deg": 0.0,
        "tunnel_temperature_K": 294.0,
        "versions": versions,
        "seed": 2,
        "renderer": "flat",
        "plan_hash": plan_hash,
    }


def test_shaker_off_says_so(small):
    recorded = simulate_point(small, small.points[0], renderer=FlatRenderer())
    meta = recorded.meta
    assert (meta["excitation"], meta["excitation_kind"], meta["run_kind"]) == (
        "off",
        "off",
        "sweep",
    )
    assert meta["excitation_plane"] == "none"
    assert meta["nominal_moment_in_lb"] == 0


def test_film_and_acquisition_share_the_motion(small):
    """The film's truth is the motion that the acquisition felt."""
    point = small.points[4]
    recorded = simulate_point(small, point, renderer=FlatRenderer(), seed=2)
    motion = point_motion(small, point, seed=2).motion
    aux = recorded.acquisition["aux_aoa"].values("deg")
    exact = np.rad2deg(np.arcsin(motion.pose(np.arange(400) / 800)[:, 2, 0]))
    np.testing.assert_allclose(aux, exact, rtol=0, atol=0.06)
    assert recorded.truth["pitch_deg"][0] == pytest.approx(exact[0], abs=1e-3)


@pytest.mark.usefixtures("flat")
def test_campaign_writes_points_that_can_be_read(small, tmp_path):
    paths = list(simulate_campaign(small, tmp_path / "out", seed=1))
    assert [p.name for p in paths] == [f"{p.name}.h5" for p in small.points]
    record = read_acquisition(paths[4])
    assert len(record.channels) == 28
    assert record.channels["ay_face"].axis == "+y"
    assert record.channels["aux_aoa"].units == "deg"
    assert record.meta["excitation"] == "yaw sine 9.8 Hz"
    again = simulate_point(small, small.points[4], renderer=FlatRenderer(), seed=1)
    np.testing.assert_array_equal(open_hdf5(paths[4]).read(0, 2), again.fields)
    np.testing.assert_array_equal(read_truth(paths[4])["bias_deg"], again.truth["bias_deg"])
    for name, channel in again.acquisition.channels.items():
        np.testing.assert_array_equal(record.channels[name].samples, channel.samples)
        assert record.channels[name].limits == channel.limits


@pytest.mark.usefixtures("flat")
def test_nothing_is_overwritten_unless_allowed(small, tmp_path):
    (tmp_path / "yaw-02.h5").write_text("")
    expected = (
        f"{tmp_path}: yaw-02.h5 exists already; choose another folder, resume or allow overwriting"
    )
    with pytest.raises(OutputError, match=f"^{re.escape(expected)}$"):
        simulate_campaign(small, tmp_path)
    assert len(list(simulate_campaign(small, tmp_path, overwrite=True))) == 6


@pytest.mark.usefixtures("flat")
def test_a_campaign_goes_on_where_it_stopped(small, tmp_path):
    begun = simulate_campaign(small, tmp_path, seed=1)
    done = [next(begun), next(begun)]
    before = [path.stat().st_mtime_ns for path in done]
    paths = list(simulate_campaign(small, tmp_path, seed=1, resume=True))
    assert paths == [tmp_path / f"{point.name}.h5" for point in small.points]
    assert [path.stat().st_mtime_ns for path in done] == before
    again = simulate_point(small, small.points[4], renderer=FlatRenderer(), seed=1)
    np.testing.assert_array_equal(open_hdf5(paths[4]).read(0, 2), again.fields)


@pytest.mark.usefixtures("flat")
@pytest.mark.parametrize(
    ("changes", "how", "what"),
    [
        ({}, {"seed": 2}, "seed"),
        ({"temperature": 300.0}, {"seed": 1}, "campaign or scene"),
        ({}, {"seed": 1, "scene": paper_scene().with_window(90, 92)}, "campaign or scene"),
    ],
)
def test_what_another_campaign_wrote_is_not_gone_on_with(small, tmp_path, changes, how, what):
    first = next(simulate_campaign(small, tmp_path, seed=1))
    changed = small.model_copy(update=changes)
    expected = f"{first}: was simulated with another {what}; choose another folder or overwrite"
    with pytest.raises(OutputError, match=f"^{re.escape(expected)}$"):
        simulate_campaign(changed, tmp_path, resume=True, **how)


@pytest.mark.usefixtures("flat")
def test_folder_that_cannot_be_made(small, tmp_path):
    (tmp_path / "file").write_text("")
    expected = f"{tmp_path / 'file'}: the folder cannot be made (File exists)"
    with pytest.raises(OutputError, match=f"^{re.escape(expected)}$"):
        simulate_campaign(small, tmp_path / "file")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("n_fields", "fields", "unknown key fields; did you mean n_fields?"),
        ("moments =", "levels =", "unknown key run[0].series[0].levels; known keys here: kind, "),
        (
            'frequency = "9.8 Hz"',
            "",
            "run[0].series[0]: sine needs a frequency, such as frequency = '9.8 Hz'",
        ),
        (
            "3000 in*lbf",
            "3000 in",
            "run[0].series[0].moments[0]: '3000 in' is not a quantity in N*m",
        ),
        ("3000 in*lbf", "-5 N*m", "run[0].series[0].moments[0]: -5 must be greater"),
        (
            'name = "yaw"',
            'name = "sweep"',
            "two points are called sweep-01; rename a run or record",
        ),
        ('name = "yaw"', 'name = "../yaw"', "run[0].name: String should match pattern"),
        ("points = 3", "points = 1", "sweep[0].points: Input should be greater than or equal to 2"),
    ],
)
def test_wrong_campaign_is_one_sentence_that_names_the_key(tmp_path, old, new, message):
    path = tmp_path / "campaign.toml"
    assert old in SMALL
    path.write_text(SMALL.replace(old, new))
    with pytest.raises(SetupError, match=f"^{re.escape(f'{path}: {message}')}"):
        load_campaign(path)


def test_empty_campaign(tmp_path):
    path = tmp_path / "empty.toml"
    path.write_text('name = "empty"\nstart = 2026-01-12T08:00:00\n')
    expected = f"{path}: no points; give at least one [[run]], [[sweep]] or [[record]]"
    with pytest.raises(SetupError, match=f"^{re.escape(expected)}$"):
        load_campaign(path)


def test_unknown_campaign_names_the_choices():
    expected = "no campaign is called papre; choose paper, demo or a TOML file"
    with pytest.raises(SetupError, match=f"^{re.escape(expected)}$"):
        load_campaign("papre")
