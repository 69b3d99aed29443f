"""The Blender part of film.py: titles and three films side by side, in the sequencer, as H.264.

    python film_scene.py OUT.mp4 '[[TITLE, CLIP, FORCES, EDIT], ...]'
"""

from __future__ import annotations

import json
import sys

import bpy

WIDTH, HEIGHT, SLOT = 1920, 540, 640
"""Of the film, and of the column for each of the three [px]."""
FPS = 12
"""Frames a second: the clips have 24 to 30, so the film is in slow motion."""
TWICE, TITLE = 2, 30
"""How often a scene is shown, and how many frames the title lasts."""
COLUMNS = ("the clip", "the recovered forces", "an edit over the clip")
GROUND, INK = (0.02, 0.022, 0.028), (0.92, 0.92, 0.9, 1.0)


def main(out: str, parts: list[list[str]]) -> None:
    """Lay out and render."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    editor = scene.sequence_editor_create()
    strips = editor.strips if hasattr(editor, "strips") else editor.sequences
    text(strips, "Seeing Wind", 1, TITLE, 0.56, 72)
    text(strips, "forces that nobody sees, recovered from what they move", 1, TITLE, 0.38, 30)
    frame = 1 + TITLE
    for title, *films in parts:
        for _ in range(TWICE):
            frame += shown(strips, title, films, frame)
    render(scene, out, frame - 1)


def shown(strips, title: str, films: list[str], frame: int) -> int:
    """Three films from a frame on; returns how long they last [frames]."""
    made = []
    for column, film in enumerate(films):
        strip = strips.new_movie(f"{title} {column}", film, 1 + column, frame, fit_method="ORIGINAL")
        across, up = strip.elements[0].orig_width, strip.elements[0].orig_height
        if not across or not up:
            raise SystemExit(f"film: {film} is no video that Blender can read; make it again")
        size = min(SLOT / across, 360 / up)
        strip.transform.scale_x = strip.transform.scale_y = size
        strip.transform.offset_x, strip.transform.offset_y = (column - 1) * SLOT, -10
        strip.blend_type = "ALPHA_OVER"
        made.append(strip)
    last = min(strip.frame_final_end for strip in made)
    for strip in made:
        strip.frame_final_end = last
    text(strips, title, frame, last - frame, 0.925, 40)
    for column, name in enumerate(COLUMNS):
        text(strips, name, frame, last - frame, 0.07, 26, (column + 0.5) / 3.0)
    return last - frame


def text(strips, words: str, frame: int, length: int, up: float, size: int, across: float = 0.5) -> None:
    """Words in the middle of a place, in shares of the frame."""
    channel = next(k for k in range(4, 32) if not any(each.channel == k and each.frame_final_end > frame for each in strips))
    span = {"length": length} if bpy.app.version >= (5, 0, 0) else {"frame_end": frame + length}
    strip = strips.new_effect(words, "TEXT", channel, frame, **span)
    strip.text, strip.font_size, strip.color, strip.location = words, size, INK, (across, up)
    strip.anchor_x, strip.anchor_y = "CENTER", "CENTER"
    strip.blend_type = "ALPHA_OVER"


def render(scene, out: str, last: int) -> None:
    """Over a dark ground."""
    frames = scene.render
    frames.resolution_x, frames.resolution_y, frames.resolution_percentage = WIDTH, HEIGHT, 100
    frames.fps, frames.fps_base, scene.frame_start, scene.frame_end = FPS, 1.0, 1, last
    scene.view_settings.view_transform = "Standard"
    editor = scene.sequence_editor
    strips = editor.strips if hasattr(editor, "strips") else editor.sequences
    for strip in strips:  # the ground goes below all
        strip.channel += 1
    span = {"length": last} if bpy.app.version >= (5, 0, 0) else {"frame_end": 1 + last}
    strips.new_effect("Ground", "COLOR", 1, 1, **span).color = GROUND
    image, ffmpeg = frames.image_settings, frames.ffmpeg
    if hasattr(image, "media_type"):  # from Blender 5.0
        image.media_type = "VIDEO"
    image.file_format = "FFMPEG"
    ffmpeg.format, ffmpeg.codec, ffmpeg.audio_codec = "MPEG4", "H264", "NONE"
    ffmpeg.constant_rate_factor, ffmpeg.ffmpeg_preset, ffmpeg.gopsize = "HIGH", "GOOD", FPS
    frames.filepath, frames.use_file_extension, frames.use_sequencer, frames.use_compositing = out, False, True, False
    bpy.ops.render.render(animation=True)


if __name__ == "__main__":
    words = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    main(words[0], json.loads(words[1]))
