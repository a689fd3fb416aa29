import dataclasses

import numpy as np
import pytest
from scipy.integrate import quad

import torture.__main__ as command
from glint_aoa.flags import Flag
from glint_aoa.optical.columns import used_columns
from torture.check import Outcome, add, judge, measure, run
from torture.kinds import KINDS, draw
from torture.profile import Profile
from torture.render import Truth, render, truth_of
from torture.scene import STEEPEST, draw_scene

SEED = 1
PROFILES = [
    Profile.gaussian(1.4),
    Profile.skewed(1.1, 0.8),
    Profile.skirted(0.9),
    Profile.flat(0.8, 1.7),
]


@pytest.mark.parametrize("profile", PROFILES)
def test_profiles_are_integrals_of_their_density(profile):
    low = np.arange(-4.3, 4.0, 1.1)
    for start, share in zip(low, profile.share(low), strict=True):
        area, _ = quad(lambda x: profile.density(np.array([x]))[0], start, start + 1)
        assert share == pytest.approx(area, abs=1e-9)
    everywhere = np.arange(-200.0, 200.0)
    assert profile.share(everywhere).sum() == pytest.approx(1.0, abs=1e-12)
    assert profile.share(everywhere[np.abs(everywhere) > profile.reach + 1]).max() < 1e-8


def quiet(number):
    """A plain scene whose line is a noise-free Gaussian, and the columns measured."""
    scene, rng = draw(SEED, 26 * number)
    scene.profile, scene.texture, scene.background[:] = Profile.gaussian(1.3), 0.0, 20.0
    scene.read_noise, scene.electrons_per_grey = 1e-6, 1e9
    scene.keep_in_view()
    return scene, rng


@pytest.mark.parametrize("number", range(4))
def test_the_centroid_of_a_rendered_line_is_its_truth(number):
    scene, rng = quiet(number)
    fields = render(scene, rng).astype(float) - 20.0
    v = np.arange(scene.lines)[:, None]
    for k in (0, 1):
        centre = (v * fields[k]).sum(axis=0) / fields[k].sum(axis=0)
        slope = np.polyfit(scene.u, centre, 1)[0]  # grey levels are rounded
        assert slope == pytest.approx(scene.slope[k], abs=2e-4)
        assert np.abs(centre - scene.centre(k)).max() < 0.15
        pitch = np.degrees(np.arctan(slope * scene.pitch_um[1] / scene.pitch_um[0]))
        assert scene.angle_deg[k] == pytest.approx(pitch, abs=0.03)


def test_every_kind_can_be_drawn_and_is_as_steep_as_it_says():
    slopes = []
    for number in range(len(KINDS)):
        scene, _ = draw(SEED, number)
        assert scene.kind == list(KINDS)[number]
        assert len(scene.owed) == len(scene.order)
        slopes.append(np.abs(scene.slope * scene.aspect).mean() / STEEPEST)
    assert min(slopes) > 0
    assert max(slopes) > 0.7
    again, _ = draw(SEED, 3)
    np.testing.assert_array_equal(again.slope, draw(SEED, 3)[0].slope)


def truth(n=10, **changes):
    whole = {"angle_deg": np.zeros(n), "measurable": np.ones(n, bool), **changes}
    return Truth(**whole)


def judged(angle, flags=0, std=1e-3, **changes):
    rng = np.random.default_rng(0)
    scene = draw_scene(rng, "plain")
    n = len(angle)
    scene.owed = changes.pop("owed", np.zeros(n, np.int64))
    scene.allowed = changes.pop("allowed", 0)
    return judge(scene, truth(n, **changes), angle, np.full(n, std), np.broadcast_to(flags, n))


def test_only_unflagged_angles_can_be_wrong():
    angle = np.zeros(10)
    angle[[2, 5]] = 0.0051, 0.03
    right = judged(np.full(10, 0.0049))
    assert (right.wrong, right.unflagged, right.measured) == (0, 10, 10)
    wrong = judged(angle)
    assert (wrong.wrong, wrong.worst_deg, wrong.measured) == (2, 0.03, 8)
    warned = np.zeros(10, np.int64)
    warned[[2, 5]] = Flag.TRUNCATED
    flagged = judged(angle, warned)
    assert (flagged.wrong, flagged.unflagged, flagged.measured) == (0, 8, 8)
    noted = judged(angle, int(Flag.UNCALIBRATED | Flag.PIXEL_LOCKING))
    assert noted.wrong == 2


def test_an_angle_where_no_line_is_counts_as_wrong_without_limit():
    there = np.zeros(10)
    there[4] = np.nan
    phantom = judged(np.zeros(10), angle_deg=there, measurable=np.isfinite(there))
    assert (phantom.wrong, phantom.worst_deg) == (1, np.inf)
    missed = judged(there, measurable=np.ones(10, bool))
    assert (missed.wrong, missed.measured, missed.measurable) == (0, 9, 10)


def test_flags_that_are_owed_and_false_alarms_are_counted():
    owed = np.zeros(10, np.int64)
    owed[3:5] = Flag.DROPPED
    flags = np.zeros(10, np.int64)
    flags[3], flags[7] = Flag.DROPPED, Flag.MOVED
    outcome = judged(np.zeros(10), flags, owed=owed)
    assert (outcome.owed, outcome.paid, outcome.alarms) == (2, 1, 1)
    assert judged(np.zeros(10), flags, owed=owed, allowed=int(Flag.MOVED)).alarms == 0


def test_outcomes_add_up():
    one = judged(np.zeros(10))
    both = add(one, judged(np.full(10, 0.03)))
    assert (both.stacks, both.fields, both.wrong, both.worst_deg) == (2, 20, 10, 0.03)


def test_the_bound_is_that_of_the_noise():
    scene, rng = quiet(1)
    scene.read_noise, scene.electrons_per_grey = 2.0, 100.0
    columns = used_columns(scene.columns, scene.glint["column_step"])
    known = truth_of(scene, columns)
    assert known.measurable.all()
    angle, std, _ = measure(scene, render(scene, rng))
    error = angle - known.angle_deg
    assert error.std() == pytest.approx(std.mean(), rel=0.4)
    scene.peak = 3.0
    assert not truth_of(scene, columns).measurable.any()


EASY = ("dark line", "20 lines", "search window", "fog", "parity slip", "repeated")


@pytest.mark.parametrize("kind", EASY)
def test_a_recording_of_the_set_is_measured_right_or_flagged(kind):
    drawn, outcome = run(SEED, list(KINDS).index(kind))
    assert drawn == kind
    assert outcome.wrong == 0
    assert outcome.worst_deg <= command.WORST_DEG
    assert outcome.measured >= command.LEAST_MEASURED * outcome.measurable
    assert outcome.paid == outcome.owed
    assert outcome.alarms == 0


@pytest.mark.parametrize("turn", ["mirrored", "upside down", "brighter"])
def test_a_turned_recording_has_a_turned_angle(turn):
    rng = np.random.default_rng(7)
    scene = draw_scene(rng, "plain", window=(64, 741))  # columns 10 to 730 lie evenly in 741
    scene.interlaced, scene.first_parity, scene.peak = False, 0, 80.0
    scene.parity = np.zeros_like(scene.parity)
    scene.glint["column_step"] = 20
    fields = render(scene, rng)
    turned = {
        "mirrored": fields[:, :, ::-1].copy(),
        "upside down": fields[:, ::-1].copy(),
        "brighter": 2 * fields,
    }[turn]
    angle, std, _ = measure(scene, fields)
    other, other_std, _ = measure(scene, turned)
    sign = 1 if turn == "brighter" else -1
    assert np.abs(other - sign * angle).max() < 0.5 * std.mean()
    assert other_std.mean() == pytest.approx(std.mean(), rel=0.05)


@pytest.mark.parametrize(("wrong", "code"), [(0, 0), (1, 1)])
def test_the_command_fails_where_a_limit_does(monkeypatch, capsys, wrong, code):
    good = Outcome(1, 40, 40, 0, 0.003, 40, 40, 2, 2, 0)

    def outcome(seed, number):
        kind = list(KINDS)[number % len(KINDS)]
        return kind, dataclasses.replace(good, wrong=wrong * (kind == "stripe"))

    monkeypatch.setattr(command, "run", outcome)
    monkeypatch.setattr("sys.argv", ["torture", "--jobs", "1", "--stacks", "26"])
    assert command.main() == code
    printed = capsys.readouterr().out.splitlines()
    assert len(printed) == len(KINDS) + 2
    stripe = next(line for line in printed if line.startswith("stripe"))
    assert stripe.split()[-1] == ("9" if wrong else "0")
    assert printed[-1].split()[:3] == ["all", "26", "1040"]
