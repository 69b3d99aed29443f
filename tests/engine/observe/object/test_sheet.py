"""A thin sheet from its tracks: a rectangle that is rolled to and fro about its held edge without any change of lengths."""

from __future__ import annotations

import dataclasses
import math

import cv2
import numpy as np
import pytest
from scipy.sparse import identity

from seeing_wind.engine.errors import MaterialError, ObjectError
from seeing_wind.engine.masks import Masks
from seeing_wind.engine.observe.object.body import rest_body
from seeing_wind.engine.observe.object.motion.lifting import Sight
from seeing_wind.engine.observe.object.sheet import follow as following
from seeing_wind.engine.observe.object.sheet.banded import Banded
from seeing_wind.engine.observe.object.sheet.farthest import farthest
from seeing_wind.engine.observe.object.sheet.follow import follow
from seeing_wind.engine.observe.object.sheet.frame import FrameSolver
from seeing_wind.engine.observe.object.sheet.mesh import SheetMesh, flatten_mesh
from seeing_wind.engine.observe.object.sheet.riding import ride_flat
from seeing_wind.engine.observe.object.sheet.template import LOOSEST, Allowed, Template, hinges_of
from seeing_wind.engine.observe.object.sheet.view import View
from seeing_wind.engine.progress import NoProgress, Progress
from seeing_wind.engine.record_arrays import from_arrays, to_arrays
from seeing_wind.engine.records import Body, Camera, Recognised
from seeing_wind.engine.recovery import journal as journals
from seeing_wind.engine.recovery.journal import TakeJournal
from seeing_wind.engine.settings import BuildSettings
from seeing_wind.engine.stages import build_body
from seeing_wind.engine.take import Take
from tests.engine.observations import observed

FPS, FRAMES, NOISE = 30.0, 16, 0.1
WIDTH, HEIGHT = 0.4, 0.3


def rolled(flat: np.ndarray, t: float) -> np.ndarray:
    """Points (K, 2) of the sheet laid flat -> (K, 3) [m] in frame t: a cylinder, flat in frame 0."""
    curvature = 5.0 * np.sin(2.0 * np.pi * t / 20.0) + 1e-9
    s = flat[:, 0]
    return np.stack([np.sin(curvature * s) / curvature, (1.0 - np.cos(curvature * s)) / curvature, flat[:, 1]], axis=1)


def grid(columns: int = 12, rows: int = 9) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 2) of the sheet laid flat [m], and faces."""
    u, w = np.meshgrid(np.linspace(0.0, WIDTH, columns + 1), np.linspace(0.0, HEIGHT, rows + 1), indexing="ij")
    index = np.arange(u.size).reshape(u.shape)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    return np.stack([u.ravel(), w.ravel()], axis=1), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def camera(side: tuple[float, float, float]) -> Camera:
    """A camera one metre from the sheet's middle, in the direction `side`."""
    back = np.array(side) / np.linalg.norm(side)
    right = np.cross(-back, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(-back, right), -back], axis=1)
    pose[:3, 3] = np.array([WIDTH / 2, 0.0, HEIGHT / 2]) + back
    return Camera(1000, 800, 900.0, 900.0, 499.5, 399.5, pose)


def sheet() -> SheetMesh:
    flat, faces = grid()
    x = rolled(flat, 0)
    return SheetMesh(x, faces, camera((-0.4, -1.0, 0.2)).project(x)[0], flatten_mesh(x, faces), flat[:, 0] < 1e-9)


def truth() -> np.ndarray:
    """(T+1, V, 3) [m]."""
    return np.stack([rolled(grid()[0], t) for t in range(FRAMES + 1)])


def sight(side: tuple[float, float, float] = (-0.4, -1.0, 0.2), count: int = 120, noise: float = NOISE, seed: int = 0) -> Sight:
    """Tracks of points at random places on the sheet, seen from `side`."""
    rng, seen_by = np.random.default_rng(seed), camera(side)
    flat = rng.uniform(0.02, 0.98, (count, 2)) * [WIDTH, HEIGHT]
    xy = np.stack([seen_by.project(rolled(flat, t))[0] for t in range(FRAMES + 1)])
    xy = xy + noise * rng.normal(size=xy.shape)
    return Sight(seen_by, xy, np.ones(xy.shape[:2], bool), np.full(xy.shape[:2], NOISE))


def off(path: np.ndarray) -> float:
    """Root mean square distance from the truth [mm]."""
    return 1e3 * float(np.sqrt(((path - truth()) ** 2).sum(axis=-1).mean()))


def test_points_ride_on_every_quadratic_surface():
    flat, rng = grid()[0], np.random.default_rng(1)
    points = rng.uniform(0.0, 1.0, (40, 2)) * [WIDTH, HEIGHT]
    riding = ride_flat(points, flat)

    def surface(at: np.ndarray) -> np.ndarray:
        x, y = at.T
        return np.stack([1.0 + x, x - 2.0 * y, 3.0 * x * x - 2.0 * x * y + 5.0 * y * y], axis=1)

    np.testing.assert_allclose(riding.weight.sum(axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(riding.follow(surface(flat)), surface(points), atol=2e-5)


def test_a_rolled_sheet_laid_flat_has_its_lengths():
    flat, faces = grid()
    again = flatten_mesh(rolled(flat, 5.0), faces)
    apart = np.linalg.norm(flat[:, None] - flat, axis=-1)
    np.testing.assert_allclose(np.linalg.norm(again[:, None] - again, axis=-1), apart, atol=0.005 * WIDTH)


def test_the_templates_gradient():
    template, rng = Template(sheet()), np.random.default_rng(2)
    x, way = truth()[4] + 1e-3 * rng.normal(size=truth()[4].shape), rng.normal(size=truth()[4].shape)
    step = 1e-6
    numeric = (template.cost(x + step * way, LOOSEST) - template.cost(x - step * way, LOOSEST)) / (2.0 * step)
    assert template.linearise(x, LOOSEST)[1] @ way.ravel() == pytest.approx(numeric, rel=1e-5)


def test_a_hinge_bends_by_the_angle_between_its_faces():
    """Two faces: the cost is half the square of their angle over what the curvature allows on the way between their centres."""
    angle = 0.02
    x = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.5, 0.0], [-1.0, 0.5, 0.0]])
    mesh = SheetMesh(x, np.array([[0, 2, 1], [0, 1, 3]]), x[:, :2], x[:, :2], np.zeros(4, bool))
    assert len(hinges_of(mesh.faces)) == 1
    bent = x.copy()
    bent[2] = [np.cos(angle), 0.5, np.sin(angle)]
    between, size = 2.0 / 3.0, 1.0
    assert Template(mesh).cost(bent, Allowed(3.0, 0.02)) == pytest.approx(0.5 * (angle / (3.0 / size * between)) ** 2, rel=0.01)


def test_a_fold_within_an_edge_may_shorten_it_by_any_amount():
    """Of an edge, half a millimetre of stretching costs more than losing a tenth of it to a fold."""
    template, own = Template(sheet()), sheet().x
    edge = WIDTH / 12
    stretched, folded = (own * np.where(own[:, :1] > WIDTH - 1e-9, 1.0 + by * edge / WIDTH, 1.0) for by in (0.0005 / edge, -0.1))
    assert template.cost(folded, LOOSEST) < template.cost(stretched, LOOSEST)


def test_banded_systems():
    template, rng = Template(sheet()), np.random.default_rng(4)
    hessian = template.linearise(truth()[4], LOOSEST)[0] + identity(truth()[4].size, format="csr")
    right = rng.normal(size=(truth()[4].size, 2))
    np.testing.assert_allclose(Banded(sheet().flat).solve(hessian, right), np.linalg.solve(hessian.toarray(), right), rtol=1e-8, atol=1e-10)


def test_the_farthest_shape_of_a_rolled_sheet():
    """It is found roughly where it is, although nothing tells where it was before."""
    mesh, frame = sheet(), 15
    view = View(mesh, sight())
    view.place(0, mesh.x)
    shape = farthest(mesh, view, frame, Template(mesh).bends / LOOSEST.curvature**2)
    away, moved = (np.sqrt(((one - truth()[frame]) ** 2).sum(axis=1).mean()) for one in (shape, mesh.x))
    assert away < 0.2 * moved


def test_a_sheet_that_bent_the_other_way_while_it_was_hidden(monkeypatch):
    """It is bent away from the camera in frame 5 and towards it in frame 14, and nothing is seen in between."""
    seen = sight()
    visible = seen.visible.copy()
    visible[6:14] = False
    hidden = dataclasses.replace(seen, visible=visible)
    found = follow(sheet(), [hidden], FPS).path
    monkeypatch.setattr(following, "farthest", lambda mesh, *_: mesh.x)
    lost = follow(sheet(), [hidden], FPS).path
    before, after = (1e3 * np.sqrt(((path[14:] - truth()[14:]) ** 2).sum(axis=-1).mean()) for path in (lost, found))
    assert after < 4.0
    assert before > 5.0 * after


def test_one_camera_tells_where_a_sheet_is():
    seen = follow(sheet(), [sight()], FPS)
    error = np.sqrt(((seen.path - truth()) ** 2).mean())
    assert off(seen.path) < 2.0  # it travels by 160 mm, half of it along the view; a pixel is 1.1 mm
    assert 0.5 < error / np.sqrt((seen.sigma**2).mean()) < 2.0
    assert np.isfinite(seen.places[0]).all()


def test_errors_are_as_large_as_each_frame_says_of_its_own():
    """Of their second differences, which the forces come from: vertices share them, as the whole sheet seems nearer or farther."""
    seen = follow(sheet(), [sight()], FPS).measured
    modes, frames = seen.modes.shape[1], len(seen.x)
    off = np.einsum("rv,tvi->tri", np.linalg.pinv(seen.modes), seen.x - truth())
    apart = np.diff(off, 2, axis=0).reshape(frames - 2, -1)
    each = seen.covariance.reshape(frames, 3 * modes, -1)
    spread = each[:-2] + 4.0 * each[1:-1] + each[2:]
    ratio = np.einsum("ki,kij,kj->k", apart, np.linalg.inv(spread), apart) / apart.shape[1]
    assert 0.3 < np.sqrt(np.mean(ratio)) < 1.5


def test_noise_does_not_crease_a_flat_sheet(monkeypatch):
    """It flies away, seen at a slant. Were it taken to be as bent as cloth may be, noise would shorten it, and it would seem nearer."""
    flat, faces = grid(18, 14)
    x = rolled(flat, 0)
    path = x + np.arange(9)[:, None, None] * np.array([0.02, 0.12, 0.0])
    seen_by, rng = camera((-1.0, -0.7, 0.2)), np.random.default_rng(3)
    mesh = SheetMesh(x, faces, seen_by.project(x)[0], flatten_mesh(x, faces), np.zeros(len(x), bool))
    followed_by = ride_flat(rng.uniform(0.02, 0.98, (120, 2)) * [WIDTH, HEIGHT], flat)
    xy = np.stack([seen_by.project(followed_by.follow(one))[0] for one in path])
    seen = Sight(seen_by, xy + 0.4 * rng.normal(size=xy.shape), np.ones(xy.shape[:2], bool), np.full(xy.shape[:2], 0.4))

    def depth_off() -> float:
        away = (follow(mesh, [seen], FPS).path - path).mean(axis=1) @ seen_by.camera_to_world[:3, 2]
        return 1e3 * float(np.abs(away[1:]).mean())

    learnt = depth_off()
    monkeypatch.setattr(FrameSolver, "learn", lambda *_: 1.0)
    assert learnt < 1.0
    assert depth_off() > 3.0 * learnt


def test_what_is_recognised_after_all_tracks_are_lost():
    """Tracks end in frame 2, and nothing is seen until frame 7: then the sheet is far from where it was going."""
    seen, last = sight(count=60), 9
    seen = dataclasses.replace(seen, xy=seen.xy[: last + 1], visible=seen.visible[: last + 1], sigma=seen.sigma[: last + 1])
    visible = seen.visible.copy()
    visible[3:] = False
    late = np.repeat(np.arange(7, last + 1, dtype=np.int32), 60)
    first, now = np.tile(seen.xy[0], (last - 6, 1)), seen.xy[7:].reshape(-1, 2)
    wrong = np.arange(len(late)) % 25 == 0
    now = now + np.where(wrong[:, None], [60.0, -40.0], 0.0)
    blind = dataclasses.replace(seen, visible=visible)
    again = dataclasses.replace(blind, recognised=Recognised(late, first, now))
    lost, found = (np.linalg.norm(follow(sheet(), [one], FPS).path[last] - truth()[last], axis=1) for one in (blind, again))
    assert np.sqrt((lost**2).mean()) > 0.05
    assert np.sqrt((found**2).mean()) < 0.005


@pytest.mark.slow
def test_tracks_that_end_and_tracks_that_begin():
    """Half of them are gone after frame 12, the other half begin in frame 9: these are tied where the sheet is then."""
    seen = sight(count=240)
    visible = seen.visible.copy()
    visible[13:, ::2] = visible[:9, 1::2] = False
    found = follow(sheet(), [dataclasses.replace(seen, visible=visible)], FPS)
    assert off(found.path) < 5.0
    wanted = np.random.default_rng(0).uniform(0.02, 0.98, (240, 2)) * [WIDTH, HEIGHT]
    flat, own = sheet().flat, grid()[0]
    turn = np.linalg.lstsq(np.column_stack([flat, np.ones(len(flat))]), own, rcond=None)[0]
    away = np.linalg.norm(np.column_stack([found.places[0], np.ones(240)]) @ turn - wanted, axis=1)
    assert np.median(away[1::2]) < 0.001 and away.max() < 0.015


@pytest.mark.slow
def test_tracks_that_slide_count_less():
    seen = sight()
    xy = seen.xy.copy()
    xy[:, ::10] += 1.5 * np.arange(FRAMES + 1)[:, None, None]
    assert off(follow(sheet(), [dataclasses.replace(seen, xy=xy)], FPS).path) < 2.0


@pytest.mark.slow
def test_two_cameras_tell_more_than_one():
    alone = follow(sheet(), [sight(count=30)], FPS).path
    both = follow(sheet(), [sight(count=30), sight((1.0, -0.6, 0.1), 60, seed=1)], FPS).path
    assert off(both) < 0.8 * off(alone)


def test_it_goes_on_from_where_it_was_killed(tmp_path, monkeypatch):
    seen, frames = sight(), FRAMES // 2
    seen = dataclasses.replace(seen, **{name: getattr(seen, name)[: frames + 1] for name in ("xy", "visible", "sigma")})
    take, solved, calls, killed_at = Take(tmp_path), FrameSolver.solve, [0], [math.inf]
    take.prepare()

    def counted(self, *arguments):
        calls[0] += 1
        if calls[0] > killed_at[0]:
            raise KeyboardInterrupt
        return solved(self, *arguments)

    monkeypatch.setattr(journals, "LATEST", 0.0)  # everything is written at once
    monkeypatch.setattr(FrameSolver, "solve", counted)
    whole, every = follow(sheet(), [seen], FPS), calls[0]
    killed_at[0] = every + every // 2
    with pytest.raises(KeyboardInterrupt), TakeJournal(take, "stamp", NoProgress()) as journal:
        follow(sheet(), [seen], FPS, journal=journal)
    calls[0], killed_at[0] = 0, every - every // 2 + following.LEARNT + 2  # a frame is begun again
    with TakeJournal(take, "stamp", NoProgress()) as journal:
        again = follow(sheet(), [seen], FPS, journal=journal)
    np.testing.assert_array_equal(again.path, whole.path)
    np.testing.assert_array_equal(again.measured.covariance, whole.measured.covariance)


def test_too_few_tracks_are_told():
    with pytest.raises(ObjectError, match="Only 5 tracked points"):
        follow(sheet(), [sight(count=5)], FPS)


@pytest.fixture
def cloth():
    """A square of 0.5 m, a metre away, with tracks that stand still."""
    mask = np.zeros((72, 96), bool)
    mask[14:59, 25:70] = True
    return observed(mask, 1.0)


def test_cloth_is_built_as_a_sheet(cloth):
    told = []
    body = build_body(cloth, BuildSettings(material="cotton", particles=100), Progress(told.append))
    assert any("taken to be flat and to face the camera" in one.get("message", "") for one in told)
    assert body.sheet is not None and body.path is not None
    mass = body.material.density * body.particles.volume.sum()
    assert mass == pytest.approx(0.12 * 0.25, rel=0.05)  # shirting, kg/m²
    np.testing.assert_allclose(body.path - body.path[0], 0.0, atol=2e-4)
    assert cloth.camera.project(body.keypoints.follow(body.particles.x))[0] == pytest.approx(cloth.xy[0], abs=0.05)
    again = from_arrays(Body, to_arrays(body))
    assert again.sheet == body.sheet
    np.testing.assert_array_equal(again.path, body.path)


def test_frames_in_which_nothing_is_tracked_are_told(cloth):
    visible, told = cloth.visible.copy(), []
    visible[2:] = False
    build_body(dataclasses.replace(cloth, visible=visible), BuildSettings(material="cotton", particles=100), Progress(told.append))
    blind = len(visible) - 2
    assert any(f"In {blind} of {len(visible)} frames, first in frame 2, fewer than 8" in one.get("message", "") for one in told)


def test_what_is_built_as_a_solid(cloth):
    assert build_body(cloth, BuildSettings(material="cotton", form="solid", particles=100)).sheet is None
    assert build_body(cloth, BuildSettings(material="rubber", particles=100)).sheet is None
    assert build_body(cloth, BuildSettings(material="paper", particles=100)).sheet is None  # bends over 6 cm
    assert build_body(cloth, BuildSettings(material="paper", form="sheet", particles=100)).sheet is not None
    few, told = dataclasses.replace(cloth, xy=cloth.xy[:, :4], visible=cloth.visible[:, :4], sigma=cloth.sigma[:, :4]), []
    few = dataclasses.replace(few, on_centroid=cloth.on_centroid[:4])
    assert build_body(few, BuildSettings(material="cotton", particles=100), Progress(told.append)).sheet is None
    assert any("only 4 points of it are tracked" in one.get("message", "") for one in told)


def test_what_is_no_sheet(cloth):
    with pytest.raises(MaterialError, match="steel is not known as a sheet"):
        build_body(cloth, BuildSettings(material="steel", form="sheet"))
    with pytest.raises(MaterialError, match="no plastic law"):
        build_body(cloth, BuildSettings(material="cotton", form="sheet", law="von_mises", yield_stress=1e4))
    short = dataclasses.replace(cloth, xy=cloth.xy[:2], visible=cloth.visible[:2], sigma=cloth.sigma[:2])
    with pytest.raises(ObjectError, match="at least 3 frames; these are 2"):
        build_body(short, BuildSettings(material="cotton"))


def test_a_sheet_that_does_not_show_its_shape_is_refused_before_anything_is_assumed_of_it(cloth):
    asked, told = BuildSettings(material="cotton", form="sheet"), []
    for count, says in ((0, "No tracked point lies"), (1, "Only one tracked point lies"), (7, "Only 7 tracked points lie")):
        few = dataclasses.replace(cloth, visible=cloth.visible & (np.arange(cloth.visible.shape[1]) < count))
        with pytest.raises(ObjectError, match=f"{says} on the sheet in frame 0; its shape needs 8"):
            build_body(few, asked, Progress(told.append))
        with pytest.raises(ObjectError, match=says):
            rest_body(few, asked)
    assert not [one for one in told if one["type"] == "warning"]
    strip = np.zeros((72, 96), bool)
    strip[30:36, 25:70] = True
    with pytest.raises(ObjectError, match="less than 7 pixels thick in frame 0, as if seen edge-on"):
        build_body(observed(strip, 1.0), asked)
    soft = BuildSettings(material="silk", particles=100)
    assert build_body(observed(strip, 1.0), soft, Progress(told.append)).sheet is None
    assert any("silk hangs in folds, but it is less than 7 pixels thick" in one["message"] for one in told)
    strip[29] = strip[30]
    assert build_body(observed(strip, 1.0), soft).sheet is not None


def test_the_sheet_reaches_its_outline_where_nothing_is_tracked():
    """Tracks on the half at the held edge only: the outline tells where the rest has unrolled to."""
    seen, frames = sight(count=80), FRAMES + 1
    near = np.random.default_rng(0).uniform(0.02, 0.98, (80, 2))[:, 0] < 0.5
    seen = dataclasses.replace(seen, visible=seen.visible & near)
    masks = []
    for x in truth():
        mask, xy = np.zeros((800, 1000), np.uint8), seen.camera.project(x)[0]
        for face in grid()[1]:
            cv2.fillConvexPoly(mask, np.round(xy[face]).astype(np.int32), 1)
        masks.append(mask > 0)
    free, drawn = (follow(sheet(), [seen], FPS, outline).path for outline in (None, Masks.of(masks)))
    assert len(drawn) == frames and off(drawn) < 0.6 * off(free)
    edge = np.isclose(grid()[0][:, 0], WIDTH)
    short = seen.camera.project(drawn[-1][edge])[0] - seen.camera.project(truth()[-1][edge])[0]
    assert np.sqrt((short**2).sum(axis=1).mean()) < 12.0
