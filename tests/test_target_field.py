import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from independent_camera import turned
from known_targets import APPROXIMATE, TRUE, field, in_setup

from calibration.photographs import Photograph
from calibration.resection.resect import resect
from calibration.resection.target_field import (
    ImageTargets,
    match_targets,
    read_image_targets,
    read_target_field,
)
from calibration.resection.target_image import measure_target_field
from glint_aoa.errors import CalibrationError

BOARD = turned("z", 15) @ turned("x", 10)


def grid(columns=6, rows=4):
    x, z = (
        each.ravel()
        for each in np.meshgrid(np.linspace(-0.12, 0.12, columns), np.linspace(-0.06, 0.06, rows))
    )
    return np.stack([x, np.zeros(x.size), z], axis=-1) @ BOARD.T + [0, 0, 0.05]


def staggered():
    points = grid()
    return points + np.array([0, 1, 0]) * np.resize([-0.04, 0.05, 0.0, 0.06], len(points))[:, None]


def refusal(message):
    return pytest.raises(CalibrationError, match=f"^{re.escape(message)}$")


# Tables


@pytest.fixture
def table(tmp_path):
    def write(text, name="targets.csv"):
        (tmp_path / name).write_text(text)
        return tmp_path / name

    return write


@pytest.mark.parametrize(
    ("text", "units"),
    [
        ("id,X [mm],Y [mm],Z [mm]\nA,10,-20,30\nB,1,2,3.5\n", None),
        ("id, X (cm), Y (mm), Z (m)\nA, 1, -20, 0.03\nB, 0.1, 2, 0.0035\n", None),
        ("ID,x_mm,y_mm,z_mm\nA,10,-20,30\nB,1,2,3.5\n", None),
        ("id,X,Y,Z\nA,10,-20,30\nB,1,2,3.5\n", "mm"),
        ("# surveyed\n\nid,X [mm],Y [mm],Z [mm]\n# first\nA,1e1,-20,30\nB,1,2,3.5\n", None),
        ("Z [mm],id,X [mm],Y [mm]\n30,A,10,-20\n3.5,B,1,2\n", "mm"),
        (
            "\ufeffid,X [in],Y [in],Z [in]\n"
            "A,0.393700787401575,-0.78740157480315,1.181102362204724\n"
            "B,0.0393700787401575,0.078740157480315,0.137795275590551\n",
            None,
        ),
    ],
    ids=["brackets", "mixed", "suffix", "option", "comments", "order", "inches"],
)
def test_coordinates_are_read_in_any_unit(table, text, units):
    targets = read_target_field(table(text), units=units)
    assert targets.ids == ("A", "B")
    expected = [[0.01, -0.02, 0.03], [0.001, 0.002, 0.0035]]
    np.testing.assert_allclose(targets.points, expected, rtol=1e-13)
    assert not targets.std.any()


def test_stds_of_targets_have_units_too(table):
    text = "id,X [m],Y [m],Z [m],std_X [mm],std_Z_um\nA,1,2,3,0.5,40\nB,1,2,4,0.1,30\n"
    targets = read_target_field(table(text))
    np.testing.assert_allclose(targets.std, [[5e-4, 0, 4e-5], [1e-4, 0, 3e-5]], rtol=1e-13)


def test_an_odd_field_lies_half_a_line_lower(table):
    text = (
        "id,u,v,std_u,std_v,parity\n"
        "A,1,2,0.1,0.2,even\nB,3,4,0.1,0.3,odd\nC,5,6,1,1,1\nD,7,8,1,1,\n"
    )
    seen = read_image_targets(table(text))
    np.testing.assert_allclose(seen.uv, [[1, 2], [3, 4.5], [5, 6.5], [7, 8]])
    np.testing.assert_allclose(seen.covariance[1], [[0.01, 0], [0, 0.09]])
    assert read_image_targets(table("id,u [px],v (pixels)\nA,1,2\nB,2,2\n")).covariance is None


HEADER = "id,X [mm],Y [mm],Z [mm]\n"


@pytest.mark.parametrize(
    ("text", "units", "problem"),
    [
        ("", None, "the table is empty; give a header and its rows"),
        (HEADER, None, "the table has no rows; give one for each target"),
        (
            "id,X,Y,Z\nA,1,2,3\n",
            None,
            "column X has no unit; write it into the header, e.g. X [mm], or give --units",
        ),
        (
            HEADER + "A,1,2,3\n",
            "m",
            "column X says mm, --units says m; leave --units out or correct the header",
        ),
        (
            "id,X [kg],Y [mm],Z [mm]\nA,1,2,3\n",
            None,
            "column X: 'kg' cannot be turned into 'm'; give a unit of length, e.g. mm",
        ),
        (
            "id,X [mm],Y [mm]\nA,1,2\n",
            None,
            "no column Z; the header is id, X [mm], Y [mm], expected id, X, Y, Z",
        ),
        (
            "id;X [mm];Y [mm];Z [mm]\nA;1;2;3\n",
            None,
            "column 'id;X [mm];Y [mm];Z [mm]' is not known; the columns are id, X, Y, Z, "
            "std_X, std_Y, std_Z, and commas stand between them",
        ),
        (
            "id,X [mm],X [m],Y [mm],Z [mm]\nA,1,1,2,3\n",
            None,
            "column X is there twice; take one out",
        ),
        (
            HEADER + "A,1,2,3\nB,1,2\n",
            None,
            "line 3 has 3 cells, expected 4 as in the header; correct that line",
        ),
        (HEADER + "A,1,2,three\n", None, "line 2: Z is 'three'; give a number"),
        (HEADER + "A,1,2,nan\n", None, "line 2: Z is 'nan'; give a number"),
        (HEADER + ",1,2,3\n", None, "line 2 has no id; give it one"),
        (
            HEADER + "A,1,2,3\nB,2,2,3\nA,1,2,4\n",
            None,
            "target A is there twice, in lines 2 and 4; give each target one line",
        ),
        (
            HEADER + "A,1,2,3\nB,2,2,3\nC,1,2,3\n",
            None,
            "targets A and C have the same coordinates; correct one of them or leave it out",
        ),
        (
            "id,X [mm],Y [mm],Z [mm],std_X [mm]\nA,1,2,3,-1\nB,1,2,4,1\n",
            None,
            "a target's std is below zero; give 0 or more",
        ),
    ],
)
def test_a_table_of_targets_that_cannot_be_used_is_refused(table, text, units, problem):
    path = table(text)
    with refusal(f"{path}: {problem}"):
        read_target_field(path, units=units)


STD = "a std must be greater than zero, and 1000 pixels at most"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (
            "id,u [mm],v\nA,1,2\n",
            "column u says mm; image measurements are in pixels",
        ),
        ("id,u,v,std_u\nA,1,2,1\n", "std_u alone; give std_u and std_v, or neither"),
        ("id,u,v,std_u,std_v\nA,1,2,1,0\n", f"line 2: {STD}"),
        ("id,u,v,std_u,std_v\nA,1,2,1,1e300\n", f"line 2: {STD}"),
        ("id,u,v,parity\nA,1,2,top\n", "line 2: parity is 'top'; give even or odd"),
        (
            "id,u,v\nA,1,2\nB,1,2\n",
            "targets A and B are measured at the same place in the image; correct one of them or "
            "leave it out",
        ),
        (
            "id,u,v\nA,1,2\nA,3,2\n",
            "target A is there twice, in lines 2 and 3; give each target one line",
        ),
    ],
)
def test_a_table_of_measurements_that_cannot_be_used_is_refused(table, text, problem):
    path = table(text)
    with refusal(f"{path}: {problem}"):
        read_image_targets(path)


def test_a_table_that_is_missing_is_named(tmp_path):
    with refusal(f"{tmp_path / 'no.csv'}: no such table; check its name and folder"):
        read_target_field(tmp_path / "no.csv")


@pytest.mark.parametrize(
    ("ids", "message"),
    [
        (
            ("T1", "X"),
            "target X is not in the target field, which has T1, T2, T3, T4, T5 and 19 more; "
            "correct the id or add the target to the field",
        ),
        (
            ("X", "T1", "Y"),
            "targets X, Y are not in the target field, which has T1, T2, T3, T4, T5 and 19 more; "
            "correct the id or add the target to the field",
        ),
    ],
)
def test_a_measured_target_that_is_not_in_the_field_is_named(ids, message):
    with refusal(message):
        field(grid()).of(ids)


def test_targets_given_twice_are_named():
    with refusal("target A is given twice; give each target once"):
        ImageTargets(("A", "B", "A"), np.arange(6.0).reshape(3, 2))


# Matching circles to targets


def seen(points, camera=TRUE):
    return np.stack(camera.pixels(points), axis=-1)


def matched_ids(points, uv, camera=APPROXIMATE):
    matched = match_targets(field(points), uv, None, in_setup(camera))
    return dict(zip(matched.circle.tolist(), matched.measured.ids, strict=True)), matched.missing


@pytest.mark.parametrize("points", [grid(), staggered()], ids=["in a plane", "in space"])
@pytest.mark.parametrize(
    "approximate",
    [
        {},
        {"position": (0.08, -1.5, 0.0)},
        {"rotation": (2.0, 0.0, -2.0)},
        {"rotation": (0.0, 12.0, 0.0)},
        {"rotation": (9.0, 3.0, -10.0)},
        {"position": (0.1, -1.5, -0.05), "rotation": (-6.0, -4.0, 7.0)},
        {"position": (0.0, -1.8, 0.06)},
    ],
    ids=["near", "aside", "turned", "rolled", "well off", "all of it", "far"],
)
def test_circles_are_named_from_an_approximate_pose(points, approximate):
    order = np.random.default_rng(1).permutation(len(points))
    named, missing = matched_ids(points, seen(points)[order], replace(APPROXIMATE, **approximate))
    assert named == {circle: f"T{target + 1}" for circle, target in enumerate(order)}
    assert missing == ()


@pytest.mark.parametrize("points", [grid(), staggered()], ids=["in a plane", "in space"])
def test_missing_targets_and_circles_that_are_none_do_not_disturb(points):
    uv = np.delete(seen(points), [3, 17], axis=0)
    strange = np.array([[40.0, 30.0], [700.0, 100.0], [380.0, 220.0]])
    named, missing = matched_ids(points, np.concatenate([uv, strange]))
    assert missing == ("T4", "T18")
    assert list(named) == list(range(22))
    assert all(name not in {"T4", "T18"} for name in named.values())
    pose = resect(
        field(points),
        match_targets(
            field(points), np.concatenate([uv, strange]), None, in_setup(APPROXIMATE)
        ).measured,
        in_setup(APPROXIMATE),
    )
    np.testing.assert_allclose(pose.position_m, TRUE.position, atol=1e-9)


def test_a_grid_keeps_its_place_when_a_border_column_is_hidden():
    points = grid()
    shown = np.flatnonzero(np.arange(24) % 6 != 5)
    named, missing = matched_ids(points, seen(points)[shown])
    assert list(named.values()) == [f"T{i + 1}" for i in shown]
    assert missing == ("T6", "T12", "T18", "T24")


def test_circles_that_are_something_else_are_refused():
    rng = np.random.default_rng(2)
    uv = rng.uniform([50, 20], [700, 220], (12, 2))
    with refusal(
        "12 circles are found that cannot be told to be the 24 targets of the field; check "
        "polarity, position and rotation in [camera], and the target field"
    ):
        matched_ids(grid(), uv)
    with refusal(
        "1 circle is found that cannot be told to be the 24 targets of the field; check "
        "polarity, position and rotation in [camera], and the target field"
    ):
        matched_ids(grid(), uv[:1])


@pytest.mark.parametrize(
    ("factor", "true", "taken"),
    [(1000, "millimetres", "metres"), (1 / 25.4, "inches", "millimetres")],
)
def test_circles_of_a_field_in_another_unit_say_so(factor, true, taken):
    points = grid()
    with refusal(
        f"the circles found are the targets of the field if {true} were taken for {taken}; "
        "correct the unit of the target field"
    ):
        matched_ids(points * factor, seen(points))


# Pictures


def picture(points, parity, rng, *, camera=TRUE, radius=0.004, hidden=(), strange=()):
    """Draw discs on a board, sixteen sub-pixels a pixel, with noise."""
    fine = 16
    image = np.zeros((camera.sensor[1] * fine, camera.sensor[0] * fine), np.uint8)
    turn = np.linspace(0, 2 * np.pi, 120, endpoint=False)
    rim = radius * (np.outer(np.cos(turn), BOARD[:, 0]) + np.outer(np.sin(turn), BOARD[:, 2]))
    for i, centre in enumerate(points):
        if i in hidden:
            continue
        u, v = camera.pixels(centre + rim)
        fill(image, u, v - 0.5 * parity, fine)
    for u, v in strange:
        fill(image, u + 8 * np.cos(turn), v - 0.5 * parity + 4 * np.sin(turn), fine)
    grey = image.reshape(camera.sensor[1], fine, camera.sensor[0], fine).mean((1, 3))
    noisy = 20 + 0.6 * grey + rng.normal(size=grey.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def fill(image, u, v, fine):
    corners = (np.stack([u, v], axis=-1) + 0.5) * fine - 0.5
    cv2.fillPoly(image, [np.rint(corners * 256).astype(np.int32)], 255, shift=8)


def photograph(grey, parity=0, first_line=0):
    return Photograph("field", "field", grey.astype(np.float32), parity, first_line)


def test_a_pose_from_pictures_of_both_fields():
    points, rng = grid(), np.random.default_rng(3)
    fields = [
        picture(points, parity, rng, hidden=(7,), strange=[(60.0, 30.0)]) for parity in (0, 1)
    ]
    found = measure_target_field(
        [photograph(grey[20:], parity, 20) for parity, grey in enumerate(fields)],
        field(points),
        in_setup(APPROXIMATE),
    )
    assert found.missing == ("T8",)
    np.testing.assert_allclose(found.spurious, [[60, 30], [60, 30]], atol=0.05)
    truth = np.delete(seen(points), 7, axis=0)
    np.testing.assert_allclose(found.measured.uv, truth, atol=0.03)
    pose = resect(field(points), found.measured, in_setup(APPROXIMATE))
    assert all(each.used for each in pose.targets)
    np.testing.assert_allclose(pose.position_m, TRUE.position, atol=5e-4)
    np.testing.assert_allclose(np.degrees(pose.rotation_rad), TRUE.rotation, atol=0.02)


def test_two_fields_are_averaged_by_their_covariance():
    points, rng = grid(), np.random.default_rng(4)
    even = photograph(picture(points, 0, rng))
    camera = in_setup(APPROXIMATE)
    once, twice = (
        measure_target_field(pictures, field(points), camera).measured
        for pictures in ([even], [even, even])
    )
    np.testing.assert_allclose(twice.uv, once.uv, atol=1e-12)
    np.testing.assert_allclose(twice.covariance, once.covariance / 2, rtol=1e-12)


def test_clipped_targets_are_left_out():
    points, rng = grid(), np.random.default_rng(5)
    grey = picture(points, 0, rng).astype(float)
    u, v = seen(points)[10]
    grey[int(v) - 6 : int(v) + 8, int(u) - 12 : int(u) + 14] *= 2.5
    found = measure_target_field(
        [photograph(np.clip(grey, 0, 255).astype(np.uint8))], field(points), in_setup(APPROXIMATE)
    )
    assert found.missing == ("T11",)


def test_a_picture_of_something_else_is_named():
    with refusal(
        "field: no circle is found; see that the targets are lit, in focus and 4 pixels across or "
        "more, and choose their polarity"
    ):
        measure_target_field(
            [photograph(np.full((240, 752), 30, np.uint8))], field(grid()), in_setup(APPROXIMATE)
        )
