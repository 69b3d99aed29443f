"""Fields on disk: round trips, and files that must be refused."""

from __future__ import annotations

import importlib
import json

import numpy as np
import pytest
import safetensors.torch
import torch
from safetensors import safe_open
from safetensors.numpy import load_file, save_file

from benchmarks.scenes.gusts import GustField
from seeing_wind.engine.errors import TakeError
from seeing_wind.engine.field import distill, load_field

from .conftest import BOX, FPS, recovery_of


@pytest.fixture(scope="module")
def fields(tumbling, known_wind, hasty):
    recovery, particles = tumbling
    short, _ = recovery_of(recovery.force_density[:2], recovery.x[:3])
    made = {name: distill(short, particles, FPS, name) for name in ("causal_triplane", "kplanes", "point")}
    return {**made, "analytic": known_wind}


@pytest.mark.parametrize("name", ["causal_triplane", "kplanes", "point", "analytic"])
def test_a_field_survives_the_disk_exactly(fields, tumbling, tmp_path, name):
    field, x = fields[name], tumbling[0].x[1]
    field.save(tmp_path / "field.safetensors")
    again = load_field(tmp_path / "field.safetensors")
    assert again.representation == name
    assert np.array_equal(again.box, field.box) and again.fps == field.fps and again.frames == field.frames
    for want, got in zip(field.sample(x, 1), again.sample(x, 1)):
        assert np.array_equal(want, got)
    assert np.array_equal(field.gradient(x, 1), again.gradient(x, 1))


def test_the_metadata_can_be_read_without_this_package(fields, tmp_path):
    path = tmp_path / "field.safetensors"
    fields["causal_triplane"].save(path)
    with safe_open(path, framework="numpy") as file:
        metadata = file.metadata()
    assert metadata["units"] == "N/m3" and metadata["representation"] == "causal_triplane" and metadata["frames"] == "2"
    assert np.array(json.loads(metadata["box"])).shape == (2, 3)
    assert float(metadata["fps"]) == FPS


def test_missing_and_damaged_files(tmp_path, known_wind):
    path = tmp_path / "field.safetensors"
    with pytest.raises(TakeError, match="no field"):
        load_field(path)
    for content in (b"", b"not a field", b"\xff" * 64):
        path.write_bytes(content)
        with pytest.raises(TakeError):
            load_field(path)
    known_wind.save(path)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(TakeError):
        load_field(path)


CONTRADICTIONS = [
    {"representation": "tensor_train"},
    {"version": "99"},
    {"units": "lbf/ft3"},
    {"frames": "7"},
    {"frames": "many"},
    {"box": "[[0,0,0]]"},
    {"box": "[[0,0,0],[0,0,0]]"},
    {"fps": "0"},
    {"fps": None},
    {"scale": None},
    {"scale": "nan"},
    {"reach": "inf"},
    {"shape": '{"nodes": [[5,5,5]]}'},
    {"shape": '{"surprise": 1}'},
]


@pytest.mark.parametrize("change", CONTRADICTIONS)
def test_incomplete_or_contradictory_metadata(fields, tmp_path, change):
    path = tmp_path / "field.safetensors"
    fields["causal_triplane"].save(path)
    with safe_open(path, framework="numpy") as file:
        metadata = {key: value for key, value in {**file.metadata(), **change}.items() if value is not None}
    save_file(load_file(path), path, metadata)
    with pytest.raises(TakeError) as caught:
        load_field(path)
    assert str(path) in caught.value.message and not caught.value.message.endswith("..")
    if None in change.values():
        assert caught.value.message.endswith(f": it lacks {next(iter(change))}.")


TENSORS = [("causal_triplane", "module.planes.table"), ("point", "confidence.value"), ("analytic", "phase")]


@pytest.mark.parametrize("name, missing", TENSORS)
def test_missing_tensors(fields, tmp_path, name, missing):
    path = tmp_path / "field.safetensors"
    fields[name].save(path)
    with safe_open(path, framework="numpy") as file:
        metadata = file.metadata()
    save_file({key: value for key, value in load_file(path).items() if key != missing}, path, metadata)
    with pytest.raises(TakeError):
        load_field(path)


NUMBERS = [
    ("causal_triplane", "module.decoder.2.bias", np.nan),
    ("causal_triplane", "module.planes.table", -np.inf),
    ("kplanes", "confidence.value", np.nan),
    ("kplanes", "confidence.value", 1.5),
    ("causal_triplane", "confidence.points", np.inf),
    ("causal_triplane", "confidence.origin", np.nan),
    ("point", "force_density", np.nan),
    ("analytic", "amplitude", np.nan),
]


@pytest.mark.parametrize("name, key, value", NUMBERS)
def test_numbers_that_cannot_be(fields, tmp_path, name, key, value):
    path = tmp_path / "field.safetensors"
    fields[name].save(path)
    with safe_open(path, framework="numpy") as file:
        metadata = file.metadata()
    tensors = load_file(path)
    tensors[key].flat[-1] = value
    save_file(tensors, path, metadata)
    with pytest.raises(TakeError, match=key if not np.isfinite(value) else "outside 0..1"):
        load_field(path)


@pytest.mark.parametrize("kind", [torch.bfloat16, torch.float8_e4m3fn])
def test_number_types_that_numpy_lacks(known_wind, tmp_path, kind):
    importlib.import_module("ml_dtypes")  # of the package onnx: it adds the first of them to NumPy
    path = tmp_path / "field.safetensors"
    known_wind.save(path)
    with safe_open(path, framework="pt") as file:
        tensors, metadata = {key: file.get_tensor(key) for key in file.keys()}, file.metadata()
    safetensors.torch.save_file(tensors | {"phase": tensors["phase"].to(kind)}, path, metadata)
    with pytest.raises(TakeError, match="cannot be read as a field"):
        load_field(path)


@pytest.mark.parametrize("name", ["causal_triplane", "kplanes", "point"])
def test_a_file_of_the_first_version_samples_the_same(fields, tumbling, tmp_path, name):
    """Its confidence's points are world positions in float32, without an origin."""
    field, path = fields[name], tmp_path / "field.safetensors"
    field.save(path)
    with safe_open(path, framework="numpy") as file:
        metadata = file.metadata()
    tensors = load_file(path)
    tensors["confidence.points"] = (tensors["confidence.points"] + tensors.pop("confidence.origin")).astype(np.float32)
    save_file(tensors, path, {**metadata, "version": "1"})
    again, x = load_field(path), np.concatenate([tumbling[0].x[1], tumbling[0].x[1] + 0.03])
    assert np.array_equal(again.sample(x, 1)[0], field.sample(x, 1)[0])
    assert np.allclose(again.sample(x, 1)[1], field.sample(x, 1)[1], atol=1e-4)
    again.save(path)
    assert np.array_equal(load_field(path).sample(x, 1)[1], again.sample(x, 1)[1])


@pytest.mark.parametrize("name", ["causal_triplane", "kplanes", "point"])
def test_a_field_in_map_coordinates_is_the_same_field(fields, tumbling, hasty, tmp_path, name):
    """float32 has steps of half a metre there, more than the body's size."""
    recovery, field, away = tumbling[0], fields[name], np.array([500000.0, 4649776.0, 100.0])
    moved = distill(*recovery_of(recovery.force_density[:2], recovery.x[:3] + away), FPS, name)
    moved.save(tmp_path / "field.safetensors")
    points = np.concatenate([recovery.x[1], recovery.x[1] + [0.0, 0.05, 0.0]])
    for there in (moved, load_field(tmp_path / "field.safetensors")):
        for want, got in zip(field.sample(points, 1), there.sample(points + away, 1)):
            assert np.abs(want - got).max() < 1e-5 * np.abs(want).max()
        assert there.sample(recovery.x[1] + away, 1)[1].min() > 0.99


def test_a_folder_that_is_not_there(known_wind, tmp_path):
    with pytest.raises(TakeError):
        known_wind.save(tmp_path / "nowhere" / "field.safetensors")


def test_files_are_the_same_for_the_same_field(tmp_path):
    for name in "ab":
        GustField(1, BOX, FPS, 5, np.zeros(3), 2.0, wavelength=1.0, period=0.8).save(tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
