"""Points fused end to end: closed-form rigid-body records, synthetic optical angles."""

import json
import re
from dataclasses import replace
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import scipy.stats

from benchmarks.fusion_coverage import STUDIES, run
from benchmarks.rigid_tones import Imperfections, ModeMotion, record, time_of, tones
from glint_aoa.errors import OutputError, RecordingError
from glint_aoa.flags import Flag
from glint_aoa.fusion import OpticalAngles, fuse, write_fused
from glint_aoa.records.acquisition import AcquisitionRecord
from glint_aoa.records.fields import FieldInfo
from glint_aoa.records.points import RecordedPoint, write_point
from glint_aoa.records.tables import read_csv
from glint_aoa.setup import Setup

INCH = 0.0254
PITCH_DEG = 3.0
NOISE_DEG = 0.0009
PERFECT = Imperfections(gain_std=0.0, misalignment_std=0.0)


class Point:
    """A point that vibrates in modes 1 and 2, and its truth."""

    def __init__(self, duration_s, *, amplitudes=(0.1, 0.25), imperfections=PERFECT, places=None):
        rng = np.random.default_rng(11)
        self.time = time_of(duration_s)
        tone = [
            tones(self.time, [hz], [np.radians(deg)], [phase])
            for hz, deg, phase in ((9.8, amplitudes[0], 0.4), (9.2, amplitudes[1], 1.9))
        ]
        self.modes = [
            ModeMotion(1, "yaw", 9.8, 31.0 * INCH, *tone[0]),
            ModeMotion(2, "pitch", 9.2, 30.2 * INCH, *tone[1]),
        ]
        self.record = record(
            self.modes,
            pitch_deg=PITCH_DEG,
            rng=rng,
            imperfections=imperfections,
            places=places or ("face", "mid", "aft"),
        )
        yaw, pitch = tone[0][0], tone[1][0]
        self.pitch_deg = PITCH_DEG + np.degrees(pitch - np.tan(np.radians(PITCH_DEG)) * yaw**2 / 2)
        self.yaw_deg = np.degrees(yaw) / np.cos(np.radians(PITCH_DEG))

    def optical(self, *, seconds=1.0, crosstalk=0.012):
        """Angles of fields from the start on, with noise and a part of yaw."""
        at = np.arange(round(seconds * 60)) / 60 + 5e-4
        noise = np.random.default_rng(12).normal(0.0, NOISE_DEG, at.size)
        clean = np.interp(at, self.time, self.pitch_deg + crosstalk * self.yaw_deg)
        return OpticalAngles(
            at,
            clean + noise,
            np.full(at.size, NOISE_DEG),
            np.zeros(at.size, np.int64),
            exposure_s=1e-3,
            systematic_std_deg=1e-4,
        )


@pytest.fixture(scope="module")
def point():
    return Point(5.0)


@pytest.fixture(scope="module")
def fused(point):
    return fuse(point.record, point.optical())


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def only(found, *, places):
    return AcquisitionRecord(
        found.name,
        {
            name: channel
            for name, channel in found.channels.items()
            if name == "aoa_unfiltered" or name.endswith(places)
        },
    )


def test_at_the_fields_the_error_is_a_third_of_the_optical_one(point, fused):
    error = fused.pitch_deg - point.pitch_deg
    assert rms(error) < NOISE_DEG / 2
    optical = point.optical()
    alone = optical.angle_deg - np.interp(optical.time_s, point.time, point.pitch_deg)
    assert rms(np.interp(optical.time_s, point.time, error)) < rms(alone) / 3
    assert rms(fused.yaw_deg - point.yaw_deg) < 0.002
    assert rms(error / fused.pitch_std_deg) < 2.0
    assert not fused.flags.any()


def test_radii_come_without_a_survey(fused):
    found = {mode.plane: mode for mode in fused.modes}
    assert sorted(found) == ["pitch", "yaw"]
    for plane, frequency, inches in (("yaw", 9.8, 31.0), ("pitch", 9.2, 30.2)):
        mode = found[plane]
        assert mode.frequency_hz == pytest.approx(frequency, abs=0.05)
        assert mode.radius_m == pytest.approx(inches * INCH, rel=0.02)
        assert abs(mode.radius_m - inches * INCH) < 4 * mode.radius_std_m
        assert mode.number is None


def test_modes_of_the_setup_give_their_numbers(point):
    modes = [{"number": 2, "plane": "pitch", "frequency": "9.3 Hz", "radius": "0.8 m"}]
    setup = Setup.model_validate({"inertial": {"mode": modes}})
    numbers = {mode.plane: mode.number for mode in fuse(point.record, None, setup).modes}
    assert numbers == {"yaw": None, "pitch": 2}


def test_sources_are_consistent(fused):
    assert not fused.flags.any()
    assert 0.5 < fused.consistency["optical"] < 1.5
    assert fused.consistency["package"] < 2.0
    assert fused.notes == []


def test_a_gain_is_learnt_from_the_video(point):
    channel = point.record.channels["az_face"]
    wrong = {**point.record.channels, "az_face": replace(channel, scale=1.02 * channel.scale)}
    found = fuse(AcquisitionRecord("wrong", wrong), point.optical())
    value, std = found.unknowns["gain of az_face"]
    assert value == pytest.approx(0.02, abs=4 * std)
    assert std < 0.005
    assert rms(found.pitch_deg - point.pitch_deg) < NOISE_DEG / 2


def test_fields_that_scatter_more_than_they_say_count_less(point):
    optical = point.optical()
    found = fuse(point.record, replace(optical, std_deg=optical.std_deg / 5))
    (note,) = found.notes
    scatter = float(re.fullmatch(r"the fields scatter (\S+) times as far as they say", note)[1])
    assert 3.0 < scatter < 5.5
    assert found.consistency["optical"] == pytest.approx(1.0, abs=0.3)


def test_time_can_start_anywhere(point, fused):
    later = {
        name: replace(channel, start_s=channel.start_s + 64.0)
        for name, channel in point.record.channels.items()
    }
    optical = point.optical()
    found = fuse(AcquisitionRecord("later", later), replace(optical, time_s=optical.time_s + 64.0))
    np.testing.assert_allclose(found.pitch_deg, fused.pitch_deg, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.time_s, fused.time_s + 64.0, rtol=0, atol=1e-9)


def test_yaw_mirrored_is_yaw_negated(point, fused):
    mirrored = {
        name: replace(channel, axis="-y") if channel.axis == "+y" else channel
        for name, channel in point.record.channels.items()
    }
    found = fuse(AcquisitionRecord("mirrored", mirrored), point.optical())
    np.testing.assert_allclose(found.yaw_deg, -fused.yaw_deg, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.pitch_deg, fused.pitch_deg, rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        found.pitch_yaw_covariance_deg2, -fused.pitch_yaw_covariance_deg2, rtol=0, atol=1e-12
    )


def test_fields_that_were_not_measured_are_as_if_not_there(point):
    optical = point.optical()
    lost = np.arange(20, 40)
    angle, flags = optical.angle_deg.copy(), optical.flags.copy()
    angle[lost[:10]] = np.nan
    flags[lost[10:]] = Flag.NO_GLINT
    spoilt = fuse(point.record, replace(optical, angle_deg=angle, flags=flags))
    kept = np.delete(np.arange(60), lost)
    short = {
        name: getattr(optical, name)[kept] for name in ("time_s", "angle_deg", "std_deg", "flags")
    }
    np.testing.assert_array_equal(
        spoilt.pitch_deg, fuse(point.record, replace(optical, **short)).pitch_deg
    )
    assert spoilt.settings["fields_used"] == 40


def test_three_seconds_of_fog_are_bridged_and_the_uncertainty_grows(point):
    optical = point.optical(seconds=5.0)
    clear = (optical.time_s < 1.0) | (optical.time_s > 4.0)
    fog = replace(optical, angle_deg=np.where(clear, optical.angle_deg, np.nan))
    found = fuse(point.record, fog)
    inside = (point.time > 1.0) & (point.time < 4.0)
    assert np.abs(found.pitch_deg - point.pitch_deg)[inside].max() < 0.005
    middle = found.pitch_std_deg[np.abs(point.time - 2.5) < 0.2].mean()
    assert middle > fuse(point.record, optical).pitch_std_deg[np.abs(point.time - 2.5) < 0.2].mean()


def test_without_video_the_package_carries_the_angle(point):
    found = fuse(point.record)
    error = found.pitch_deg - point.pitch_deg
    assert rms(error) < 0.001
    assert found.pitch_std_deg.mean() == pytest.approx(0.01, rel=0.2)
    assert np.all(found.flags & Flag.FEW_FIELDS)
    assert np.all(
        found.flags & Flag.UNCERTAIN_CORRECTION
        == np.where(found.pitch_std_deg > 0.01, Flag.UNCERTAIN_CORRECTION, 0)
    )


def test_one_accelerometer_a_plane_learns_its_radius(point):
    found = fuse(only(point.record, places="face"), point.optical())
    assert np.all(found.flags & Flag.UNCERTAIN_CORRECTION)
    radii = {mode.plane: mode for mode in found.modes}
    assert radii["pitch"].radius_m == pytest.approx(30.2 * INCH, rel=0.02)
    assert radii["pitch"].radius_std_m < 0.02
    assert rms(found.pitch_deg - point.pitch_deg) < 0.001
    assert len(found.notes) == 2


def test_clipped_samples_are_left_out_and_flagged(point):
    channel = point.record.channels["az_face"]
    limit = 0.8 * np.abs(channel.values("m/s^2") - channel.values("m/s^2").mean()).max()
    mean = channel.values("m/s^2").mean()
    clipped = replace(
        channel,
        samples=np.clip(channel.values("m/s^2"), mean - limit, mean + limit),
        scale=1.0,
        limits=(mean - limit, mean + limit),
    )
    found = fuse(
        AcquisitionRecord("clipped", {**point.record.channels, "az_face": clipped}),
        point.optical(),
    )
    bad = clipped.clipped
    assert 0.1 < bad.mean() < 0.5
    np.testing.assert_array_equal(found.flags & Flag.CLIPPED_CHANNEL != 0, bad)
    assert rms(found.pitch_deg - point.pitch_deg) < NOISE_DEG


def test_without_accelerometers_in_yaw_yaw_is_not_known(point):
    channels = {k: c for k, c in point.record.channels.items() if c.axis != "+y"}
    found = fuse(AcquisitionRecord("blind", channels), point.optical())
    assert np.isnan(found.yaw_deg).all()
    assert found.notes == [
        "no accelerometer along model y: yaw is not known, nor its part of the package's bias"
    ]
    assert np.isfinite(found.pitch_deg).all()


def test_without_accelerometers_in_pitch_it_says_so(point):
    channels = {k: c for k, c in point.record.channels.items() if c.axis != "+z"}
    message = (
        "blind: no accelerometer along model z shows the vibration in pitch; record one, or give "
        "its axis under [[inertial.channel]] in the setup"
    )
    with pytest.raises(RecordingError, match=f"^{re.escape(message)}$"):
        fuse(AcquisitionRecord("blind", channels))


def test_a_record_must_last_a_second():
    short = Point(0.5).record
    message = (
        "tones: the record lasts 0.5 s, but the fusion takes 1 to 120 s; cut it to a stretch of "
        "that length"
    )
    with pytest.raises(RecordingError, match=f"^{re.escape(message)}$"):
        fuse(short)


def test_a_filtered_output_needs_time_to_settle(point):
    channel = replace(point.record.channels["aoa_unfiltered"], quantity="aoa_filtered")
    filtered = AcquisitionRecord("filtered", {**point.record.channels, "aoa_unfiltered": channel})
    assert fuse(filtered, point.optical()).settings["package_channel"] == "aoa_unfiltered"
    message = (
        "filtered: only the package's filtered output is recorded, and its filter needs 2.62 s to "
        "settle; record longer, or the unfiltered output"
    )
    with pytest.raises(RecordingError, match=f"^{re.escape(message)}$"):
        fuse(filtered.segment(0, 1600), point.optical())


def test_intervals_cover_the_truth_of_a_few_draws():
    pitch, *_ = run(STUDIES["video"], 24, seed=5)
    assert pitch.known.all()
    held = np.sum(np.abs(pitch.error) <= 1.96 * pitch.std)
    low, high = scipy.stats.binom.ppf([0.001, 0.999], 24, 0.95)
    assert low <= held <= high
    assert 0.6 < np.sqrt(np.mean((pitch.error / pitch.std) ** 2)) < 1.5


def test_files_hold_the_columns_and_the_modes(fused, tmp_path):
    table, netcdf = write_fused(tmp_path / "out", "point", fused)
    rows = read_csv(table)
    assert list(rows) == [
        "time_s",
        "pitch_deg",
        "pitch_std_deg",
        "yaw_deg",
        "yaw_std_deg",
        "pitch_yaw_covariance_deg2",
        "flags",
    ]
    assert float(rows["pitch_deg"][100]) == pytest.approx(fused.pitch_deg[100], abs=1e-6)
    with netCDF4.Dataset(netcdf) as file:
        assert file["pitch_deg"].units == "deg"
        assert file.mode_plane == "pitch, yaw"
        np.testing.assert_allclose(file.mode_radius_m, [m.radius_m for m in fused.modes])
    message = f"{table} is there already; give another --out, or --overwrite to replace it"
    with pytest.raises(OutputError, match=f"^{re.escape(message)}$"):
        write_fused(tmp_path / "out", "point", fused)


@pytest.fixture
def folder(point, tmp_path):
    """A point of a line that stands still and a moving record, one without fields, and a setup."""
    row = 18.3 + np.tan(np.radians(PITCH_DEG)) * (np.arange(120) - 59.5)
    light = 10 + 150 * np.exp(-0.5 * ((np.arange(40)[:, None] - row) / 1.4) ** 2)
    noisy = np.random.default_rng(6).normal(light, 1.0, (12, 40, 120))
    fields = np.rint(noisy).astype(np.uint8)
    info = FieldInfo(rate_hz=60.0, interlaced=False, exposure_s=1e-3)
    for name, each in (("point", fields), ("dark", None)):
        recorded = RecordedPoint(fields=each, info=info, acquisition=point.record)
        write_point(tmp_path / f"{name}.h5", recorded)
    write_point(tmp_path / "film.h5", RecordedPoint(fields=fields, info=info))
    (tmp_path / "glint-aoa.toml").write_text('[glint]\nnose = "left"\n')
    return tmp_path


def test_the_command_fuses_points(program, folder):
    setup, out = folder / "glint-aoa.toml", folder / "out"
    code, said, _ = program(
        "fuse", folder / "point.h5", folder / "dark.h5", "-s", setup, "-o", out, "--json"
    )
    told = json.loads(said)
    assert code == 0
    assert [each["fields_used"] for each in told] == [12, 0]
    assert told[0]["mean_pitch_deg"] == pytest.approx(PITCH_DEG, abs=0.03)
    assert told[1]["mean_pitch_deg"] == pytest.approx(PITCH_DEG, abs=0.001)
    assert {mode["plane"] for mode in told[1]["modes"]} == {"pitch", "yaw"}
    assert (out / "dark-fused.nc").exists()
    code, said, errors = program("fuse", folder / "dark.h5", "-s", setup, "-o", folder / "b")
    assert re.search(r"^dark +0 +\+(2\.99|3\.00)\d\d +0\.010\d ", said, re.MULTILINE)
    assert "FEW_FIELDS" in errors


def test_the_command_refuses_what_it_cannot_fuse(program, folder):
    setup, out = folder / "glint-aoa.toml", folder / "out"
    code, _, said = program("fuse", folder / "film.h5", "-s", setup, "-o", out)
    assert code == 2
    assert said == (
        f"glint-aoa: {folder / 'film.h5'}: no acquisition channels in it or beside it; fuse needs "
        "the onboard package's output and accelerometers on the same trigger\n"
    )
    code, _, said = program(
        "fuse", folder / "dark.h5", "-s", setup, "-o", out, "--package-std", "0"
    )
    assert code == 2
    assert said == "glint-aoa: --package-std is 0; give an uncertainty above zero\n"


def test_the_python_of_the_page_runs(folder, monkeypatch, capsys):
    page = Path(__file__).parents[1] / "docs" / "fusion.md"
    (code,) = re.findall(r"^```python\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL)
    monkeypatch.chdir(folder)
    exec(compile(code, "fusion.md", "exec"), {})
    pitch = float(capsys.readouterr().out.split()[0])
    assert pitch == pytest.approx(PITCH_DEG, abs=0.03)
    assert (folder / "fused" / "point-fused.csv").exists()
