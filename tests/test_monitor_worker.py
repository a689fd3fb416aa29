"""Measuring beside the page: what ends badly is one point's sentence."""

import time

import ill_points
import pytest

from glint_aoa.monitor import worker
from glint_aoa.monitor.watch import FolderWatch, PointStatus
from glint_aoa.setup import Setup


@pytest.fixture
def points(tmp_path, monkeypatch):
    monkeypatch.setattr(worker, "point_row", ill_points.measure)
    monkeypatch.setattr(worker, "point_details", ill_points.gather)
    watch = FolderWatch(tmp_path, settle_s=0.0)
    for name in ("dies.npy", "errs.npy", "good.npy"):
        (tmp_path / name).write_text(name)
    points = worker.PointWorker(watch, Setup(), tmp_path / "results")
    points.start()
    yield points
    points.stop()


def until(condition):
    for _ in range(1200):
        if condition():
            return
        time.sleep(0.1)
    raise AssertionError("it did not come")


def test_a_point_that_ends_the_process_or_errs_does_not_stop_the_others(points):
    def row(name):
        return next((row for row in points.watch.rows() if row.name == name), None)

    until(lambda: row("good.npy") and row("good.npy").status is PointStatus.MEASURED)
    assert row("good.npy").log == {"point": "good", "again": "False"}
    assert row("dies.npy").status is PointStatus.BROKEN
    assert row("dies.npy").sentence == (
        "the program that measures ended on it; look at it with glint-aoa inspect"
    )
    assert row("errs.npy").status is PointStatus.BROKEN
    assert row("errs.npy").sentence == (
        "an error of the program itself (TypeError: no such thing); "
        "run glint-aoa --debug process on it and report what that prints"
    )
    until(lambda: points.details("good.npy") == "details of good")
    assert points.details("dies.npy") is None
