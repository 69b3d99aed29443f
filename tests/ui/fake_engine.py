"""Stands for the engine's Python: `fake_engine.py -m seeing_wind.engine VERB ...` writes small, known results in no time.

SEEING_WIND_FAKE chooses another behaviour for `observe`, `recover` and `resimulate` (see fake_worker.py); with "refused", the check of a
file of jobs ends as with "flags". Needs NumPy and the ground
floor, which the caller puts on PYTHONPATH as it does for the real engine. The field is a swirl about world Z that grows with time.
"""

from __future__ import annotations

import hashlib
import json
import os
import runpy
import struct
import sys
import tomllib
import zlib
from pathlib import Path

import numpy as np

FRAMES, FPS, DENSITY = 12, 24.0, 700.0
SIZE = (96, 64)


def swirl(points: np.ndarray) -> np.ndarray:
    """Field (T, M, 3) [N/m³] at points (T, M, 3) [m]."""
    growing = np.linspace(0.5, 1.5, len(points))[:, None, None]
    return 500.0 * growing * np.stack([-points[..., 1], points[..., 0], np.full(points.shape[:-1], 0.2)], axis=-1)


def away(points: np.ndarray) -> np.ndarray:
    """(T, M) [m] from a ball of radius 0.3 m about the object, which drifts, of points (T, M, 3) [m]."""
    middle = np.arange(len(points))[:, None, None] * np.array([0.02, 0.0, 0.01])
    return np.maximum(np.linalg.norm(points - middle, axis=-1) - 0.3, 0.0)


def outlines() -> list[np.ndarray]:
    """Of the white square of `extension.make_clip`."""
    masks = np.zeros((FRAMES + 1, SIZE[1], SIZE[0]), bool)
    for frame, mask in enumerate(masks):
        mask[20:44, 20 + 2 * frame : 44 + 2 * frame] = True
    return list(masks)


def breeze(points: np.ndarray) -> np.ndarray:
    """Wind (T, M, 3) [m/s] at points (T, M, 3) [m]: 4 m/s along X, a little more upwards."""
    return np.stack([4.0 + 0.5 * points[..., 2], np.full(points.shape[:-1], 1.0), np.zeros(points.shape[:-1])], axis=-1)


def read_as_wind(take: object, asked: str) -> None:
    """What the stage *wind* leaves: with `auto` the force, as if no wind were probable."""
    chosen = asked if asked == "wind" else "force"
    note = "Effective wind: 4.1 m/s (Beaufort 3) in the mean." if chosen == "wind" else "Field: force. A wind is less probable."
    law = {"normal": 1.17, "tangential": 0.05, "air_density": 1.2}
    told = {"field": chosen, "why": "as asked", "notes": [note], "mean_speed": 4.1, "strongest_gust": 6.0, "drag_law": law}
    take.write_json("wind.json", told)
    if chosen == "wind":
        with take.writing("wind.safetensors") as path:
            path.write_bytes(b"no wind")


def recover(options: list[str]) -> None:
    """A flat square of particles that drifts to the right."""
    from seeing_wind.engine.conventions import front_view
    from seeing_wind.engine.masks import Masks
    from seeing_wind.engine.record_arrays import to_arrays
    from seeing_wind.engine.records import Attachment, Camera, Particles, Surface
    from seeing_wind.engine.take import Take, stamp_of

    take = Take(options[options.index("--take") + 1])
    side = np.linspace(-0.2, 0.2, 4)
    x = np.stack(np.meshgrid(side, [0.0], side, indexing="ij"), -1).reshape(-1, 3)
    moving = x + np.arange(FRAMES + 1)[:, None, None] * np.array([0.02, 0.0, 0.01])
    cells = [(i, i + 1, i + 5, i + 4) for i in range(11) if i % 4 < 3]
    triangles = np.array([t for a, b, c, d in cells for t in ((a, b, c), (a, c, d))], dtype=np.int32)
    riding = Attachment(np.arange(16, dtype=np.int32)[:, None], np.ones((16, 1)))
    width, height = SIZE
    camera = Camera(width, height, 120.0, 120.0, (width - 1) / 2, (height - 1) / 2, front_view(2.0))
    take.write_arrays("observation.npz", {
        "image": np.full((height, width, 3), 90, np.uint8), "background": np.full((height, width, 3), (20, 120, 40), np.uint8),
        **to_arrays(camera, "camera."), **to_arrays(Masks.of(outlines()), "masks."),
    })  # fmt: skip
    surface = Surface(x, triangles, x[:, [0, 2]] + 0.5, riding)
    body = to_arrays(Particles(x, np.full(16, 1e-5), np.zeros(16, bool), 0.13), "particles.") | to_arrays(surface, "surface.")
    take.write_arrays("particles.npz", body)
    take.write_arrays("trajectory.npz", {"x": moving, "fps": np.array(FPS), "notes": np.array("[]")})
    with take.writing("field.safetensors") as path:
        path.write_bytes(b"no field")
    first = int(options[options.index("--frames") + 1].split(":")[0]) if "--frames" in options else 0
    report = {"box": [[-0.5, -0.3, -0.5], [0.7, 0.3, 0.6]], "fps": FPS, "frames": FRAMES, "material": {"density": DENSITY}}
    take.write_json("report.json", {**report, "clip": {"path": options[0], "first_frame": first}})
    asked = options[options.index("--field") + 1] if "--field" in options else "force"
    if asked != "force":
        read_as_wind(take, asked)
    given = options[1 : options.index("--take")]
    take.finish("observe", stamp_of(*given), {"clip": options[0]})
    take.finish("recover", stamp_of(*given), {"gravity": [0.0, 0.0, -3.0], "options": options})


def observe(options: list[str]) -> dict[str, object]:
    """A frame of one pixel, a place that seems to be held, and four verdicts; the result."""
    from seeing_wind.engine.take import Take

    take = Take(options[options.index("--take") + 1])
    take.write_json("asked.json", options)
    for name in ("preview.png", "held.png"):
        with take.writing(name) as path:
            path.write_bytes(PIXEL)
    verdicts = [
        {"item": "scale", "verdict": "doubtful", "severity": 0.9, "because": "No length is known.", "do": "Give one."},
        {"item": "held place", "verdict": "doubtful", "severity": 0.5, "because": "None is marked.", "do": "Give it with --pin."},
        {"item": "outline", "verdict": "good", "severity": 0.0, "because": "It lies within the box in frame 3 of the file.", "do": ""},
        {"item": "time", "verdict": "good", "severity": 0.0, "because": "The solve takes about 2 minutes on this machine.", "do": ""},
    ]
    return {"outcome": "converged", "verdicts": verdicts, "files": ["preview.png", "preview.mp4", "held.png"]}


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


PIXEL = (
    b"\x89PNG\r\n\x1a\n"
    + _chunk(b"IHDR", struct.pack(">2I5B", 1, 1, 8, 2, 0, 0, 0)) + _chunk(b"IDAT", zlib.compress(b"\0\x50\xff\x50")) + _chunk(b"IEND", b"")
)  # fmt: skip


def sample(options: list[str]) -> None:
    """The swirl, and the breeze of a take that has one."""
    from seeing_wind.engine.take import Take

    points, out = np.load(options[options.index("--points") + 1]), Path(options[options.index("--out") + 1])
    assert points.shape[0] == FRAMES and points.ndim == 3, points.shape
    arrays = {"force_density": swirl(points), "confidence": np.ones(points.shape[:2]), "distance": away(points)}
    if Take(options[0]).file("wind.safetensors").is_file():
        arrays |= {"wind_velocity": breeze(points), "wind_confidence": arrays["confidence"], "wind_distance": arrays["distance"]}
    Take(out.parent).write_arrays(out.name, arrays)


def join(options: list[str]) -> None:
    """The breeze in every take, which names all."""
    from seeing_wind.engine.take import Take

    for name in options:
        read_as_wind(Take(name), "wind")
        told = Take(name).read_json("wind.json")
        Take(name).write_json("wind.json", {**told, "joined": [Path(each).name for each in options]})


def resimulate(options: list[str]) -> None:
    """Every vertex falls with half the edit's gravity per mass factor; pinned ones stay."""
    from seeing_wind.engine.take import Take

    edit_path, out = Path(options[options.index("--edit") + 1]), Take(options[options.index("--take") + 1])
    edit = tomllib.loads(edit_path.read_text())
    for body in edit["body"]:
        if body["mesh"] == "recovered":
            mesh = {key: Take(options[0]).read_arrays("particles.npz")[f"surface.{key}"] for key in ("vertices", "triangles")}
        else:
            mesh = Take(edit_path.parent).read_arrays(body["mesh"])
        time = np.arange(edit.get("frames", FRAMES) + 1)[:, None, None] / FPS
        vertices = mesh["vertices"] + 0.5 * np.array(edit["gravity"]) * time**2 / body["mass_scale"]
        if "pin" in body:
            pinned = np.load(edit_path.parent / body["pin"])
            vertices[:, pinned] = mesh["vertices"][pinned]
        out.write_arrays(f"bodies/{body['name']}.npz", {"vertices": vertices, "triangles": mesh["triangles"], "fps": np.array(FPS)})
    out.write_json("resimulation.json", {"source": options[0], "preview": edit.get("coarseness", 1.0) > 1.0})
    out.finish("resimulate", hashlib.sha256(edit_path.read_bytes()).hexdigest()[:16], {"source": options[0], "edit": str(edit_path)})


def main() -> None:
    """Do the verb, unless another behaviour is wanted; then end as the worker does."""
    module, name, verb, *options = sys.argv[1:]
    assert (module, name) == ("-m", "seeing_wind.engine"), sys.argv
    assert not any(key.startswith("PYTHON") and key not in KNOWN for key in os.environ), "Blender's Python settings leaked"
    behaviour = os.environ.get("SEEING_WIND_FAKE", "done") if verb in ("observe", "recover", "resimulate") else "done"
    if verb == "batch":
        assert options[-1] == "--check", options
        behaviour = "flags" if os.environ.get("SEEING_WIND_FAKE") == "refused" else "done"
    if behaviour == "done":
        {"recover": recover, "sample": sample, "resimulate": resimulate, "join": join}.get(verb, lambda options: None)(options)
    if verb == "observe" and behaviour == "done":
        print(json.dumps({"type": "progress", "stage": "observe", "fraction": 0.5, "message": "following the object"}))
        print(json.dumps({"type": "result", **observe(options)}))
        return
    if verb == "doctor":
        missing = {"name": "transformers", "ok": False, "detail": "not installed", "advice": "pip install transformers", "optional": True}
        checks = [{"name": "torch", "ok": True, "detail": "CPU"}, missing]
        print(json.dumps({"type": "result", "outcome": "converged", "checks": checks}))
        return
    if verb == "sample":
        print('{"type": "result", "outcome": "converged"}')
        return
    sys.argv[1:] = [behaviour]
    runpy.run_path(str(Path(__file__).with_name("fake_worker.py")), run_name="__main__")


KNOWN = ("PYTHONPATH", "PYTHONUTF8", "PYTHONNOUSERSITE", "PYTHONSAFEPATH")

if __name__ == "__main__":
    main()
