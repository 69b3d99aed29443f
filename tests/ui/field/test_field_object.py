"""The native force field object: what Blender's own particles feel against the field that it was made from."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from mathutils import Euler, Vector

from seeing_wind.engine.errors import UsageError
from seeing_wind.ui.field.arrows import create_arrows, ramp_colours
from seeing_wind.ui.field.field_object import create_field_object, fit_again
from seeing_wind.ui.field.fit.choose import CONTINUE, FADE, HOLD, RESOLUTIONS, beside, fit_field
from seeing_wind.ui.field.fit.kernels import evaluate, paired_directions
from seeing_wind.ui.field.lattice import SampledField, differences, fine_lattice, lattice
from seeing_wind.ui.field.node_groups import set_input
from seeing_wind.ui.field.samples import read_samples, samples_of
from seeing_wind.ui.field.solvers.calibration import calibrate_particles

DEGREES, RELATIVE = 2.0, 0.05


def curved(points: np.ndarray, half_size: float, length: float) -> np.ndarray:
    """(1, P, 3): a steady wind and waves of a length, in half sizes of the box, across it."""
    x, y, z = points.T / half_size * (2.0 * np.pi / length)
    waves = np.stack([np.sin(y + 0.5), np.sin(z + 0.3 * x), np.cos(x - 0.4 * y)], axis=-1)
    return (np.array([1.0, 0.3, 0.5]) + 0.4 * waves)[None]


def sampled(half_size: float, length: float) -> SampledField:
    nodes = fine_lattice(half_size * np.array([[-1.0, -1.0, -0.7], [1.0, 1.0, 0.7]]))
    return SampledField(nodes, curved(nodes, half_size, length), np.ones((1, len(nodes))))


@pytest.mark.parametrize("half_size", [0.03, 0.4, 4.0])
@pytest.mark.parametrize("reach", [FADE, HOLD, CONTINUE])
def test_the_error_that_a_fit_says_is_the_one_it_has(half_size: float, reach: str):
    """At places that neither the fit nor its own measurement saw, against the field itself."""
    fit = fit_field(sampled(half_size, 2.5), 7, reach)
    elsewhere = half_size * np.random.default_rng(3).uniform([-1.0, -1.0, -0.7], [1.0, 1.0, 0.7], (500, 3))
    found = evaluate(fit.places, fit.vectors, elsewhere, fit.power)
    angle, size = differences(found, curved(elsewhere, half_size, 2.5))
    assert fit.angle == pytest.approx(angle, rel=0.35) and fit.size == pytest.approx(size, rel=0.35)
    assert angle < 3.0 and size < 0.06


def test_nodes_are_as_many_as_the_field_needs():
    chosen = [fit_field(sampled(0.4, length), 0, CONTINUE) for length in (8.0, 1.8, 1.2)]
    assert chosen[0].resolution == RESOLUTIONS[0] < chosen[1].resolution < chosen[2].resolution, "finer waves, more nodes"
    assert all(fit.angle < 1.0 and fit.size < 0.02 for fit in chosen[:2])
    # noise has no sources at all: more nodes do not help it, and are not taken
    nodes = fine_lattice(np.array([[0.0] * 3, [1.0] * 3]))
    noise = np.random.default_rng(0).normal(size=(2, len(nodes), 3))
    assert fit_field(SampledField(nodes, noise, np.ones((2, len(nodes)))), 0, CONTINUE).resolution < RESOLUTIONS[-1]


def test_the_wind_beside_the_box_fades_holds_or_continues():
    field, rng = sampled(0.4, 2.5), np.random.default_rng(5)
    inside = np.linalg.norm(field.force, axis=-1).mean()
    around = rng.uniform(-8.0, 8.0, (4000, 3)) * 0.4
    far = beside(field.box, around)
    left = {}
    for reach in (FADE, HOLD, CONTINUE):
        fit = fit_field(field, 9, reach)
        strength = np.linalg.norm(evaluate(fit.places, fit.vectors, around, fit.power)[0], axis=-1) / inside
        left[reach] = [strength[(far > low * 0.8) & (far < high * 0.8)].mean() for low, high in ((0.05, 0.2), (0.6, 1.0), (1.5, 3.0))]
    assert left[FADE][0] > 0.4 and left[FADE][1] < 0.25 and left[FADE][2] < 0.1
    assert 0.8 < left[HOLD][0] < 1.2 and 0.6 < left[HOLD][1] < 1.3
    assert left[CONTINUE][2] > 3.0 * left[FADE][2]


def test_a_lattice_is_thinned_as_far_as_it_says_the_same():
    smooth, sharp = sampled(0.4, 40.0), sampled(0.4, 0.8)
    assert len(smooth.thinned().points) < len(smooth.points) / 50 and sharp.thinned() is sharp
    places = np.random.default_rng(0).uniform(*smooth.box, (300, 3))
    angle, size = differences(smooth.thinned().at(places), smooth.at(places))
    assert angle < 0.5 and size < 0.01
    assert np.allclose(smooth.at(smooth.box[:1] - 1.0), smooth.force[:, :1]), "beside the box its nearest place counts"


def test_two_unit_vectors_encode_a_magnitude():
    vectors = np.random.default_rng(0).normal(size=(3, 5, 3))
    vectors[0, 0] = 0.0
    strength = 0.5 * np.linalg.norm(vectors, axis=-1).max()
    pairs = paired_directions(vectors, strength)
    assert np.allclose(np.linalg.norm(pairs, axis=-1), 1.0)
    assert np.allclose(strength * pairs.reshape(3, 5, 2, 3).sum(axis=2), vectors, atol=1e-12)


def test_lattice_fills_a_flat_box_evenly():
    nodes = lattice(np.array([[0.0, 0.0, 0.0], [1.0, 0.1, 0.5]]), 7)
    assert len(nodes) == 7 * 3 * 4
    assert np.allclose([nodes.min(axis=0), nodes.max(axis=0)], [[0.0, 0.0, 0.0], [1.0, 0.1, 0.5]])


@pytest.mark.parametrize("interval", [0, 3])
def test_native_particles_feel_the_field(scene, checks, interval):
    angle, relative = checks["field_errors"](scene, checks["swirl_field"](scene), interval)
    assert angle < DEGREES and relative < RELATIVE


def test_field_moves_and_turns_with_the_object(scene, checks):
    field = checks["swirl_field"](scene)
    field.location += Vector((0.4, 1.0, -0.3))
    field.rotation_euler = Euler((0.5, -0.7, 1.1))
    angle, relative = checks["field_errors"](scene, field, 2)
    assert angle < DEGREES and relative < RELATIVE


def test_frame_rate_of_the_scene_does_not_matter(scene, checks):
    scene.render.fps = 60
    angle, relative = checks["field_errors"](scene, checks["swirl_field"](scene), 1)
    assert angle < DEGREES and relative < RELATIVE


@pytest.mark.parametrize("options", [{"mass": 0.003}, {"mass": 40.0, "density": 700.0}])
def test_acceleration_depends_on_density_not_on_mass(scene, checks, options):
    angle, relative = checks["field_errors"](scene, checks["swirl_field"](scene), 1, **options)
    assert angle < DEGREES and relative < RELATIVE


def test_small_scene_units_give_the_same_field(scene, checks):
    """One unit = 1 cm: places and accelerations are a hundred times as many units."""
    scene.unit_settings.scale_length = 0.01
    field = checks["swirl_field"](scene)
    points = np.random.default_rng(0).uniform(*checks["BOX"], (50, 3))
    places, found = checks["released_accelerations"](scene, field, 100.0 * points, checks["FRAME_START"])
    angle, relative = checks["worst_errors"](found / 100.0, checks["swirl"](places / 100.0, 0) / checks["DENSITY"])
    assert angle < DEGREES and relative < RELATIVE


def test_first_and_last_interval_stay_outside_the_clip(scene, checks):
    field = checks["swirl_field"](scene)
    points = np.random.default_rng(0).uniform(*checks["BOX"], (50, 3))
    for frame, interval in ((2, 0), (checks["FRAME_START"] + 9, checks["FRAMES"] - 1)):
        places, found = checks["released_accelerations"](scene, field, points, frame)
        angle, relative = checks["worst_errors"](found, checks["swirl"](places, interval) / checks["DENSITY"])
        assert angle < DEGREES and relative < RELATIVE


def test_field_survives_save_and_load_without_handlers(scene, checks, tmp_path):
    checks["swirl_field"](scene)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "field.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "field.blend"))
    scene = bpy.context.scene
    field = scene.objects["Wind"]
    assert field.data.vertices and field["seeing_wind_take"] == "/clips/a.take" and field["seeing_wind_units"] == "N/m3"
    assert (field["seeing_wind_fps"], field["seeing_wind_density"], field["seeing_wind_frame_start"]) == (24.0, 120.0, 5)
    assert field.animation_data is None and not bpy.app.handlers.frame_change_pre and not bpy.app.handlers.frame_change_post
    angle, relative = checks["field_errors"](scene, field, 4)
    assert angle < DEGREES and relative < RELATIVE


def test_field_is_refused_when_arrays_do_not_agree(scene):
    nodes = lattice(np.array([[0.0] * 3, [1.0] * 3]), 3)
    vectors = np.zeros((4, len(nodes), 3))
    with pytest.raises(UsageError, match="shape"):
        SampledField(nodes, np.zeros((4, 5, 3)), np.ones((4, 5)))
    with pytest.raises(UsageError, match="lattice"):
        SampledField(nodes[:5], vectors[:, :5], np.ones((4, 5)))
    broken = vectors.copy()
    broken[1, 2, 0] = np.nan
    with pytest.raises(UsageError, match="finite"):
        SampledField(nodes, broken, np.ones((4, len(nodes))))
    with pytest.raises(UsageError, match="above zero"):
        create_field_object(scene, "Wind", SampledField(nodes, vectors, np.ones((4, len(nodes)))), fps=0.0, density=100.0)
    assert not bpy.data.objects and not bpy.data.meshes


def test_fitting_again_keeps_place_strength_and_values(scene, checks):
    """With other nodes and another reach; native particles and the arrows' drivers feel the user's strength as before."""
    field = checks["swirl_field"](scene, 5)
    said = tuple(field["seeing_wind_error"])
    field.field.strength *= 1.5
    field.location.x += 0.25
    before = read_samples(samples_of(field)).force
    fit_again(field, 9, HOLD)
    assert (field["seeing_wind_nodes"], field["seeing_wind_reach"]) == (9, "HOLD")
    fit_again(field, 9, CONTINUE)
    assert field["seeing_wind_reach"] == "CONTINUE" and tuple(field["seeing_wind_error"]) < said
    assert np.array_equal(read_samples(samples_of(field)).force, before)
    assert [modifier.type for modifier in field.modifiers] == ["NODES"] and len(bpy.data.meshes) == 2
    # the home of the probes is where the field stands now
    points = np.array([[0.45, 0.0, 0.5], [0.3, -0.3, 0.8]])
    places, found = checks["released_accelerations"](scene, field, points, checks["FRAME_START"] + 2)
    truth = 1.5 * checks["swirl"](places - [0.25, 0.0, 0.0], 2) / checks["DENSITY"]
    angle, size = checks["worst_errors"](found, truth)
    assert angle < 0.5 and size < 0.01


def test_calibration_refuses_what_blender_cannot_weigh(scene, checks):
    field, settings = checks["swirl_field"](scene), bpy.data.particles.new("Dust")
    with pytest.raises(UsageError, match="200"):
        calibrate_particles(settings, field, mass=1000.0, density=1.0)
    with pytest.raises(UsageError, match="no recovered force field"):
        calibrate_particles(settings, bpy.data.objects.new("Empty", None))


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
    arrows = create_arrows(scene, "Arrows", points, vectors, frame_start=3, length=0.5, peak=10.0)
    for frame, row in ((1, 0), (3, 0), (5, 2), (6, 3), (30, 3)):
        scene.frame_set(frame)
        vertices, strength = _drawn(arrows)
        along = np.einsum("mvc,mc->mv", vertices - points[:, None], vectors[row] / np.linalg.norm(vectors[row], axis=-1, keepdims=True))
        assert np.allclose(strength, np.linalg.norm(vectors[row], axis=-1) / 10.0, atol=1e-6)
        assert np.allclose(along.max(axis=1), 0.5 * strength, atol=1e-5) and np.allclose(along.min(axis=1), 0.0, atol=1e-5)


def test_unsure_arrows_are_hidden_and_moving_points_followed(scene):
    points = np.arange(24.0).reshape(4, 2, 3)
    vectors = np.tile([[0.0, 0.0, 5.0]], (4, 2, 1))
    confidence = np.array([[1.0, 0.0]] * 4)
    arrows = create_arrows(scene, "Arrows", points, vectors, confidence, frame_start=1, length=1.0)
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
    arrows = create_arrows(scene, "Arrows", points, np.tile([[0.0, 0.0, 5.0]], (3, 216, 1)), frame_start=1, length=0.1)
    modifier = arrows.modifiers[0]
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
    field = checks["swirl_field"](scene, 4)
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    arrows = create_arrows(scene, "Arrows", points, np.tile([[0.0, 0.0, 5.0]], (2, 2, 1)), length=0.5, peak=5.0, parent=field)
    before = _drawn(arrows)[0]
    field.field.strength *= 2.0
    field.location.x += 1.0
    scene.frame_set(1)
    after = _drawn(arrows)[0]
    assert np.ptp(after[0, :, 2]) == pytest.approx(2.0 * np.ptp(before[0, :, 2]), rel=1e-3)
    assert arrows.matrix_world.translation.x == pytest.approx(1.0, abs=1e-5)
    assert np.allclose(ramp_colours(np.array([1.0])), [[1.0, 0.0, 0.0]])


# -- what Recover makes by itself: as many nodes as the field needs, and a fade beside the box ---------------------------------------


def waves(points: np.ndarray, frame: int) -> np.ndarray:
    """(P, 3) [N/m³], waves as long as the box is high."""
    return 60.0 * (1.0 + 0.2 * frame) * curved(points - [0.3, 0.0, 0.5], 0.4, 2.0)[0]


@pytest.fixture
def wavy(scene) -> bpy.types.Object:
    nodes = fine_lattice(np.array([[-0.1, -0.4, 0.1], [0.7, 0.4, 0.9]]))
    values = np.stack([waves(nodes, frame) for frame in range(3)])
    return create_field_object(scene, "Wind", SampledField(nodes, values, np.ones(values.shape[:2])), fps=24.0, density=120.0)


def test_particles_feel_a_curved_field_within_a_degree_and_two_percent(scene, checks, wavy):
    """In the mean over the box, as the panel says it, measured by Blender's own particles."""
    points = np.random.default_rng(2).uniform([-0.1, -0.4, 0.1], [0.7, 0.4, 0.9], (300, 3))
    places, found = checks["released_accelerations"](scene, wavy, points, 2)
    angle, size = differences(found[None], waves(places, 1)[None] / 120.0)
    assert angle < 1.0 and size < 0.02
    assert wavy["seeing_wind_error"][0] == pytest.approx(angle, rel=0.5) and wavy["seeing_wind_error"][1] == pytest.approx(size, rel=0.5)


def test_particles_far_from_the_filmed_body_are_left_alone(scene, checks, wavy):
    inside = np.array([[0.3, 0.0, 0.5], [0.5, 0.2, 0.3]])
    away = np.array([[0.3, 2.5, 0.5], [-3.0, 0.0, 0.5], [0.3, 0.0, 4.0]])
    _, found = checks["released_accelerations"](scene, wavy, np.concatenate([inside, away]), 1)
    strength = np.linalg.norm(found, axis=1)
    assert strength[2:].max() < 0.12 * strength[:2].mean()
