"""The stage *build* from end to end on synthetic observations."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from seeing_wind.engine.errors import MaterialError
from seeing_wind.engine.observe.object.motion.control import attach
from seeing_wind.engine.observe.object.motion.keypoints import place, ride
from seeing_wind.engine.observe.object.shape.particles import fill
from seeing_wind.engine.observe.object.shape.relief import relief_of
from seeing_wind.engine.progress import Cancelled, NoProgress, Progress
from seeing_wind.engine.record_arrays import from_arrays, to_arrays
from seeing_wind.engine.records import Body
from seeing_wind.engine.settings import BuildSettings
from seeing_wind.engine.stages import build_body


def test_plate_to_body(plate) -> None:
    messages: list[dict] = []
    body = build_body(plate, BuildSettings(material="cotton", density=300.0, particles=200), Progress(messages.append))
    assert (body.material.name, body.material.density) == ("cotton", 300.0)
    seen = body.keypoints.follow(body.particles.x)
    assert plate.camera.project(seen)[0] == pytest.approx(plate.xy[0], abs=0.05)
    # Nothing moves in this clip, whose pixels are 11 mm.
    assert np.abs(body.lifted - body.lifted[0]).max() < 2e-3
    assert body.lifted[0] == pytest.approx(seen, abs=1e-3)
    fractions = [message["fraction"] for message in messages if message["type"] == "progress"]
    assert fractions == sorted(fractions) and fractions[-1] == 1.0
    again = from_arrays(Body, to_arrays(body))
    assert again.particles.x == pytest.approx(body.particles.x)
    assert again.material == body.material


def test_small_ball_with_a_centroid_track(ball) -> None:
    body = build_body(ball, BuildSettings(), NoProgress())
    centre = np.average(body.particles.x, axis=0, weights=body.particles.volume)
    radius = 5.2 / 90.0
    assert body.keypoints.follow(body.particles.x)[0] == pytest.approx(centre, abs=0.02 * radius)
    assert ball.camera.project(body.keypoints.follow(body.particles.x))[0] == pytest.approx(ball.xy[0], abs=1e-6)
    assert body.lifted.shape == (3, 1, 3)


def test_a_track_that_begins_later_is_carried_back(plate) -> None:
    # The plate slides right by 5 pixels a frame; the last track begins in frame 1.
    shift = np.arange(3)[:, None, None] * np.array([5.0, 0.0])
    xy, visible = plate.xy + shift, plate.visible.copy()
    visible[0, -1] = False
    moving = dataclasses.replace(plate, xy=np.where(visible[..., None], xy, np.nan), visible=visible)
    relief = relief_of(moving)
    points = place(moving, relief, fill(relief, 100))
    assert plate.camera.project(points[-1])[0] == pytest.approx(plate.xy[0, -1], abs=0.3)


def test_a_later_track_far_from_all_others_keeps_its_distance_from_them(plate) -> None:
    """A point low on a stem whose guides are all on the head: they tell how it moved, not where it is."""
    columns, rows = np.meshgrid(np.linspace(34.0, 64.0, 8), [21.0, 23.0])
    xy = np.concatenate([np.column_stack([columns.ravel(), rows.ravel()]), [[50.0, 42.0]]])
    visible = np.ones((3, len(xy)), bool)
    visible[0, -1] = False
    moved = xy + np.arange(3)[:, None, None] * np.array([1.0, 0.0])
    moving = dataclasses.replace(
        plate, xy=moved, visible=visible, sigma=np.full(visible.shape, 0.2), on_centroid=np.zeros(len(xy), bool)
    )
    relief = relief_of(moving)
    points = place(moving, relief, fill(relief, 100))
    assert plate.camera.project(points[-1])[0] == pytest.approx([50.0, 42.0], abs=1.0)


def test_tracks_never_seen_get_a_valid_row(plate) -> None:
    visible = plate.visible.copy()
    visible[:, 2] = False
    blind = dataclasses.replace(plate, visible=visible)
    relief = relief_of(blind)
    particles = fill(relief, 100)
    points = place(blind, relief, particles)
    assert np.isnan(points[2]).all() and np.isfinite(np.delete(points, 2, axis=0)).all()
    attachment = ride(points, blind.on_centroid, particles)
    assert attachment.weight.sum(axis=1) == pytest.approx(np.ones(len(points)))


def test_track_just_outside_the_mask_takes_the_nearest_depth(plate) -> None:
    xy = plate.xy.copy()
    xy[:, 0] = [28.6, 30.0]
    outside = dataclasses.replace(plate, xy=xy)
    relief = relief_of(outside)
    point = place(outside, relief, fill(relief, 100))[0]
    pixel, depth = plate.camera.project(point)
    assert pixel == pytest.approx([28.6, 30.0])
    assert depth == pytest.approx(plate.depth[30, 30], rel=1e-6)


def test_bad_material_stops_before_any_work(plate) -> None:
    with pytest.raises(MaterialError):
        build_body(plate, BuildSettings(material="unobtainium"), NoProgress())
    with pytest.raises(MaterialError):
        build_body(plate, BuildSettings(poisson_ratio=0.7), NoProgress())


def test_cancel(plate) -> None:
    with pytest.raises(Cancelled):
        build_body(plate, BuildSettings(), Progress(cancelled=lambda: True))


def test_rendered_plate(shared) -> None:
    """The lift of true tracks of a rendered plate stays near the truth, and its body near the true one."""
    import json

    from seeing_wind.engine.observe.object.motion.lifting import Sight, lift
    from seeing_wind.engine.records import Camera

    folder = shared / "truth" / "rendered" / "sheet_v0"
    values = json.loads((folder / "camera.json").read_text())
    camera = Camera(*(values[k] for k in ("width", "height", "fx", "fy", "cx", "cy")), np.array(values["camera_to_world"]))
    with np.load(folder / "tracks_truth.npz") as data:
        xy, xyz, visible = (data[k][:, ::4] for k in ("xy", "xyz", "visible"))
    xy = xy + 0.1 * np.random.default_rng(0).normal(size=xy.shape)
    lifted = lift([Sight(camera, xy, visible, np.full(visible.shape, 0.3))], xyz[0])
    local = np.stack([(lifted[t] - xyz[t]) @ camera.pose(t)[:3, :3] for t in range(1, len(xy))])
    assert np.median(np.abs(local[..., 2])) < 1e-3
    assert np.median(np.linalg.norm(local[..., :2], axis=-1)) < 2e-4
    with np.load(shared / "truth" / "sheet.npz") as data:
        attachment = attach(xyz[0], data["x"][0])
        followed = attachment.follow(data["x"])
    assert np.median(np.linalg.norm(followed - xyz, axis=-1)) < 1e-3
