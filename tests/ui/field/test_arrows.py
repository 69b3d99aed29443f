"""The arrows of a field show what it is, frame by frame."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from seeing_wind.engine.errors import UsageError
from seeing_wind.ui.field.arrows import CONFIDENCE_SHOWN, create_arrows, ramp_colours
from seeing_wind.ui.field.display import SURE, said_of_unseen
from seeing_wind.ui.field.node_groups import set_input
from seeing_wind.ui.recover.shown import said_of_view
from tests.ui.jobs import recover


def _drawn(arrows: bpy.types.Object) -> tuple[np.ndarray, np.ndarray]:
    """Of each arrow shown: its 29 vertices (M, 29, 3), a shaft of 16 and a cone of 13, and its strength (M,).

    The first vertex is a bare one, which names the colours for Solid view.
    """
    mesh = arrows.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    assert mesh.color_attributes.active_color_name == "wind_colour"
    strength = np.array([value.value for value in mesh.attributes["strength"].data])[1:]
    return np.array([vertex.co[:] for vertex in mesh.vertices])[1:].reshape(-1, 29, 3), strength.reshape(-1, 29)[:, 0]


def test_arrows_show_direction_and_strength_of_each_frame(scene):
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    rng = np.random.default_rng(0)
    vectors = rng.normal(size=(4, 3, 3))
    vectors *= rng.uniform(3.0, 10.0, (4, 3, 1)) / np.linalg.norm(vectors, axis=-1, keepdims=True)
    arrows = create_arrows(scene, "Arrows", points, vectors, frame_start=3)
    set_input(arrows.modifiers[0], "Length", 0.5)
    sizes = np.linalg.norm(vectors, axis=-1, keepdims=True)
    for frame, row in ((1, 0), (3, 0), (5, 2), (6, 3), (30, 3)):
        scene.frame_set(frame)
        vertices, strength = _drawn(arrows)
        along = np.einsum("mvc,mc->mv", vertices - points[:, None], vectors[row] / sizes[row])
        assert np.allclose(strength, np.minimum(sizes[row, :, 0] / arrows["seeing_wind_peak"], 1.0), atol=1e-6)
        assert np.allclose(along.max(axis=1), 0.5 * strength, atol=1e-5) and np.allclose(along.min(axis=1), 0.0, atol=1e-5)


def test_unsure_arrows_are_hidden_and_moving_points_followed(scene):
    points = np.arange(24.0).reshape(4, 2, 3)
    vectors = np.tile([[0.0, 0.0, 5.0]], (4, 2, 1))
    confidence = np.array([[1.0, 0.0]] * 4)
    arrows = create_arrows(scene, "Arrows", points, vectors, confidence, frame_start=1)
    set_input(arrows.modifiers[0], "Length", 1.0)
    scene.frame_set(3)
    vertices, _ = _drawn(arrows)
    assert len(vertices) == 1
    assert np.allclose(vertices[0].min(axis=0)[2], points[2, 0, 2]) and np.allclose(vertices[0].max(axis=0)[2], points[2, 0, 2] + 1.0)
    assert "Seeing Wind Arrows" in arrows.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.materials


def test_arrows_are_refused_when_arrays_do_not_agree(scene):
    with pytest.raises(UsageError, match="do not fit"):
        create_arrows(scene, "Arrows", np.zeros((3, 3)), np.zeros((4, 2, 3)))
    with pytest.raises(UsageError, match="confidence"):
        create_arrows(scene, "Arrows", np.zeros((2, 3)), np.zeros((4, 2, 3)), np.zeros((4, 3)))


def test_density_and_slice_choose_arrows(scene):
    axis = np.linspace(0.0, 1.0, 6)
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    arrows = create_arrows(scene, "Arrows", points, np.tile([[0.0, 0.0, 5.0]], (3, 216, 1)), frame_start=1)
    modifier = arrows.modifiers[0]
    set_input(modifier, "Length", 0.1)
    scene.frame_set(1)
    assert len(_drawn(arrows)[0]) == 216
    set_input(modifier, "Slice Axis", 1)
    set_input(modifier, "Slice Position", 0.4)
    set_input(modifier, "Slice Thickness", 0.1)
    vertices, _ = _drawn(arrows)
    assert len(vertices) == 36 and np.allclose(vertices[:, :, 0].mean(axis=1), 0.4, atol=0.02)
    set_input(modifier, "Slice Axis", 0)
    set_input(modifier, "Density", 0.3)
    places = []
    for frame in (1, 3):
        scene.frame_set(frame)
        places.append(_drawn(arrows)[0].mean(axis=1))
    # about three in ten, and the same ones in every frame
    assert 40 < len(places[0]) < 95 and np.allclose(places[0], places[1])


def test_arrows_and_their_colours_follow_strength_and_the_field_object(scene, checks):
    field = checks["swirl_field"](scene)
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    arrows = create_arrows(scene, "Arrows", points, np.tile([[0.0, 0.0, 5.0]], (2, 2, 1)), parent=field)
    before, stood = _drawn(arrows)[0], arrows.matrix_world.translation.x
    field.field.strength *= 2.0
    field.location.x += 1.0
    scene.frame_set(1)
    after = _drawn(arrows)[0]
    assert np.ptp(after[0, :, 2]) == pytest.approx(2.0 * np.ptp(before[0, :, 2]), rel=1e-3)
    assert arrows.matrix_world.translation.x == pytest.approx(stood + 1.0, abs=1e-5)
    assert np.allclose(ramp_colours(np.array([1.0])), [[1.0, 0.0, 0.0]])


def test_it_is_said_when_the_clip_tells_too_little_for_any_arrow(scene):
    points, vectors = np.random.default_rng(0).uniform(size=(20, 3)), np.ones((2, 20, 3))
    confidence = np.full((2, 20), 0.01)
    confidence[1, 3] = 0.04
    arrows = create_arrows(scene, "Arrows", points, vectors, confidence)
    assert len(_drawn(arrows)[0]) == 0
    assert "in none of 2 frames: the confidence is 0.04 at most" in said_of_unseen(arrows, CONFIDENCE_SHOWN)
    set_input(arrows.modifiers[0], "Confidence Shown", 0.03)
    scene.frame_set(2)
    assert len(_drawn(arrows)[0]) == 1 and said_of_unseen(arrows, 0.03) == "", "in half of the frames"
    few = create_arrows(scene, "Few", points, np.ones((3, 20, 3)), np.concatenate([confidence, np.zeros((1, 20))]))
    assert "in 1 of 3 frames" in said_of_unseen(few, 0.03)


def test_it_is_said_after_recover_too(scene, stand_in, workplace):
    recover(workplace)
    assert not said_of_view(scene)
    scene.seeing_wind.arrows_object[SURE] = [0.01] * 12
    assert "Arrows are drawn in none of 12 frames" in said_of_view(scene)[0]


def _values(arrows: bpy.types.Object, name: str) -> np.ndarray:
    """Of an attribute of all arrows in all frames; of vectors their lengths."""
    data = arrows.data.attributes[name].data
    return np.array([np.linalg.norm(each.vector) if hasattr(each, "vector") else each.value for each in data])


def test_arrows_are_as_strong_as_the_reach_leaves_the_field(scene, stand_in, workplace):
    recover(workplace)
    field, arrows, settings = scene.seeing_wind.field_object, scene.seeing_wind.arrows_object, scene.seeing_wind
    assert field["seeing_wind_reach"] == "FADE", "by default"
    scene.frame_set(settings.frame_start)
    size, away, peak = _values(arrows, "force"), _values(arrows, "distance"), arrows["seeing_wind_peak"]
    width = 0.75 * np.ptp([vertex.co[:] for vertex in field.data.vertices], axis=0).max()
    s = np.clip(away / width, 0.0, 1.0)
    fades = np.minimum(size * (1.0 - s**2 * (3.0 - 2.0 * s)) / peak, 1.0)
    whole = np.minimum(size / peak, 1.0)
    assert (fades < 0.7 * whole).any()
    for reach, expected in (("FADE", fades), ("HOLD", whole), ("CONTINUE", whole), ("FADE", fades)):
        settings.field_reach = reach
        bpy.ops.seeing_wind.apply_to_field(field=field.name)
        np.testing.assert_allclose(_values(arrows, "strength"), expected, atol=1e-4)
        first = expected.reshape(len(arrows[SURE]), -1)[0]
        np.testing.assert_allclose(_drawn(arrows)[1], first[first > 0.01], atol=1e-4)
        colours = np.array([each.color[:3] for each in arrows.data.attributes["wind_colour"].data])
        np.testing.assert_allclose(colours, ramp_colours(expected), atol=1e-3)
