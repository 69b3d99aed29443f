"""Small textures of one color each that follow the scene: the current frame, and the rotation of the field object.

Blender caches the numbers in texture nodes, but evaluates a texture that a node refers to every time. So what changes is stored in the
color of such a texture, driven by plain arithmetic, which needs no permission to run scripts.
"""

from __future__ import annotations

from dataclasses import dataclass

import bpy

from ..display import LOOP, STRIDE

COLOR = "color_ramp.elements[0].color"
"""Path of such a texture's color, whose components Blender clamps at 0."""

ROWS = (
    ("1-2*(y*y+z*z)", "2*(x*y-w*z)", "2*(x*z+w*y)"),
    ("2*(x*y+w*z)", "1-2*(x*x+z*z)", "2*(y*z-w*x)"),
    ("2*(x*z-w*y)", "2*(y*z+w*x)", "1-2*(x*x+y*y)"),
)
"""The rotation matrix of a unit quaternion."""


@dataclass(frozen=True)
class Followers:
    """Textures of one color each."""

    clock: bpy.types.Texture
    """Red is the height of the current frame in the image."""
    axes: tuple[bpy.types.Texture, ...]
    """Columns of the rotation matrix, plus 1."""
    base: bpy.types.Texture
    """1 minus half the sum of the rotation matrix's columns."""

    @property
    def all(self) -> tuple[bpy.types.Texture, ...]:
        """Every one of them."""
        return (self.clock, *self.axes, self.base)


def make_followers(field: bpy.types.Object, frames: int, height: float, delay: int) -> Followers:
    """Make the textures that follow a field object with `frames` frames.

    Args:
        height: of one frame in the image of all frames.
        delay: 1 for what solvers feel: they step *to* a frame, so it shows what acts in the middle of the step to it.
    """
    at = f"((ceil(frame)-{0.5 * delay}-first)/lasts+0.0001)"
    shown = f"{height!r}*floor(min(max({at}-loops*{frames}*floor({at}/{frames}),0),{frames - 1}))"
    clock = _one_color(f"{field.name} Frame")
    for name, key in (("first", "seeing_wind_frame_start"), ("lasts", STRIDE), ("loops", LOOP)):
        _property(_driver(clock, 0, shown), name, field, f'["{key}"]')
    axes = tuple(_turned(field, f"{field.name} {'XYZ'[k]}", [f"1+({ROWS[i][k]})" for i in range(3)]) for k in range(3))
    base = _turned(field, f"{field.name} Turned", [f"1-0.5*({'+'.join(f'({entry})' for entry in row)})" for row in ROWS])
    return Followers(clock, axes, base)


def _one_color(name: str) -> bpy.types.Texture:
    texture = bpy.data.textures.new(name, "BLEND")
    texture.use_color_ramp = True
    elements = texture.color_ramp.elements
    while len(elements) > 1:
        elements.remove(elements[-1])
    return texture


def _driver(texture: bpy.types.Texture, channel: int, expression: str) -> bpy.types.Driver:
    driver = texture.driver_add(COLOR, channel).driver
    driver.expression = expression
    return driver


def _property(driver: bpy.types.Driver, name: str, obj: bpy.types.ID, path: str) -> None:
    variable = driver.variables.new()
    variable.name, variable.targets[0].id, variable.targets[0].data_path = name, obj, path


def _turned(field: bpy.types.Object, name: str, expressions: list[str]) -> bpy.types.Texture:
    """A texture whose color follows the rotation of an object in the world."""
    texture = _one_color(name)
    for channel, expression in enumerate(expressions):
        driver = _driver(texture, channel, expression)
        for part in "wxyz":
            variable = driver.variables.new()
            variable.name, variable.type = part, "TRANSFORMS"
            target = variable.targets[0]
            target.id, target.transform_type, target.transform_space = field, f"ROT_{part.upper()}", "WORLD_SPACE"
            target.rotation_mode = "QUATERNION"
    return texture
