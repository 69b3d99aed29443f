"""The paper's own scheme: its loss falls, a known wind is recovered, and the derivatives of its objectives are right."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from seeing_wind.engine.conventions import distrusted, front_view
from seeing_wind.engine.errors import ObjectError, UsageError
from seeing_wind.engine.field import distill
from seeing_wind.engine.look.splatting import render_gaussians
from seeing_wind.engine.materials import Material
from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.mpm.rollout import advance
from seeing_wind.engine.mpm.state import State
from seeing_wind.engine.observe.object.motion.control import attach
from seeing_wind.engine.progress import Cancelled, NoProgress, Progress
from seeing_wind.engine.records import Attachment, Camera, Gaussians, Particles, PointTargets, TrackTargets
from seeing_wind.engine.recovery.paper.field import PlaneField
from seeing_wind.engine.recovery.paper.flow_depth_loss import FlowDepthLoss, SceneFlow
from seeing_wind.engine.recovery.paper.image_loss import Filmed, ImageLoss
from seeing_wind.engine.recovery.paper.schedule import recover_by_descent
from seeing_wind.engine.recovery.paper.start import first_look
from seeing_wind.engine.settings import RecoverSettings
from seeing_wind.engine.stages import check_solve

RUBBER = Material("rubber", "neo_hookean", density=400.0, youngs_modulus=5e3, poisson_ratio=0.3)
DOUGH = Material("dough", "von_mises", density=400.0, youngs_modulus=5e3, poisson_ratio=0.3, yield_stress=60.0)
FPS = 30.0
CAMERA = Camera(96, 80, 160.0, 160.0, 47.5, 39.5, front_view(0.6))


def block(shape=(3, 3, 3), spacing=0.03):
    axes = [(np.arange(n) - (n - 1) / 2) * spacing for n in shape]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    return Particles(x, np.full(len(x), spacing**3), np.zeros(len(x), bool), spacing)


def every(count):
    return Attachment(np.arange(count, dtype=np.int32)[:, None], np.ones((count, 1)))


def blown(body, wind, frames, material=RUBBER, velocity=None):
    """Trajectory (T+1, N, 3) under a uniform wind (3,) [m/s²]."""
    model, _ = model_for(body, material, FPS, gravity=(0.0, 0.0, 0.0))
    state, xs = State.at_rest(body.x, velocity), [body.x]
    for t in range(frames):
        state = advance(model, state, np.tile(wind, (len(body.x), 1)), frame=t)
        xs.append(state.x)
    return np.stack(xs)


def points(x):
    return PointTargets(x, np.ones(x.shape[:2], bool), every(x.shape[1]))


def settings(**more):
    return RecoverSettings(gravity=(0.0, 0.0, 0.0), schedule="paper", **more)


WIND = np.array([2.0, 0.5, -1.0])


@pytest.mark.parametrize("representation", ["causal_triplane", "kplanes", "point"])
def test_a_uniform_wind_comes_back_frame_by_frame(representation):
    body, told = block(), []
    chosen = settings(representation=representation, frame_iterations=30)
    found = recover_by_descent(body, RUBBER, points(blown(body, WIND, 2)), FPS, chosen, Progress(told.append))
    want = 400.0 * WIND
    assert np.abs(found.force_density - want).max() < 0.15 * np.linalg.norm(want)
    assert found.force_density.shape == (2, 27, 3) and found.F.shape == (3, 27, 3, 3) and found.residual_unit == "m"
    misfits = [one["misfit"] for one in told if "misfit" in one]
    assert misfits[0] > 0.5 and misfits[-1] < 0.02  # the misfit is about 1 without any force
    assert distill(found, body, FPS, "point").sample(body.x, 0)[1].mean() > 0.5


@pytest.mark.parametrize("pixels", [True, False])
def test_a_field_that_misses_much_of_the_motion_is_told_to_be_of_no_use(pixels):
    """A post in a wind, held at its foot; and the same post with all of it but the top marked as held."""
    body = block()
    foot = body.x[:, 2] < -0.02
    x = blown(replace(body, pinned=foot), np.array([8.0, 0.0, 0.0]), 3)

    def told(held: np.ndarray) -> list[str]:
        if pixels:
            xy = np.stack([CAMERA.project(one, 0)[0] for one in x])
            seen = [TrackTargets(xy, np.ones(xy.shape[:2], bool), np.full(xy.shape[:2], 0.1), CAMERA, every(27))]
        chosen = settings(frame_iterations=30)
        found = recover_by_descent(replace(body, pinned=held), RUBBER, seen if pixels else points(x), FPS, chosen, NoProgress())
        return distrusted(found.notes)

    assert told(foot) == []
    (note,) = told(body.x[:, 2] < 0.02)
    assert "from where it was seen" in note


def test_a_thrown_body_is_not_taken_for_one_that_is_pushed():
    body = block()
    thrown = first_look(body, points(blown(body, WIND, 7, velocity=[0.4, 0.0, 0.2])), FPS, np.zeros(3))
    np.testing.assert_allclose(thrown.velocity, np.tile([0.4, 0.0, 0.2], (27, 1)), atol=0.02)
    at_rest = first_look(body, points(blown(body, WIND, 7)), FPS, np.zeros(3))
    assert np.abs(at_rest.velocity).max() < 0.02 and at_rest.acceleration == pytest.approx(np.linalg.norm(WIND), rel=0.1)


def test_tracks_of_two_cameras_give_the_wind_too():
    body, turned = block(), np.eye(4)
    turned[:3, :3], turned[:3, 3] = [[0, 0, -1], [1, 0, 0], [0, -1, 0]], [0.6, 0.0, 0.0]  # from +X, looking along -X
    x = blown(body, WIND, 2)
    views = []
    for pose in (CAMERA.camera_to_world, turned):
        camera = Camera(96, 80, 160.0, 160.0, 47.5, 39.5, pose)
        xy = np.stack([camera.project(x[t], t)[0] for t in range(3)])
        views.append(TrackTargets(xy, np.ones(xy.shape[:2], bool), np.full(xy.shape[:2], 0.1), camera, every(27)))
    found = recover_by_descent(body, RUBBER, views, FPS, settings(frame_iterations=30), NoProgress())
    assert np.linalg.norm(found.force_density.mean(axis=(0, 1)) - 400.0 * WIND) < 0.1 * 400.0 * np.linalg.norm(WIND)
    assert found.residual_unit == "px" and found.residual.max() < 0.05


def test_a_plastic_body_descends_too():
    body = block()
    x = blown(body, WIND, 2, DOUGH)
    found = recover_by_descent(body, DOUGH, points(x), FPS, settings(frame_iterations=25, representation="point"), NoProgress())
    assert np.linalg.norm(found.force_density.mean(axis=(0, 1)) - 400.0 * WIND) < 0.1 * 400.0 * np.linalg.norm(WIND)


def test_only_the_current_frame_of_the_time_encoder_learns():
    field = PlaneField("causal_triplane", 4, np.array([[-1.0, -1, -1], [1, 1, 1]]), 0.1, 2.0)
    torch.nn.init.normal_(field.module.decoder[-1].weight)
    field.begin(2, np.zeros((5, 3)))
    (field.acceleration()[0].square().sum() + field.roughness()).backward()
    field.confine()
    rows = field.module.time.step.grad.abs().sum(dim=1)
    assert field.module.time.first.grad is None and rows[1] > 0 and rows[0] == rows[2] == 0


def test_the_field_s_gradient_is_its_derivative():
    torch.manual_seed(0)
    field = PlaneField("causal_triplane", 2, np.array([[-1.0, -1, -1], [1, 1, 1]]), 0.05, 2.0)
    torch.nn.init.normal_(field.module.decoder[-1].weight)
    x = np.random.default_rng(0).uniform(-0.8, 0.8, (4, 3))
    field.begin(0, x)
    here, slope = (value.detach().numpy() for value in field.acceleration())
    field.begin(0, x + [0.0, 0.004, 0.0])
    np.testing.assert_allclose((field.acceleration()[0].detach().numpy() - here) / 0.004, slope[:, :, 1], atol=0.15 * np.abs(slope).max())


def test_cancelling_stops_the_descent():
    body, asked = block(), []
    progress = Progress(cancelled=lambda: asked.append(0) or len(asked) > 20)
    with pytest.raises(Cancelled):
        recover_by_descent(body, RUBBER, points(blown(body, WIND, 2)), FPS, settings(), progress)


# -- the objectives of Table 3 ----------------------------------------------------------------------------------------------------


def dots(body, count=40):
    """Gaussians of random colours on the front of a block."""
    random = np.random.default_rng(2)
    x = np.column_stack([random.uniform(-0.05, 0.05, count), np.full(count, body.x[:, 1].min()), random.uniform(-0.035, 0.035, count)])
    turn = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
    return Gaussians(x, np.full((count, 3), 0.007), turn, np.full(count, 0.8), random.normal(size=(count, 1, 3)), attach(x, body.x))


def filmed(body, shift):
    """Two frames of the Gaussians, the second with the body moved by `shift` (3,) [m]."""
    gaussians, behind = dots(body), np.full((80, 96, 3), 90, np.uint8)
    frames, masks = [], []
    for x in (body.x, body.x + shift):
        colour, alpha = render_gaussians(gaussians, CAMERA, 0, x)
        frames.append(np.round(255 * colour + (1 - alpha[..., None]) * behind).clip(0, 255).astype(np.uint8))
        masks.append(alpha > 0.3)
    return Filmed(np.stack(frames), np.stack(masks), behind, CAMERA, gaussians)


def test_the_image_loss_is_least_where_the_body_went_and_its_derivatives_are_right():
    body, shift = block(), np.array([0.006, 0.0, -0.004])
    loss = ImageLoss(filmed(body, shift), torch.float64)
    loss.begin(body.x, 1)
    F = torch.eye(3, dtype=torch.float64).repeat(27, 1, 1)
    there = loss(torch.from_numpy(body.x + shift), F)
    x, F = torch.from_numpy(body.x).requires_grad_(), F.requires_grad_()
    here = loss(x, F)
    assert here > 0.5 and there < 0.15 * here
    here.backward()
    random = np.random.default_rng(1)
    for _ in range(3):
        dx, dF = 1e-6 * random.normal(size=(27, 3)), 1e-5 * random.normal(size=(27, 3, 3))
        with torch.no_grad():
            ahead, behind = (loss(x + s * torch.from_numpy(dx), F + s * torch.from_numpy(dF)) for s in (1.0, -1.0))
        promised = (x.grad.numpy() * dx).sum() + (F.grad.numpy() * dF).sum()
        assert float(ahead - behind) / 2.0 == pytest.approx(promised, rel=1e-3)


def test_the_image_loss_says_nothing_of_a_frame_in_which_the_object_is_hidden():
    body = block()
    seen = filmed(body, np.zeros(3))
    hidden = replace(seen, frames=seen.frames[[0, 1, 1, 1]], masks=seen.masks[[0, 1, 1, 1]] & np.array([1, 1, 0, 0], bool)[:, None, None])
    x = torch.from_numpy(body.x + [0.006, 0.0, -0.004]).requires_grad_()
    loss, F = ImageLoss(hidden), torch.eye(3, dtype=torch.float64).repeat(27, 1, 1)
    loss.begin(body.x, 2)
    assert loss(x, F) > 0.1, "the frame before shows it"
    loss.begin(body.x, 3)
    value = loss(x, F)
    value.backward()
    assert value == 0.0 and not x.grad.any()


def scene_flow(body, shift):
    """Flow and depth of a body that moves by `shift` (3,) [m], as functions."""
    surface = dots(body).attachment
    start = surface.follow(body.x)
    before, after = CAMERA.project(start)[0], CAMERA.project(start + shift)[0]

    def flow(xy):
        nearest = np.linalg.norm(xy[:, None] - before[None], axis=2).argmin(axis=1)
        return (after - before)[nearest]

    return SceneFlow([flow], np.ones((2, 80, 96), bool), CAMERA, surface, np.stack([start, start + shift]))


def test_flow_and_depth_are_met_where_the_body_went_also_along_the_view():
    body, shift = block(), np.array([0.01, 0.02, -0.005])
    loss = FlowDepthLoss(scene_flow(body, shift), 0.01)
    loss.begin(body.x, 1)
    F = torch.eye(3, dtype=torch.float64).repeat(27, 1, 1)
    assert float(loss(torch.from_numpy(body.x + shift), F)) < 0.02
    x = torch.from_numpy(body.x).requires_grad_()
    here = loss(x, F)
    here.backward()
    assert float(here.detach()) > 1.0 and float(x.grad.sum(dim=0) @ torch.from_numpy(shift)) < 0.0


def test_no_depth_is_said():
    scene = scene_flow(block(), np.zeros(3))
    with pytest.raises(ObjectError, match="depth"):
        FlowDepthLoss(SceneFlow(scene.flow, scene.masks, scene.camera, scene.surface, np.full_like(scene.lifted, np.nan)), 0.01)


@pytest.mark.parametrize(
    ("options", "clip", "views", "reason"),
    [
        ({"objective": "image"}, True, 0, "no Gauss-Newton form"),
        ({"objective": "flow_depth", "schedule": "paper"}, False, 0, "trajectories have none"),
        ({"objective": "image", "schedule": "paper"}, True, 1, "cannot use --view"),
    ],
)
def test_what_does_not_go_together_is_refused_with_the_reason(options, clip, views, reason):
    with pytest.raises(UsageError, match=reason) as caught:
        check_solve(RecoverSettings(**options), clip, views)
    assert caught.value.hint


def test_what_goes_together_is_let_through():
    check_solve(RecoverSettings(objective="image", schedule="paper"), clip=True)
    check_solve(RecoverSettings(schedule="paper"), clip=False)
    check_solve(RecoverSettings(), clip=True, views=2)
