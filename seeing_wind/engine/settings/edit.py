"""Settings of the stage *resimulate*, which are the keys of edit.toml: bodies, colliders, and the fields that the bodies move in."""

from __future__ import annotations

from dataclasses import dataclass

from ..conventions import GRAVITY
from ..materials import DEFAULT, MOST_LOSS
from .build import material_options
from .option import option

OF_A_BODY = material_options("")

MESHES = (".obj", ".ply", ".npz")
"""Endings of the files that a mesh may be read from."""


@dataclass(frozen=True)
class BodyEdit:
    """One body of an edit; see `engine/stages.py` resimulate."""

    name: str = option(help="name of the body, and of its file in the take", panel="")
    mesh: str = option(
        help='OBJ, PLY, or NPZ with vertices (V,3) m and triangles (M,3); or "recovered": the object of the clip', file=True, panel=""
    )
    material: str | None = option(
        None, help="a preset of the material library", otherwise=f"the recovered one for the recovered object, {DEFAULT} for a mesh",
        panel="main",
    )  # fmt: skip
    density: float | None = OF_A_BODY["density"]
    youngs_modulus: float | None = OF_A_BODY["youngs_modulus"]
    poisson_ratio: float | None = OF_A_BODY["poisson_ratio"]
    law: str | None = OF_A_BODY["law"]
    yield_stress: float | None = OF_A_BODY["yield_stress"]
    viscosity: float | None = OF_A_BODY["viscosity"]
    loss_factor: float | None = option(
        None, help="damping: energy lost per radian of oscillation over the energy stored; elastic laws only", minimum=0.0,
        maximum=MOST_LOSS, otherwise="the material's", panel="", digits=3,
    )  # fmt: skip
    mass: float | None = option(
        None, help="mass of the whole body, instead of a density", unit="kg", minimum=1e-9, maximum=1e9, panel="main",
        otherwise="from the density", start=0.1, typical=(None, 1000.0), digits=6,
    )  # fmt: skip
    mass_scale: float = option(
        1.0, label="Mass Factor", help="factor on the mass: 2 doubles it and halves the acceleration in the same force field", above=0.0,
        panel="main", typical=(None, 100.0), digits=3,
    )  # fmt: skip
    youngs_modulus_scale: float = option(
        1.0, label="Stiffness Factor", identifier="stiffness_scale", help="factor on Young's modulus: 2 is twice as stiff", above=0.0,
        panel="main", typical=(None, 100.0), digits=3,
    )  # fmt: skip
    pin: str | None = option(
        None, help="NPY of the indices of vertices that are held; of particles for the recovered object", file=True, panel=""
    )
    pin_weights: str | None = option(
        None, otherwise="all hold firmly", file=True, panel="",
        help="NPY of one weight in 0..1 per index of `pin`: 1 holds firmly, less draws back like a spring (0.5: about 4 swings a second)",
    )  # fmt: skip
    pin_path: str | None = option(
        None, help="NPY (T+1,P,3) of the positions of the vertices of `pin` in every frame", unit="m", otherwise="they stay",
        file=True, panel="",
    )  # fmt: skip
    free: str | None = option(
        None, help="NPY of particle indices of the recovered object that are held in the clip and let go here", file=True, panel=""
    )
    velocity: tuple[float, float, float] | None = option(
        None, help="velocity at the start", unit="m/s", otherwise="rest for a mesh, the recovered one for the recovered object",
        panel="main", start=(0.0, 0.0, 0.0), typical=(-20.0, 20.0),
    )  # fmt: skip
    start_frame: int = option(
        0, label="Start Frame", help="the body stands still before this frame of the clip", minimum=0, panel="main"
    )
    shell: bool | None = option(
        None, help="whether the body is a thin shell", otherwise="a shell if its mesh is open and its material comes as a sheet", panel=""
    )
    areal_density: float | None = option(
        None, help="mass of a shell over its area", unit="kg/m²", minimum=1e-4, maximum=1e4, otherwise="the material's", panel="main",
        digits=4, start=0.12, typical=(None, 2.0),
    )
    thickness: float | None = option(
        None, help="thickness of a shell", unit="m", minimum=1e-6, maximum=1.0, otherwise="the material's", panel="main",
        digits=5, start=3e-4, typical=(None, 0.01),
    )
    tensile_stiffness: float | None = option(
        None, label="Stretching", help="force over width and strain of a shell", unit="N/m", above=0.0, otherwise="the material's",
        panel="main", digits=1, start=1e4,
    )  # fmt: skip
    bending_stiffness: float | None = option(
        None, label="Bending", help="bending moment over width and curvature of a shell", unit="N m", above=0.0,
        otherwise="the material's", panel="main", digits=6, start=1e-5, typical=(None, 0.01),
    )  # fmt: skip


@dataclass(frozen=True)
class ColliderEdit:
    """A collider, which the bodies run into and do not move: a mesh or a plane."""

    name: str = option(help="name of the collider, in messages", panel="")
    mesh: str | None = option(None, help="a closed OBJ, PLY or NPZ; bodies stay outside", file=True, panel="")
    mesh_path: str | None = option(
        None, help="NPY (T+1,V,3) of the positions of the mesh's vertices in every frame", unit="m", otherwise="they stay",
        file=True, panel="",
    )  # fmt: skip
    plane: tuple[float, float, float, float, float, float] | None = option(
        None, help="a point (m) and the normal of an infinite plane; bodies stay on the side that the normal points to", panel=""
    )
    kind: str = option(
        "separate", label="Contact", help="what happens at its surface", panel="main",
        choices={
            "separate": "bodies slide on it with friction and may lift off", "slip": "bodies slide on it with friction and never lift off",
            "sticky": "what touches it stays",
        },
    )  # fmt: skip
    friction: float = option(
        0.3, help="Coulomb's coefficient: 0 is ice, 1 is rubber; for separate and slip", minimum=0.0, panel="main", typical=(None, 1.0)
    )


@dataclass(frozen=True)
class FieldEdit:
    """A further field that acts beside that of the take: forces add up, and so do the velocities of winds."""

    file: str = option(
        help="field.safetensors or wind.safetensors of another take, with the same frame rate and at least as many frames", file=True,
        panel="",
    )  # fmt: skip
    name: str | None = option(None, help="name of this field in messages", otherwise="its file", panel="")
    strength: float | tuple[float, ...] = option(1.0, help="factor on this field, or one factor per frame", panel="")
    place: str | None = option(
        None, otherwise="where it was recovered", file=True, panel="", help="NPY (T,4,4) of its place in every frame, as `field_place`"
    )
    fade: float | None = option(None, unit="m", above=0.0, panel="", otherwise="no fading", help="as the edit's `fade`, for this field")
    falloff: tuple[float, float] | None = option(
        None, help="as the edit's `falloff`, for this field", panel="", otherwise="it does not weaken"
    )


@dataclass(frozen=True)
class Edit:
    """What to simulate in a recovered field."""

    body: tuple[BodyEdit, ...]
    collider: tuple[ColliderEdit, ...] = ()
    further_field: tuple[FieldEdit, ...] = ()
    gravity: tuple[float, float, float] = option(
        GRAVITY, identifier="edit_gravity", help="acceleration along world X, Y, Z in the re-simulation", unit="m/s²", one_of="gravity",
        panel="main", typical=(-20.0, 20.0),
    )  # fmt: skip
    field_strength: float | tuple[float, ...] = option(
        1.0, help="factor on the recovered field, or one factor per frame", panel="", typical=(-5.0, 5.0)
    )
    field: str | None = option(
        None, identifier="edit_field", help="which of the take's fields moves the bodies", otherwise="recovered", panel="main",
        choices={"force": "the body force in N/m³", "wind": "the wind in m/s, by the bodies' own surface and speed"},
    )  # fmt: skip
    field_place: str | None = option(
        None, otherwise="where it was recovered", file=True, panel="",
        help="NPY (T,4,4) of the field's place in every frame: matrices from its own coordinates (m) to the world's",
    )  # fmt: skip
    fade: float | None = option(
        None, unit="m", above=0.0, panel="", metavar="M", otherwise="no fading; outside the box, the value at its edge",
        help="distance from the clip's object, at its place in each frame, over which the field fades to nothing; outside its box it also "
        "fades over the same distance from the box",
    )  # fmt: skip
    falloff: tuple[float, float] | None = option(
        None, help="a (m) and p, instead of a fade: (a / (a + d)) ** p of the field is left at a distance d from its box", panel="",
        otherwise="the field does not weaken",
    )  # fmt: skip
    forces: str | None = option(
        None, otherwise="none", file=True, panel="",
        help="NPZ of further forces on the bodies, on a lattice: box (2,3) m and force (T,A,B,C,3) N on a whole body",
    )  # fmt: skip
    preroll: int = option(
        0, label="Pre-roll", identifier="edit_preroll", panel="main", minimum=0, typical=(None, 100),
        help="frames for which bodies settle, in the wind of the first frame, before the clip begins",
    )  # fmt: skip
    contact: bool = option(False, help="all bodies share one grid and push each other; otherwise each moves alone", panel="main")
    coarseness: float = option(
        1.0, minimum=1.0, maximum=4.0, panel="",
        help="factor on the spacing of a mesh's particles, and on the length of substeps; above 1 the result is a preview",
    )  # fmt: skip
    frames: int | None = option(
        None, help="how many of the clip's frames are simulated, from the first; fewer make a preview", minimum=1, otherwise="all", panel=""
    )
