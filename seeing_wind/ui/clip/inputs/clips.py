"""The clip of the settings as Blender's movie clip, and which of its frames stands at which frame of the scene."""

from __future__ import annotations

import os
from pathlib import Path

import bpy

from ....engine.errors import ClipError, UsageError
from ...job import takes
from ...user_paths import absolute, noted
from .clip_files import as_pattern, content_of, files_of, opened_by
from .pace import Pace, pace_of, set_pace

PLACED = "seeing_wind_placed"
"""Custom property of the clips that we have loaded."""


def clip_of(settings: bpy.types.PropertyGroup) -> bpy.types.MovieClip | None:
    """The movie clip of the file that the settings name, None while Blender has not loaded it."""
    return found_clip(absolute(settings.clip), settings.id_data) if settings.clip else None


def found_clip(path: str, scene: bpy.types.Scene) -> bpy.types.MovieClip | None:
    """The movie clip of a file, however its own path is written; None while Blender has not loaded it.

    Where several show the file at different frames, that of the scene.
    """
    wanted = os.path.realpath(opened_by(path))
    found = [clip for clip in bpy.data.movieclips if os.path.realpath(absolute(clip.filepath, clip.library)) == wanted]
    return scene.active_clip if scene.active_clip in found else next(iter(found), None)


def place_clip(scene: bpy.types.Scene, clip: bpy.types.MovieClip, frame: int, pace: Pace) -> bpy.types.MovieClip:
    """Let a scene show a clip at a pace, one frame of its file as the first; returns the clip that it shows.

    A clip has one place in time, whichever scene shows it: where another one shows it at other frames, this scene gets a copy, with the
    tracks and solves of the original.

    Raises:
        UsageError: for a clip of another file, whose frames would not last a scene frame each.
    """
    first, now = pace_of(clip)
    there = (now.stride, now.frame_of(frame - first)) == (pace.stride, pace.at)
    if not there and any(other.active_clip == clip for other in bpy.data.scenes if other != scene):
        clip = _show_instead(scene, clip, clip.copy())
    set_pace(clip, frame, pace)
    return clip


def _show_instead(scene: bpy.types.Scene, former: bpy.types.MovieClip, clip: bpy.types.MovieClip) -> bpy.types.MovieClip:
    """Put a clip wherever only this scene shows a former one: on cameras that no other scene has, and in the compositor."""
    cameras = [obj.data for obj in scene.objects if obj.type == "CAMERA" and obj.users_scene == (scene,)]
    tree = getattr(scene, "compositing_node_group", None) or getattr(scene, "node_tree", None)
    shows = [*(each for camera in cameras for each in camera.background_images), *(tree.nodes if tree is not None else ())]
    for each in shows:
        if getattr(each, "clip", None) == former:
            each.clip = clip
    if scene.active_clip == former:
        scene.active_clip = clip
    return clip


def follow_moved(settings: bpy.types.PropertyGroup, path: str) -> bool:
    """Whether a path is where the clip of the settings has been moved to: it has its name, and where the clip was there is none any more.

    Blender's movie clips of it follow, with their tracks, masks and solves.
    """
    former = opened_by(absolute(settings.clip)) if settings.clip else ""
    if not former or os.path.isfile(former) or os.path.basename(former) != os.path.basename(opened_by(path)):
        return False
    while (clip := found_clip(former, settings.id_data)) is not None and clip.library is None:
        clip.filepath = bpy.path.relpath(opened_by(path)) if clip.filepath.startswith("//") else opened_by(path)
    return True


def clip_of_take(settings: bpy.types.PropertyGroup, named: str, folder: Path) -> str:
    """Where the clip of a take is, which may have been moved or copied since: its original may be there still, and is another project's.

    Args:
        settings: of the scene that the take comes into.
        named: the path by which the take calls its clip.
        folder: of the take, where it is now.
    """
    written = [absolute(settings.clip)] if settings.clip else []
    beside = [os.path.join(os.path.dirname(bpy.data.filepath), os.path.basename(named))] if bpy.data.filepath else []
    # a copy of the very clip is the scene's own
    own = [each for each in written if _is_same(each, named) and os.path.isfile(opened_by(named)) and _content(each) == _content(named)]
    if settings.recovered_take and takes.shown(settings) == folder:
        own += written if settings.clip.startswith("//") else []
        former = Path(settings.recovered_take)
        if former != folder and former.drive == Path(named).drive:  # the clip stands to the take as it did before
            own = [*own, os.path.normpath(folder.parent / os.path.relpath(named, former.parent))]
    return next((each for each in (*own, named, *written, *beside) if _is_same(each, named)), named)


def _content(path: str) -> str:
    return content_of(opened_by(path))


def _is_same(candidate: str, named: str) -> bool:
    """Whether a clip that is there has the name of another one: a sequence that of its pattern, whichever frame stands for it."""
    return os.path.basename(as_pattern(candidate)) == os.path.basename(named) and os.path.isfile(opened_by(candidate))


def load_clip(path: str) -> bpy.types.MovieClip:
    """Load the movie clip of a file, and note that its place in time is ours to choose.

    Raises:
        ClipError: when Blender cannot read it.
    """
    try:
        clip = bpy.data.movieclips.load(opened_by(os.path.realpath(path)))
    except RuntimeError as error:
        if not os.path.exists(opened_by(path)):
            raise ClipError(f"There is no file {path}.", "Choose it again; it may have been moved.") from error
        raise ClipError(f"Blender cannot open {path}.", "Convert it to MP4 (H.264).") from error
    clip.filepath = noted(clip.filepath)
    clip[PLACED] = True
    return clip


def start_of(clip: bpy.types.MovieClip, clip_frame: int, otherwise: int) -> int:
    """Scene frame of a frame of a clip's file: where the user has put it, or `otherwise` for a clip that we have loaded."""
    return otherwise if clip.get(PLACED) else scene_frame(clip, clip_frame)


def loaded_clip(settings: bpy.types.PropertyGroup) -> bpy.types.MovieClip:
    """`clip_of`, loaded now if need be.

    Raises:
        ClipError: when none is chosen, or Blender cannot read it.
    """
    clip = clip_of(settings)
    if not settings.clip:
        raise ClipError("No clip is chosen.", "Choose one first.")
    if clip is None:
        clip = load_clip(absolute(settings.clip))
    if clip.size[0] < 1 or clip.frame_duration < 1:
        raise ClipError(f"{clip.filepath} has no frames that Blender can read.", "Convert it to MP4 (H.264).")
    return clip


def first_clip_frame(settings: bpy.types.PropertyGroup) -> int:
    """Index in the file of the first frame that is used."""
    return settings.frames[0] if settings.use_frames else 0


def scene_frame(clip: bpy.types.MovieClip, clip_frame: int) -> int:
    """Scene frame at which Blender shows a frame of the clip's file."""
    first, pace = pace_of(clip)
    return pace.frame_of(clip_frame - first)


def marker_frame(clip: bpy.types.MovieClip, clip_frame: int) -> int:
    """Frame number by which the clip's markers and solved cameras call a frame of its file."""
    return clip_frame - clip.frame_offset + 1


def check_film(clip: bpy.types.MovieClip | None) -> None:
    """UsageError for a clip without its file: Blender renders nothing in its place."""
    path = absolute(clip.filepath, clip.library) if clip is not None else ""
    if clip is not None and not Path(path).is_file():
        raise UsageError(f"There is no file {path}.", "Put it back, or choose the clip again.")


def is_footage(path: Path) -> bool:
    """Whether a file is what a movie clip or an image of this .blend shows."""
    shown = [(clip, opened_by(absolute(clip.filepath, clip.library))) for clip in bpy.data.movieclips if clip.filepath]
    films = [file for clip, film in shown for file in (files_of(film) if clip.source == "SEQUENCE" else [Path(film)])]
    images = [Path(absolute(each.filepath, each.library)) for each in bpy.data.images if each.filepath and each.users]
    wanted = os.path.realpath(path)
    return any(os.path.realpath(each) == wanted for each in (*films, *images))


def refuse_footage(path: Path) -> None:
    """UsageError for a file to be written that is footage: it would be lost."""
    if is_footage(path):
        raise UsageError(f"{path} is footage that this file shows; rendering into it would destroy it.", "Render into another file.")
