"""Objects that something hides, all of them or a part, for a while."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from interrupted import assert_same, in_pieces
from scenes import HEIGHT, WIDTH, Scene, moving_body, noise, overlap, write_video

from seeing_wind.engine.observe import observe
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.records import Observation
from seeing_wind.engine.settings import ObserveSettings

T = np.arange(25.0)
ONWARD = 45.0 + 6.0 * T
PATTERN = noise(np.random.default_rng(7), (90, 90), (120, 40, 20), (255, 200, 110), 1.6)


def hidden_by(post: int, folder: Path, radius: float, x: np.ndarray = ONWARD, at: np.ndarray | float = 100.0) -> Scene:
    """A disc that moves along `x` (25,) [px] behind a post, which is `post` px wide and whose left side is `at` [px], (25,) if it moves."""
    disc = moving_body(folder, np.stack([x, np.full(25, 80.0)], axis=1), np.zeros(25), radius, PATTERN)
    wood = noise(np.random.default_rng(5), (HEIGHT, post), (45, 105, 45), (75, 135, 75), 2.0)
    for frame, mask, left in zip(disc.frames, disc.masks, np.broadcast_to(at, 25).astype(int)):
        first, last = max(left, 0), min(left + post, WIDTH)
        if first < last:
            frame[:, first:last], mask[:, first:last] = wood[:, first - left : last - left], False
    return disc


def seen_of(disc: Scene, radius: float) -> Observation:
    """What is seen of that disc in a box round it in frame 0."""
    write_video(disc.path, list(disc.frames), 30.0)
    (x, y), reach = disc.centers[0], radius + 4.0
    return observe(str(disc.path), ObserveSettings(box=(x - reach, y - reach, x + reach, y + reach), distance=1.0), NoProgress())


def check_found(disc: Scene, seen: Observation, hidden: int) -> None:
    """It is found where it is seen whole, before and after `hidden` frames or more without it; nothing is found in these."""
    found, sizes = np.asarray(seen.masks), disc.masks.sum(axis=(1, 2))
    gone, whole = np.flatnonzero(sizes == 0), np.flatnonzero(sizes > 0.95 * sizes[0])
    assert len(gone) >= hidden and whole[0] < gone[0] and whole[-1] > gone[-1] + 2
    assert not found[gone].any()
    assert overlap(found[whole], disc.masks[whole]).min() > 0.8


@pytest.mark.parametrize(("radius", "post"), [(30.0, 20), (20.0, 12), pytest.param(30.0, 12, marks=pytest.mark.slow)])
def test_what_passes_behind_a_still_post_is_known_again_beside_it(tmp_path: Path, radius: float, post: int) -> None:
    disc = hidden_by(post, tmp_path, radius)
    alike = overlap(np.asarray(seen_of(disc, radius).masks), disc.masks)
    # On both sides of the post: before, it was lost to the last pixel, and then grew back by 20 px a frame.
    assert min(alike) > 0.8 and np.median(alike) > 0.95


def test_what_is_all_hidden_for_a_while_is_found_again_and_nothing_else_before(tmp_path: Path) -> None:
    """Meanwhile, a patch of its own colours shows and vanishes elsewhere."""
    disc = hidden_by(60, tmp_path, 20.0)
    gone = np.flatnonzero(disc.masks.sum(axis=(1, 2)) == 0)
    disc.frames[gone, 4:20, 4:20] = disc.frames[0][72:88, 37:53]
    check_found(disc, seen_of(disc, 20.0), 1)


def test_a_small_thing_is_found_again(tmp_path: Path) -> None:
    disc = hidden_by(30, tmp_path, 4.0)
    check_found(disc, seen_of(disc, 4.0), 3)


def test_what_turns_back_while_it_is_hidden_is_found_where_it_went_in(tmp_path: Path) -> None:
    back = np.where(T < 13, ONWARD, 2 * ONWARD[13] - ONWARD)
    disc = hidden_by(50, tmp_path, 16.0, back)
    check_found(disc, seen_of(disc, 16.0), 3)


def test_what_sways_in_its_place_is_found_when_something_has_passed_before_it(tmp_path: Path) -> None:
    """The background is not known in its place, so it is recognised by its looks; also if the job is killed while it is hidden."""
    disc = hidden_by(50, tmp_path, 16.0, 100.0 + 3.0 * np.sin(0.7 * T), 12.0 * (T - 6.0))
    seen = seen_of(disc, 16.0)
    check_found(disc, seen, 1)
    (x, y), reach = disc.centers[0], 20.0
    settings = ObserveSettings(box=(x - reach, y - reach, x + reach, y + reach), distance=1.0)
    resumed, kills, _ = in_pieces(disc.path, settings, tmp_path, 2)
    assert kills > 10
    assert_same(resumed, seen)


def test_the_middle_of_a_part_of_a_plain_body_is_not_taken_for_that_of_all_of_it(tmp_path: Path) -> None:
    disc = hidden_by(60, tmp_path, 20.0)
    disc.frames[disc.masks] = (200, 60, 50)
    disc.frames[:, :, 100:160] = (60, 110, 60)
    seen = seen_of(disc, 20.0)
    assert seen.on_centroid.all() and seen.xy.shape[1] == 1
    off = np.linalg.norm(seen.xy[:, 0] - disc.centers, axis=1)
    # Of a quarter of the disc, the middle is 10 px off.
    assert off[seen.visible[:, 0]].max() < 1.5
    assert seen.visible[:6].all() and seen.visible[-2:].all() and not seen.visible[10:18].any()
