"""Sampling from files and exporting."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from seeing_wind.engine.errors import UsageError
from seeing_wind.engine.field import distances, export_field, read_points, sample_points
from seeing_wind.engine.field.confidence import ConfidenceMap
from seeing_wind.engine.field.sampling import lattice

from .conftest import BOX, FRAMES


def test_points_of_one_frame_and_of_every_frame(known_wind, tmp_path):
    points = np.random.default_rng(0).uniform(BOX[0], BOX[1], (FRAMES, 20, 3))
    np.save(tmp_path / "all.npy", points)
    np.save(tmp_path / "one.npy", points[4])
    force, confidence = sample_points(known_wind, read_points(tmp_path / "all.npy"))
    assert force.shape == (FRAMES, 20, 3) and confidence.shape == (FRAMES, 20)
    assert np.array_equal(sample_points(known_wind, read_points(tmp_path / "one.npy"), 4)[0], force[4])
    assert not np.array_equal(force[4], force[5])
    assert not distances(known_wind, points).any() and distances(known_wind, points).shape == (FRAMES, 20), "it is known everywhere"


@pytest.mark.parametrize("shape, frame", [((3, 20, 3), None), ((20, 3), None), ((FRAMES, 20, 3), 0), ((20, 2), 0)])
def test_shapes_that_do_not_fit(known_wind, shape, frame):
    for ask in (sample_points, distances):
        with pytest.raises(UsageError):
            ask(known_wind, np.zeros(shape), frame)


def test_files_that_hold_no_points(known_wind, tmp_path):
    np.savez(tmp_path / "points.npz", np.zeros((2, 3)))
    np.save(tmp_path / "words.npy", np.array(["a", "b"]))
    np.save(tmp_path / "objects.npy", np.array([{}, None], dtype=object), allow_pickle=True)
    (tmp_path / "text.npy").write_text("0 0 0")
    (tmp_path / "zip.npy").write_bytes(b"PK\x03\x04garbage")
    for name in ("zip.npy", "points.npz", "words.npy", "objects.npy", "text.npy", "missing.npy"):
        with pytest.raises(UsageError):
            sample_points(known_wind, read_points(tmp_path / name), 0)


def test_a_folder_of_frames_takes_no_file_s_place(known_wind, tmp_path):
    (tmp_path / "clip.mp4").write_bytes(b"mine")
    with pytest.raises(UsageError, match="clip.mp4 is there already and is not a folder"):
        export_field(known_wind, "ply", tmp_path / "clip.mp4")
    assert (tmp_path / "clip.mp4").read_bytes() == b"mine"


def test_the_lattice_spans_the_box_with_x_fastest():
    points, (x, y, z) = lattice(BOX, 11)
    assert (x, y, z) == (11, 7, 11) and len(points) == x * y * z
    assert np.array_equal(points[[0, -1]], BOX)
    assert np.ptp(points[:x, 0]) == 1.0 and not np.ptp(points[:x, 1:], axis=0).any()


def test_npz(known_wind, tmp_path):
    (path,) = export_field(known_wind, "npz", tmp_path / "wind", nodes=6)
    assert path == tmp_path / "wind.npz"
    with np.load(path, allow_pickle=False) as data:
        assert data["force_density"].shape == (FRAMES, len(data["points"]), 3)
        assert np.array_equal(data["force_density"][3], known_wind.sample(data["points"], 3)[0])
        assert float(data["fps"]) == known_wind.fps


def test_ply(known_wind, tmp_path):
    files = export_field(known_wind, "ply", tmp_path / "clouds", nodes=6)
    assert [path.name for path in files] == [f"frame_{frame:04d}.ply" for frame in range(FRAMES)]
    cloud = trimesh.load(files[2])
    force, _ = known_wind.sample(cloud.vertices, 2)
    columns = cloud.metadata["_ply_raw"]["vertex"]["data"]
    got = np.stack([columns[name] for name in ("fx", "fy", "fz")], axis=1).reshape(-1, 3)
    assert np.allclose(got, force, atol=1e-3)
    assert not list((tmp_path / "clouds").glob(".*"))


def test_fga_is_left_handed_and_in_centimetres(known_wind, tmp_path):
    files = export_field(known_wind, "fga", tmp_path / "vectors", nodes=6)
    rows = [[float(value) for value in line.strip(",").split(",")] for line in files[1].read_text().splitlines()]
    x, y, z = (int(count) for count in rows[0])
    low, high, vectors = np.array(rows[1]), np.array(rows[2]), np.array(rows[3:])
    assert vectors.shape == (x * y * z, 3) and (high > low).all()
    i, j, k = 2, 1, 3
    place = low + (high - low) * np.array([i, j, k]) / (np.array([x, y, z]) - 1)
    want, _ = known_wind.sample(place[None] / 100 * [1, -1, 1], 1)
    assert np.allclose(vectors[i + x * (j + y * k)], want[0] * [1, -1, 1], rtol=1e-4)


def test_formats_that_cannot_be_written(known_wind, tmp_path):
    with pytest.raises(UsageError, match="obj"):
        export_field(known_wind, "obj", tmp_path / "x")
    with pytest.raises(UsageError, match="OpenVDB"):
        export_field(known_wind, "vdb", tmp_path / "x")
    assert not (tmp_path / "x").exists()
    with pytest.raises(UsageError, match="not a file's name"):
        export_field(known_wind, "npz", ".")


def test_points_at_the_end_of_the_world_have_no_confidence(tmp_path):
    confidence = ConfidenceMap(np.zeros((2, 9, 3)), np.ones((2, 9)), 0.1)
    assert np.array_equal(confidence.at(np.array([[1e300, 0.0, 0.0], [0.0, -1e200, 0.0], [0.0, 0.0, 0.0]]), 1), [0.0, 0.0, 1.0])
