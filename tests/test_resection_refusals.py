"""Targets and measurements that cannot give a pose are refused, and the cause is named."""

import re

import numpy as np
import pytest
from independent_camera import turned
from known_targets import ANGLES, APPROXIMATE, TRUE, board, field, in_setup, in_space, seen

from calibration.resection.resect import resect
from calibration.resection.target_field import ImageTargets
from glint_aoa.errors import CalibrationError

BOARD, SPACE = board(4, 2), in_space()
FLIPPED = np.array([-1.0, 1.0, 1.0])


DISTANCE = np.linalg.norm(BOARD.mean(axis=0) - TRUE.position)


def scaled(factor, true, taken):
    return (
        {"points": BOARD, "said": BOARD * factor},
        f"the camera would stand {factor * DISTANCE:.4g} m from the targets, as if {true} were "
        f"taken for {taken}; correct the unit of the target field",
    )


def edge_on():
    """Targets in a vertical plane through the perspective centre, from there."""
    along, z = (each.ravel() for each in np.meshgrid([1.2, 1.3, 1.4, 1.5], [-0.03, 0.04]))
    aim = turned("z", TRUE.rotation[2])
    return np.stack([np.zeros(along.size), along, z], axis=-1) @ aim.T


EDGE_ON = edge_on()
REFUSED = {
    "mm for m": scaled(1000, "millimetres", "metres"),
    "m for mm": scaled(0.001, "metres", "millimetres"),
    "in for m": scaled(1 / 0.0254, "inches", "metres"),
    "cm for in": scaled(2.54, "centimetres", "inches"),
    "another distance": (
        {"points": BOARD, "said": BOARD * 7},
        f"the camera would stand {7 * DISTANCE:.4g} m from the targets, position in [camera] says "
        f"{np.linalg.norm(7 * BOARD.mean(axis=0) - APPROXIMATE.position):.4g} m; "
        "correct the unit of the target field, or position in [camera]",
    ),
    "three": (
        {"points": BOARD[[0, 3, 7]]},
        "3 measured targets cannot give the pose; measure 4 or more, or hold what is known of "
        "the camera (--hold)",
    ),
    "one, held": (
        {"points": BOARD[:1], "hold": ANGLES},
        "1 measured target cannot give the pose; measure 2 or more, or hold what is known of "
        "the camera (--hold)",
    ),
    "three on a line": (
        {"points": BOARD[:3]},
        "targets T1, T2, T3 lie on one line; add targets off that line",
    ),
    "all on a line": (
        {"points": board(7, 1)},
        "targets T1, T2, T3, T4, T5 and 2 more lie on one line; add targets off that line",
    ),
    "three of four on a line": (
        {"points": BOARD[[0, 1, 2, 7]]},
        "targets T1, T2, T3 lie on one line and only T4 off it, which nothing checks; add a "
        "target off that line",
    ),
    "edge on": (
        {"points": np.array(TRUE.position) + EDGE_ON},
        "the targets appear on one line in the image: the camera lies in their plane; move the "
        "target field or the camera",
    ),
    "behind": (
        {"points": SPACE, "said": np.where(np.arange(12)[:, None] == 5, [0.02, -3, 0.02], SPACE)},
        "target T6 lies behind the camera that the others show; check the sign of its Y",
    ),
    "all behind": (
        {"points": BOARD, "camera": (0.0, 1.4, 0.06), "hold": ("Y", *ANGLES)},
        "all targets lie behind the camera; check the sign of their Y, and position and rotation "
        "in [camera]",
    ),
    "mirrored": (
        {"points": SPACE, "said": SPACE * FLIPPED},
        "the camera would be turned by NUMBER deg from rotation in [camera]; check the targets' "
        "ids and the signs of their X, Y and Z, or give the approximate rotation",
    ),
    "Y the wrong way": (
        {"points": SPACE, "said": SPACE * [1, -1, 1]},
        "no pose explains the 12 measured targets (rms residual NUMBER pixels); check their ids, "
        "the unit and sign of each coordinate, and that u are columns and v lines of a field",
    ),
    "lines of a frame": (
        {"points": BOARD, "lines": 2.0},
        "target T1 is measured at u = NUMBER, v = NUMBER, outside the sensor's 752 columns and 240 "
        "lines of a field; give pixels, v in field lines",
    ),
    "millimetres on the sensor": (
        {"points": BOARD, "lines": 0.0275, "columns": 0.0117},
        "the targets are measured within NUMBER x NUMBER pixels; give u and v in pixels, not in "
        "millimetres, or come nearer with the camera",
    ),
    "vague": (
        {"points": 0.1 * BOARD, "noise": 0.6},
        "the targets do not determine Z (std NUMBER m); add targets that are further apart and "
        "at different distances, or hold what is known of the camera",
    ),
    "unknown held": (
        {"points": BOARD, "hold": ("roll",)},
        "'roll' cannot be held; choose from X, Y, Z, omega, phi, kappa",
    ),
    "all held": (
        {"points": BOARD, "hold": ("X", "Y", "Z", *ANGLES)},
        "all of the pose is held; leave a parameter to be estimated",
    ),
    "tape without std": (
        {"points": BOARD, "distance_m": 1.4},
        "a taped distance needs its uncertainty, and the uncertainty a distance; give both, e.g. "
        "56 in and 5 mm",
    ),
    "tape at zero": (
        {"points": BOARD, "distance_m": 1.4, "distance_std_m": 0.0},
        "the taped distance: its uncertainty is 0 m; give more than 0",
    ),
    "tape and Y": (
        {"points": BOARD, "hold": ("Y",), "distance_m": 1.4, "distance_std_m": 0.005},
        "Y is held and a taped distance is given, which says the same; leave one out",
    ),
    "std of what is free": (
        {"points": BOARD, "hold_std": {"phi": 0.1}},
        "hold_std names phi, which is not held; hold it as well",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_give_a_pose_is_refused_with_its_cause(case):
    given, message = REFUSED[case]
    given = dict(given)
    points = given.pop("points")
    said, noise = given.pop("said", points), given.pop("noise", 0)
    scale = given.pop("columns", 1), given.pop("lines", 1)
    setup = in_setup(APPROXIMATE)
    if "camera" in given:
        setup = setup.model_copy(update={"position": given.pop("camera")})
    rng = np.random.default_rng(9)
    measured = seen(points, rng=rng, std=np.maximum(noise, 1e-6) * np.ones(2))
    uv = measured.uv * scale
    pattern = re.escape(message).replace("NUMBER", r"[\d.]+")
    with pytest.raises(CalibrationError, match=f"^{pattern}$"):
        resect(field(said), ImageTargets(measured.ids, uv, measured.covariance), setup, **given)
