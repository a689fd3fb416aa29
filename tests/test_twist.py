"""Wing twist: on rendered wings, on exact centres, and what it refuses."""

import re
from pathlib import Path

import numpy as np
import pytest
import wings
from independent_camera import Camera as IndependentCamera
from independent_camera import turned

from benchmarks.twist_coverage import CASES, STATED_STD, coverage
from calibration.twist.measure import measure_twist
from calibration.twist.sighting import Sightings, sight_targets
from calibration.twist.wing_targets import read_wing_targets
from glint_aoa.errors import CalibrationError, SetupError
from glint_aoa.setup import Camera, Glint, Setup
from render_sim.wing import WingSection

OPENCV = IndependentCamera(
    position=(0.0, -56 * 0.0254, 0.060),
    rotation=(2.0, -1.0, 1.5),
    distortion=(-0.1, 0.02, 1e-3, -5e-4, 0.0),
)


def sighted(wing, uv, *, name="drawn", rng=None, noise=1.0):
    """Exact or noisy centres, uv of shape (picture, target, 2) or (target, 2)."""
    uv = np.atleast_3d(uv) if uv.ndim == 3 else uv[None]
    if rng is not None:
        uv = uv + noise * np.array(STATED_STD) * rng.standard_normal(uv.shape)
    return Sightings(
        name=name,
        ids=wing.ids,
        uv=uv,
        covariance=np.broadcast_to(np.diag(np.square(STATED_STD)), (*uv.shape, 2)),
        semi_axes=np.tile([11.8, 4.9], (len(wing), 1)),
        clipped=np.zeros(len(wing), bool),
    )


def measured(wing, before, after, rng, fields):
    states = []
    for name, rows in (("no flow", before), ("flow", after)):
        start = states[0].mean()[0] if states else None
        pictures = wings.photographs(rows, fields, rng)
        states.append(sight_targets(pictures, wing, wings.CAMERA, name=name, start=start))
    return states


@pytest.mark.parametrize(("nose", "fields"), [("left", 4), ("right", 2)])
def test_twist_of_a_rendered_wing(nose, fields):
    """Within 0.005 deg, the goal, and within what is stated."""
    rng = np.random.default_rng(1)
    rows, twists = wings.sections(), (2.0, -1.5)
    wing = wings.targets(rows)
    states = measured(wing, rows, wings.flown(rows, twists, nose), rng, fields)
    setup = Setup(camera=wings.CAMERA, glint=Glint(nose=nose))
    result = measure_twist(wing, *states, setup, reference="body")
    for station, true in zip(result.stations, twists, strict=True):
        assert abs(station.twist_deg - true) < 0.005
        assert abs(station.twist_deg - true) < 4 * station.twist_std_deg
        assert station.twist_std_deg < 0.003 / np.sqrt(fields)
        assert station.excess == 1
        assert len(station.used) == 6
    body, tip = result.stations
    assert (body.relative_deg, body.relative_u95_deg) == (0, 0)
    assert abs(tip.relative_deg + 3.5) < 0.005
    assert tip.relative_std_deg == pytest.approx(np.hypot(body.twist_std_deg, tip.twist_std_deg))
    assert result.clipped == ()


def test_places_in_space_and_the_correction_for_perspective():
    """Large discs that lie obliquely: their centres come out only where the radius is known."""
    rng = np.random.default_rng(2)
    rows = [WingSection(row.centres_m, 0.012, normal=(0.3, -1.0, 0.8)) for row in wings.sections(4)]
    true = np.concatenate([row.centres_m for row in rows])[:, [0, 2]]
    pictures = wings.photographs(rows, 4, rng, gradient=0.0)
    errors = []
    for radius in (0.012, 0.0):
        normal = np.tile([0.3, -1.0, 0.8], (8, 1))
        wing = wings.targets(rows, radius=np.full(8, radius), normal=normal)
        seen = sight_targets(pictures, wing, wings.CAMERA, name="still")
        result = measure_twist(wing, seen, seen, wings.SETUP)
        found = np.array([each.no_flow_xz_m for each in result.targets])
        errors.append(np.sqrt(np.mean((found - true) ** 2)))
        assert [one.twist_deg for one in result.stations] == pytest.approx([0, 0], abs=1e-9)
    assert errors[0] < 3e-6  # metres; a column is 475 um wide there
    assert errors[1] > 4 * errors[0]


@pytest.mark.parametrize("yaw", [0.0, 5.0])
def test_exact_centres_give_the_exact_twist(yaw):
    """OpenCV projects; turns and bends of some degrees and centimetres."""
    rows = wings.sections()
    about_z = turned("z", yaw)
    uv = []
    for twists in ((0.0, 0.0), (6.0, -4.0)):
        places = []
        for row, twist, shift in zip(rows, twists, ((0, 0, 0.01), (0.004, 0, 0.02)), strict=True):
            y = row.centres_m[0, 1]
            flat = (row.centres_m - [0, y, 0]) @ turned("y", twist).T + np.array(shift)
            places.append(flat @ about_z.T + [0, y, 0])
        uv.append(np.stack(OPENCV.pixels(np.concatenate(places)), axis=-1))
    wing = wings.targets(rows, radius=np.zeros(12))
    setup = Setup(camera=wings.CAMERA, glint=Glint(nose="left", yaw=f"{yaw} deg"))
    result = measure_twist(wing, sighted(wing, uv[0]), sighted(wing, uv[1]), setup)
    assert [one.twist_deg for one in result.stations] == pytest.approx([6, -4], abs=1e-8)
    assert [one.rms_m for one in result.stations] == pytest.approx([0, 0], abs=1e-9)
    right = Setup(camera=wings.CAMERA, glint=Glint(nose="right", yaw=f"{yaw} deg"))
    result = measure_twist(wing, sighted(wing, uv[0]), sighted(wing, uv[1]), right)
    assert [one.twist_deg for one in result.stations] == pytest.approx([-6, 4], abs=1e-8)


def test_displacement_of_the_station():
    rows = wings.sections()
    wing = wings.targets(rows)
    moved = [
        WingSection(row.centres_m + np.array([0.002, 0.0, 0.004 * k]), row.radius_m)
        for k, row in enumerate(rows)
    ]
    states = (sighted(wing, wings.pixels(each)) for each in (rows, moved))
    body, tip = measure_twist(wing, *states, wings.SETUP).stations
    assert (body.shift_x_m, body.shift_z_m) == pytest.approx((0.002, 0.0), abs=1e-7)
    assert (tip.shift_x_m, tip.shift_z_m) == pytest.approx((0.002, 0.004), abs=1e-7)
    assert body.relative_deg is None


def test_a_station_that_comes_nearer():
    """Bending draws a tip inboard: its scale changes, its rotation does not."""
    rng = np.random.default_rng(4)
    rows = wings.sections()
    wing = wings.targets(rows)
    after = [
        WingSection(row.centres_m - np.array([0.0, 0.003, 0.0]), row.radius_m)
        for row in wings.flown(rows, (1.0, -2.0))
    ]
    states = sighted(wing, wings.pixels(rows), rng=rng), sighted(wing, wings.pixels(after), rng=rng)
    held = measure_twist(wing, *states, wings.SETUP).stations
    free = measure_twist(wing, *states, wings.SETUP, free_scale=True).stations
    for one, other, true in zip(held, free, (1.0, -2.0), strict=True):
        depth = 56 * 0.0254 + one.y_m
        assert other.scale == pytest.approx(depth / (depth - 0.003), abs=2e-4)
        assert abs(other.twist_deg - true) < 4 * other.twist_std_deg
        assert other.excess == 1
        assert one.excess > 10
        assert abs(one.twist_deg - true) < one.twist_u95_deg


def test_the_intervals_hold():
    """A short version of ``python -m benchmarks.twist_coverage``."""
    rows = coverage(120, 3, cases=CASES[:3])
    for row in rows:
        # three standard deviations of a part of 120 below 95 %
        assert row["coverage"] > 0.89, row
        assert row["rms_error_deg"] == pytest.approx(row["rms_stated_deg"], rel=0.2)


def test_a_vibrating_wing():
    """The mean place of a turning target lies nearer to the middle; the twist must not care."""
    rng = np.random.default_rng(5)
    rows = wings.sections()
    wing = wings.targets(rows, radius=np.zeros(12))
    shake = np.sin(2 * np.pi * 9.8 / 60 * np.arange(20) + 0.7)
    after = np.array([wings.pixels(wings.flown(rows, (1.0 + each, -2.0))) for each in shake])
    before = sighted(wing, np.repeat(wings.pixels(rows)[None], 20, axis=0), rng=rng)
    body, tip = measure_twist(wing, before, sighted(wing, after, rng=rng), wings.SETUP).stations
    # a plain mean of the 20 fields would be off by this much
    assert abs(np.mean(shake)) > 0.03
    assert abs(body.twist_deg - 1.0) < body.twist_u95_deg < 0.01
    assert abs(tip.twist_deg + 2.0) < 2 * tip.twist_u95_deg < 0.004
    assert body.excess == 1
    assert body.rms_m < 6e-6


def test_a_slipped_target_is_named():
    rng = np.random.default_rng(6)
    rows = wings.sections()
    wing = wings.targets(rows)
    uv = wings.pixels(wings.flown(rows, (1.0, -2.0)))
    uv[8, 0] += 1.0
    states = sighted(wing, wings.pixels(rows), rng=rng), sighted(wing, uv, rng=rng)
    body, tip = measure_twist(wing, *states, wings.SETUP).stations
    assert (body.outlying, tip.outlying) == ((), ("tip-2",))
    assert len(tip.used) == 5
    assert abs(tip.twist_deg + 2.0) < 4 * tip.twist_std_deg


def test_a_chord_that_bends_shows_in_the_interval():
    rng = np.random.default_rng(7)
    rows = wings.sections()
    wing = wings.targets(rows)
    bent = [
        WingSection(row.centres_m + [[0, 0, 0.05 * x**2] for x in row.centres_m[:, 0]], RADIUS)
        for row in rows
        if (RADIUS := row.radius_m)
    ]
    states = sighted(wing, wings.pixels(rows), rng=rng), sighted(wing, wings.pixels(bent), rng=rng)
    for station in measure_twist(wing, *states, wings.SETUP).stations:
        assert station.excess > 3
        assert station.twist_u95_deg > 2.2 * station.twist_std_deg


def wrong(name):
    """The camera, and the targets' Y [m], with the error that a row of the documents names."""
    camera = wings.CAMERA
    if name.startswith("Y of"):
        return camera, 0.01
    if name.startswith("camera"):
        changes = {"position": tuple(each + 0.01 for each in camera.position)}
    elif name.split(",")[0] in ("omega", "phi", "kappa"):
        rotation = list(camera.rotation)
        rotation[("omega", "phi", "kappa").index(name.split(",")[0])] += np.radians(0.5)
        changes = {"rotation": tuple(rotation)}
    else:
        changes = {
            "principal point": {"principal_point": (380.5, 124.5)},
            "focal length": {"focal_length": 1.01 * camera.focal_length},
            "k1": {"distortion": (-0.09, *camera.distortion[1:])},
            "ratio of the pixel pitches": {"pixel_pitch": (11.7e-6, 1.001 * 27.5e-6)},
        }[name.split(",")[0]]
    return camera.model_copy(update=changes), 0.0


def test_what_a_wrong_camera_costs_is_what_the_documents_say():
    text = (Path(__file__).parents[1] / "docs" / "calibration.md").read_text()
    chapter = text.partition("## Wing twist")[2].partition("\n## ")[0]
    table = re.findall(r"^\| ([^|]+) \| ([0-9.]+) \| ([0-9.]+) \|$", chapter, re.MULTILINE)
    assert len(table) == 9
    rows, twists = wings.sections(), (5.0, 0.0)
    before, after = wings.pixels(rows), wings.pixels(wings.flown(rows, twists))
    for name, *stated in table:
        camera, higher = wrong(name)
        wing = wings.targets(rows, radius=np.zeros(12))
        wing = wings.targets(rows, radius=np.zeros(12), y=wing.y + higher)
        setup = Setup(camera=camera, glint=Glint(nose="left"))
        found = measure_twist(wing, sighted(wing, before), sighted(wing, after), setup).stations
        errors = [abs(one.twist_deg - true) for one, true in zip(found, twists, strict=True)]
        assert [f"{each:.4f}" for each in errors] == stated, name


class TestMissing:
    def states(self, rng, lost):
        rows = wings.sections()
        wing = wings.targets(rows)
        before, after = wings.pixels(rows), wings.pixels(wings.flown(rows, (1.0, -2.0)))
        after[lost] = np.nan
        return wing, sighted(wing, before, rng=rng), sighted(wing, after, name="flow", rng=rng)

    def test_a_target_that_is_not_found_is_named(self):
        wing, *states = self.states(np.random.default_rng(8), [3, 7])
        message = (
            "flow: body-3, tip-1 not found; see that every target is in view and lit, take it "
            "out of the table, or allow missing targets"
        )
        with pytest.raises(CalibrationError, match=f"^{re.escape(message)}$"):
            measure_twist(wing, *states, wings.SETUP)
        result = measure_twist(wing, *states, wings.SETUP, allow_missing=True)
        assert [one.missing for one in result.stations] == [("body-3",), ("tip-1",)]
        assert [len(one.used) for one in result.stations] == [5, 5]
        assert len(result.targets) == 10
        for station, true in zip(result.stations, (1.0, -2.0), strict=True):
            assert abs(station.twist_deg - true) < 4 * station.twist_std_deg

    def test_a_station_needs_two(self):
        wing, *states = self.states(np.random.default_rng(9), [0, 1, 2, 3, 4])
        message = (
            "flow: station body has 1 target found without flow and with it, too few for a "
            "rotation; light the others or leave the station out"
        )
        with pytest.raises(CalibrationError, match=f"^{re.escape(message)}$"):
            measure_twist(wing, *states, wings.SETUP, allow_missing=True)

    def test_a_target_that_some_fields_do_not_show(self):
        rng = np.random.default_rng(10)
        rows = wings.sections()
        wing = wings.targets(rows, radius=np.zeros(12))
        after = np.repeat(wings.pixels(wings.flown(rows, (1.0, -2.0)))[None], 12, axis=0)
        after[::3, 2] = np.nan
        before = sighted(wing, np.repeat(wings.pixels(rows)[None], 12, axis=0), rng=rng)
        result = measure_twist(wing, before, sighted(wing, after, rng=rng), wings.SETUP)
        for station, true in zip(result.stations, (1.0, -2.0), strict=True):
            assert abs(station.twist_deg - true) < 2 * station.twist_u95_deg
        assert result.stations[0].missing == ()

    def test_circles_without_a_match(self):
        """Pictures in which half of the targets cannot be found say what was found."""
        rows = wings.sections()
        (picture,) = wings.photographs(rows[:1], 1, np.random.default_rng(11))
        other = wings.targets(rows, start=wings.pixels(rows) * [1, -2] + [0, 400])
        message = (
            r"^field 0: \d of the 12 targets found among 6 circles \(not .*\); check polarity, "
            r"the limits of the diameter and the light$"
        )
        with pytest.raises(CalibrationError, match=message):
            sight_targets([picture], other, wings.CAMERA, name="no flow")

    def test_no_picture(self):
        wing = wings.targets(wings.sections())
        message = "no flow: no picture; give an image or a recording that has fields"
        with pytest.raises(CalibrationError, match=f"^{re.escape(message)}$"):
            sight_targets([], wing, wings.CAMERA, name="no flow")


class TestRefusals:
    def check(self, message, *, wing=None, setup=wings.SETUP, states=None, error=CalibrationError):
        rows = wings.sections()
        wing = wing or wings.targets(rows)
        states = states or (sighted(wing, wings.pixels(rows)), sighted(wing, wings.pixels(rows)))
        with pytest.raises(error, match=f"^{re.escape(message)}$"):
            measure_twist(wing, *states, setup, reference="root" if "root" in message else None)

    def test_a_camera_without_a_place(self):
        self.check(
            "camera.position is missing in the setup; twist is measured in planes of known Y, so "
            "give focal_length, pixel_pitch, position and rotation in [camera]",
            setup=Setup(camera=Camera()),
            error=SetupError,
        )

    def test_an_unknown_reference(self):
        self.check("'root' is no station of the targets; give one of body, tip")

    def test_a_plane_behind_the_camera(self):
        rows = wings.sections()
        self.check(
            "target body-0: its Y of -2000 mm is not in front of the camera; check the sign and "
            "unit of y, and camera.position",
            wing=wings.targets(rows, y=np.repeat([-2.0, 0.15], 6), radius=np.zeros(12)),
        )

    def test_inches_taken_for_millimetres(self):
        rows = wings.sections()
        wing = wings.targets(rows, radius=np.full(12, wings.RADIUS / 25.4))
        state = sighted(wing, wings.pixels(rows))
        message = (
            r"^drawn: the targets at body appear 2[45]\.\d times as large as their radius and Y "
            r"say; check the units of radius and y, and camera\.position$"
        )
        with pytest.raises(CalibrationError, match=message):
            measure_twist(wing, state, state, wings.SETUP)

    def test_different_tables(self):
        rows = wings.sections()
        wing, other = wings.targets(rows), wings.targets(wings.sections(5))
        self.check(
            "drawn was measured for 10 other targets than these 12; measure both states with one "
            "table of targets",
            wing=wing,
            states=(
                sighted(wing, wings.pixels(rows)),
                sighted(other, wings.pixels(wings.sections(5))),
            ),
        )


class TestTable:
    def write(self, tmp_path, text):
        path = tmp_path / "targets.csv"
        path.write_text(text)
        return path

    def test_units_stand_in_the_header(self, tmp_path):
        text = "id,station,y [in],u,v,radius_mm\na,tip,6,10,20,5\nb,tip,6,30,20.5,5\n"
        wing = read_wing_targets(self.write(tmp_path, text), wings.SETUP)
        assert wing.ids == ("a", "b")
        assert wing.station == ("tip", "tip")
        assert wing.y == pytest.approx([0.1524, 0.1524])
        assert wing.radius == pytest.approx([0.005, 0.005])
        assert wing.start.tolist() == [[10, 20], [30, 20.5]]
        assert np.abs(wing.normal) == pytest.approx(np.array([[0, 1, 0], [0, 1, 0]]))

    def test_a_station_with_a_unit_is_its_y(self, tmp_path):
        text = "id,station [mm],u,v\na,150,10,20\nb,150,30,20\nc,-50,10,90\nd,-50,30,90\n"
        wing = read_wing_targets(self.write(tmp_path, text), wings.SETUP)
        assert wing.stations == ("-50 mm", "150 mm")
        assert wing.at("150 mm").tolist() == [0, 1]
        assert wing.radius.tolist() == [0, 0, 0, 0]

    def test_places_in_space_are_projected(self, tmp_path):
        rows = wings.sections(2)
        points = 1e3 * np.concatenate([row.centres_m for row in rows])
        lines = [f"t{k},{x},{y},{z}" for k, (x, y, z) in enumerate(points)]
        text = "\n".join(["id,x [mm],y [mm],z [mm]", *lines])
        wing = read_wing_targets(self.write(tmp_path, text), wings.SETUP)
        assert wing.start == pytest.approx(wings.pixels(rows), abs=1e-6)

    @pytest.mark.parametrize(
        ("text", "said"),
        [
            (
                "id,y [mm],u,v\na,150,10,20\nb,150,30,20\na,150,50,20\n",
                "target a is there twice, in lines 2 and 4; give each target one line",
            ),
            (
                "id,y,u,v\na,150,10,20\nb,150,30,20\n",
                "column y has no unit; write it into the header, e.g. y [mm], or give --units",
            ),
            (
                "id,y [mm],u,v\na,150,10,20\nb,150,30,20\nc,-50,10,90\n",
                "station -50 mm has one target only (c), which shows no rotation; add a target "
                "there or leave the station out",
            ),
            (
                "id,y [mm],u,v\na,150,10,20\nb,150,10,20\nc,150,30,20\n",
                "targets a and b are at the same place; correct one of them or leave it out",
            ),
            (
                "id,u,v\na,10,20\nb,30,20\n",
                "no column y; give each target's known Y with its unit, e.g. y [mm]",
            ),
            (
                "id,y [mm]\na,150\nb,150\n",
                "no columns u, v [pixels] or x, z [mm]; say where each target is seen without flow",
            ),
            (
                "id,y [mm],u,v\na,150,10,20\nb,150,30,412\n",
                "line 3: v = 412 is not on the sensor of 752 columns and 240 lines per field, "
                "which has half as many lines as a frame; correct it or camera.sensor",
            ),
            (
                "id,y [mm],u [mm],v\na,150,10,20\nb,150,30,20\n",
                "column u says mm; u and v are in pixels",
            ),
            (
                "id,y [mm],u,v,radius [mm]\na,150,10,20,5\nb,150,30,20,-5\n",
                "line 3: a radius must not be negative",
            ),
            (
                "id,y [mm],u,v,nx,ny\na,150,10,20,0,1\nb,150,30,20,0,1\n",
                "a normal has nx, ny and nz; give all three or none",
            ),
            (
                "id,y [mm],u,v,nx,ny,nz\na,150,10,20,0,1,0\nb,150,30,20,0,0,0\n",
                "line 3: the normal has no length; correct it",
            ),
        ],
    )
    def test_refusals(self, tmp_path, text, said):
        path = self.write(tmp_path, text)
        with pytest.raises(CalibrationError, match=f"^{re.escape(f'{path}: {said}')}$"):
            read_wing_targets(path, wings.SETUP)
