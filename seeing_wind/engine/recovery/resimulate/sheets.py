"""Open meshes of thin materials as shells: which bodies become shells, and their simulation."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...conventions import weight_in_words
from ...errors import UsageError
from ...materials import DEFAULT, PLASTIC_LAWS, SHEET_UNITS, SHEETS, Sheet, adjust, find
from ...mpm.lattice.closed_mesh import is_closed, triangle_areas, weld
from ...mpm.shell import Load, Shell, State, advance_frame, at_rest, obstacles_of, shell_of, substeps_for, surface_of
from ...progress import Journal, Progress
from ...records import Body, Recovery
from ...settings import BodyEdit
from ..journal import Arrays
from ..wind.drag import vertex_drag
from .coarser import Ridden, coarser_sheet
from .fill import connected_parts
from .forces import Push
from .in_field import Surroundings
from .pins import read_pin_path, read_pins, read_weights, squared_frequency
from .voxels import enclosed_room


@dataclass(frozen=True)
class Hanging:
    """A shell before the simulation."""

    edit: BodyEdit
    shell: Shell
    velocity: np.ndarray
    """(3,) or (V, 3) velocity when it starts [m/s]."""
    vertex: np.ndarray
    """(W,) for each vertex of the mesh, its vertex in the shell, or in the sheet that rides on it; vertices at the same place are one."""
    triangles: np.ndarray
    """(M, 3) triangles of the mesh."""
    path: np.ndarray | None = None
    """(T+1, P, 3) path of the pinned vertices [m]; None if they keep their places."""
    ridden: Ridden | None = None
    """For a preview in which the shell is coarser than the mesh: how the mesh's vertices ride on it."""

    @property
    def notes(self) -> list[str]:
        """Notes for the user."""
        area = float(self.shell.surface.area.sum())
        said = [f"simulated as a shell of {weight_in_words(float(self.shell.mass.sum()) / area, area)} in all"]
        if self.ridden is not None:
            said.append(
                f"a preview with {len(self.ridden.used)} of its {len(self.ridden.corners)} vertices: fluttering cloth soon moves "
                "differently from the full result, within a second by half its motion and more, so do not judge single folds by it"
            )
        return said

    def follow(self, x: np.ndarray) -> np.ndarray:
        """Positions (T+1, W, 3) [m] of the mesh's vertices for those of the shell at x (T+1, V, 3) [m]."""
        return (x if self.ridden is None else self.ridden.follow(x))[:, self.vertex]


def is_shell(body: BodyEdit, vertices: np.ndarray, triangles: np.ndarray) -> bool:
    """Whether a body is simulated as a shell: as the edit states, else if its material is known as a sheet and its mesh encloses nothing.

    Raises:
        UsageError: for numbers that only a shell has, given for a body that is not a shell.
    """
    if body.shell is not None:
        shell = body.shell
    elif find(body.material or DEFAULT).name not in SHEETS:
        shell = False
    else:
        sewn = weld(vertices, triangles)
        parts = connected_parts(sewn, len(vertices))
        shell = not any(is_closed(sewn[parts == part]) for part in range(parts.max() + 1)) and enclosed_room(vertices, triangles) is None
    given = [name for name in SHEET_UNITS if getattr(body, name) is not None]
    if given and not shell:
        raise UsageError(
            f"{body.name}: {' and '.join(given)} is given, but it is no shell: its mesh is closed, or its material is not a sheet.",
            "Leave it out, or set shell = true.",
        )
    return shell


def enter(
    body: BodyEdit, vertices: np.ndarray, triangles: np.ndarray, base_dir: Path, frames: int, coarseness: float = 1.0
) -> Hanging:
    """The shell of a body, in a field of `frames` frames; with a coarseness above 1 it has fewer vertices than its mesh.

    Raises:
        UsageError: for a mesh that is not a sheet, see `shell.surface_of`, or a material without the numbers of a sheet.
    """
    sewn = weld(vertices, triangles)
    used, first, vertex = np.unique(weld(vertices, np.arange(len(vertices))), return_index=True, return_inverse=True)
    faces = np.searchsorted(used, sewn)
    area = float(triangle_areas(vertices, triangles)[0].sum())
    pinned, spring, way = np.zeros(len(used), dtype=bool), np.zeros(len(used)), None
    if body.pin is not None:
        path = base_dir / body.pin
        pins = read_pins(path, len(vertices), "vertices")
        weights = np.ones(len(pins)) if body.pin_weights is None else read_weights(base_dir / body.pin_weights, path)
        hold = np.zeros(len(used))
        np.maximum.at(hold, vertex.ravel()[pins], weights)
        pinned = hold >= 1.0
        spring = np.where(pinned, 0.0, squared_frequency(hold))
        if body.pin_path is not None:
            every = np.zeros((frames + 1, len(used), 3))
            every[:, vertex.ravel()[pins]] = read_pin_path(base_dir / body.pin_path, path, frames)
            way = every[:, pinned]
    x, ridden, sheet = vertices[first], None, sheet_of(body, area)
    try:
        surface = surface_of(x, faces)
        ridden = coarser_sheet(x, surface.faces, pinned | (spring > 0.0), coarseness)
        if ridden is not None:
            way = None if way is None else way[:, np.isin(np.flatnonzero(pinned), ridden.used)]
            x, faces, pinned, spring = x[ridden.used], ridden.faces, pinned[ridden.used], spring[ridden.used]
        shell = shell_of(x, faces, sheet, pinned=pinned, spring=spring)
    except UsageError as error:
        raise UsageError(f"{body.name}: {error.message}", error.hint) from error
    velocity = np.zeros(3) if body.velocity is None else np.asarray(body.velocity, dtype=np.float64)
    return Hanging(body, shell, velocity, vertex.ravel(), triangles, way, ridden)


def enter_recovered(body: BodyEdit, filmed: Body, recovery: Recovery, base_dir: Path) -> Hanging:
    """The clip's own sheet with the changes of the edit. What was held in the clip is held still, unless the edit frees it.

    Raises:
        UsageError: for pins that the sheet does not have, or an edit that asks for a solid.
    """
    if body.shell is False:
        raise UsageError(f"{body.name}: the recovered object is a sheet.", "Leave shell = false out, or give a mesh.")
    x, faces = filmed.surface.vertices, filmed.surface.triangles.astype(np.int64)
    pinned, hold = filmed.particles.pinned.copy(), np.zeros(len(x))
    if body.free is not None:
        pinned[read_pins(base_dir / body.free, len(x), "particles")] = False
    if body.pin is not None:
        path = base_dir / body.pin
        pins = read_pins(path, len(x), "particles")
        hold[pins] = 1.0 if body.pin_weights is None else read_weights(base_dir / body.pin_weights, path)
    pinned |= hold >= 1.0
    spring = np.where(pinned, 0.0, squared_frequency(hold))
    known = None if body.material is not None else filmed.sheet
    area = float(triangle_areas(x, faces)[0].sum())
    shell = shell_of(x, faces, sheet_of(body, area, known), pinned=pinned, spring=spring)
    velocity = recovery.v0 if body.velocity is None else np.asarray(body.velocity, dtype=np.float64)
    return Hanging(body, shell, velocity, np.arange(len(x)), filmed.surface.triangles)


def sheet_of(body: BodyEdit, area: float, filmed: Sheet | None = None) -> Sheet:
    """The sheet of a body whose mesh has the given area [m²]: that of the material, or the filmed one, with the body's own numbers.

    A density or a mass determines the areal density; Young's modulus determines both stiffnesses, as for a homogeneous plate.

    Raises:
        UsageError: for missing numbers, or a plastic law. MaterialError: for numbers that are not physical.
    """
    material = find(body.material or DEFAULT) if filmed is None else filmed.as_solid("the recovered object")
    if (body.law or material.law) in PLASTIC_LAWS or body.yield_stress is not None:
        raise UsageError(f"{body.name}: a sheet is elastic: it has no plastic law.", "Set shell = false, or give an elastic material.")
    names = ("density", "youngs_modulus", "poisson_ratio", "loss_factor")
    material = adjust(material, **{name: getattr(body, name) for name in names})
    own: dict[str, Any] = {name: getattr(body, name) for name in SHEET_UNITS if getattr(body, name) is not None}
    known = SHEETS.get(material.name) if filmed is None else filmed
    missing = [] if known is not None else [name for name in SHEET_UNITS if name not in own]
    if missing:
        raise UsageError(
            f"{body.name}: {material.name} is not known as a sheet; {', '.join(missing)} {'are' if len(missing) > 1 else 'is'} missing.",
            f"Give them, or one of the materials {', '.join(sorted(SHEETS))}.",
        )
    if known is None or body.loss_factor is not None:
        own["loss_factor"] = material.loss_factor
    own["poisson_ratio"] = max(material.poisson_ratio, 0.0)
    sheet = Sheet(**own) if known is None else dataclasses.replace(known, **own)
    sheet = sheet.with_own(body.density, body.youngs_modulus, None)
    areal = sheet.areal_density if body.mass is None else body.mass / area
    softer = body.youngs_modulus_scale
    return dataclasses.replace(
        sheet, areal_density=areal * body.mass_scale, tensile_stiffness=sheet.tensile_stiffness * softer,
        bending_stiffness=sheet.bending_stiffness * softer,
    )  # fmt: skip


def push_of_field(shell: Shell, force: np.ndarray, gradient: np.ndarray, x: np.ndarray) -> Load:
    """A field's load during a frame, from force density (V, 3) [N/m³] and gradient (V, 3, 3) [N/m⁴] at x (V, 3) [m] at the frame's start.

    The field is a force per volume of the filmed body; on a sheet it acts on the sheet's own volume.
    """
    volume = (shell.mass / shell.sheet.areal_density * shell.sheet.thickness)[:, None]
    return lambda now, v, frame: (volume * (force + np.einsum("vij,vj->vi", gradient, now - x)), None)


def and_wind(load: Load, shell: Shell, wind: np.ndarray) -> Load:
    """A load without damping plus the drag during a frame of air with the velocity `wind` (V, 3) [m/s] at the vertices (`wind.drag`)."""

    def both(now: np.ndarray, v: np.ndarray, frame: int) -> tuple[np.ndarray, np.ndarray]:
        drag, damping = vertex_drag(wind, now, v, shell.surface.faces)
        return load(now, v, frame)[0] + drag, damping

    return both


def and_further(load: Load, shell: Shell, push: Push) -> Load:
    """A load plus further forces, which during the frame change with the velocity only; each vertex gets its share by mass."""
    share = shell.mass / shell.mass.sum()

    def both(now: np.ndarray, v: np.ndarray, frame: int) -> tuple[np.ndarray, np.ndarray | None]:
        force, damping = load(now, v, frame)
        slowed = (share * push.damping(v))[:, None, None] * np.eye(3)
        return force + share[:, None] * push.on(v), slowed if damping is None else damping + slowed

    return both


def move(
    hanging: Hanging, around: Surroundings, progress: Progress, begun: float, share: float, journal: Journal
) -> np.ndarray:
    """Positions (T+1, V, 3) [m] of the shell's vertices."""
    shell, edit, field = hanging.shell, hanging.edit, around.field
    obstacles = obstacles_of(around.colliders, shell.surface.edge_length)
    substeps, downward = substeps_for(field.fps, around.coarseness), np.asarray(around.gravity, dtype=np.float64)
    dt = 1.0 / (field.fps * substeps)
    state, history = at_rest(shell), [shell.surface.x]
    told = [edit, shell.surface.x, shell.surface.faces, shell.sheet, shell.pinned, shell.spring, hanging.path]
    loop = journal.loop("frames", *around.told(), *told)
    done, kept = loop.resume()
    if done:
        history, state = list(kept["x"]), State(kept["x"][-1], kept["v"], kept["x_before"], kept["v_before"])
    for t in range(done, around.frames):
        progress.update(begun + share * t / around.frames, f"frame {t + 1} of {around.frames}: {edit.name}")
        if t >= edit.start_frame:
            load = push_of_field(shell, *around.force(t, state.x), state.x)
            if around.blows:
                load = and_wind(load, shell, around.wind(t, state.x))
            if around.forces is not None:
                load = and_further(load, shell, around.forces.at(state.x, t))
            if t == edit.start_frame:
                first = downward + load(state.x, state.v, t)[0] / shell.mass[:, None]
                state = at_rest(shell, np.broadcast_to(hanging.velocity, state.x.shape), first, dt=dt)
            state = advance_frame(
                shell, state, frame=t, fps=field.fps, substeps=substeps, gravity=downward, load=load, pin_path=hanging.path,
                obstacles=obstacles,
            )  # fmt: skip
        history.append(state.x)
        loop.reached(t + 1, partial(_so_far, history, state))
    return np.stack(history)


def _so_far(history: list[np.ndarray], state: State) -> Arrays:
    return {"x": np.stack(history), "v": state.v, "x_before": state.x_before, "v_before": state.v_before}
