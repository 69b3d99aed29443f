"""Names and texts by which the field's objects are known and read. Without NumPy: panels are drawn before anything is made."""

from __future__ import annotations

from typing import Any

ARROWS_MATERIAL = "Seeing Wind Arrows"

SAMPLES_MARK, LEGEND_MARK = "seeing_wind_samples", "seeing_wind_legend"
"""Custom properties of the object with the field's values, and of the arrows' legend."""

CARRIED = "seeing_wind_carried"
"""Custom property of the field object: the object with its values."""


def in_figures(value: float) -> str:
    """A strength with three figures, without a power of ten where a person would write none."""
    return f"{float(f'{value:.3g}'):.0f}" if 100.0 <= value < 1e6 else f"{value:.3g}"


def said_of_fit(field: Any) -> str:
    """How far Blender's solvers feel a field object off the recovered field, in the mean over its box; "" where it was not measured."""
    error = field.get("seeing_wind_error")
    if error is None:
        return ""
    return f"{field['seeing_wind_nodes']} nodes, feels {100.0 * error[1]:.1f} % and {error[0]:.1f}° off the recovered field"


def is_field(obj: Any) -> bool:
    """Whether an object is a recovered field: of this scene's own Recover, appended, or linked."""
    return obj is not None and "seeing_wind_density" in obj and obj.field is not None and obj.field.type == "WIND"


def field_at_hand(context: Any) -> Any:
    """The field that a selection means, else the scene's own; None when there is none."""
    candidates = (context.active_object, *context.selected_objects, context.scene.seeing_wind.field_object)
    return next((obj for obj in candidates if is_field(obj)), None)


def out_of_time(scene: Any) -> list[Any]:
    """Calibrations that were made for another frame rate than the scene has now."""
    fps = scene.render.fps / scene.render.fps_base
    listed = (each for each in scene.seeing_wind.calibrations if each.object is not None and each.field is not None)
    return [each for each in listed if abs(each.fps - fps) > 1e-3 * fps]
