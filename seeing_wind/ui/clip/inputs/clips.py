"""The clip of the settings as Blender's movie clip, and which scene frame shows which of its frames."""

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
"""Custom property of the movie clips that we loaded."""


def clip_of(settings: bpy.types.PropertyGroup) -> bpy.types.MovieClip | None:
    """The movie clip of the file in the settings; None while Blender has not loaded it."""
    return found_clip(absolute(settings.clip), settings.id_data) if settings.clip else None


def found_clip(path: str, scene: bpy.types.Scene) -> bpy.types.MovieClip | None:
    """The movie clip of a file, whatever form its stored path has; None while Blender has not loaded it.

    If several movie clips show the file, the scene's active one is preferred.
    """
    wanted = os.path.realpath(opened_by(path))
    found = [clip for clip in bpy.data.movieclips if os.path.realpath(absolute(clip.filepath, clip.library)) == wanted]
    return scene.active_clip if scene.active_clip in found else next(iter(found), None)


def place_clip(scene: bpy.types.Scene, clip: bpy.types.MovieClip, frame: int, pace: Pace) -> bpy.types.MovieClip:
    """Make a scene show a clip at a pace, beginning with `frame` of its file. Returns the movie clip that the scene then shows.

    A movie clip has the same timing in all scenes. If it is also active in another scene and its timing must change, this scene gets a
    copy, with the original's tracks and solves.

    Raises:
        UsageError: for a clip linked from another .blend file, if its frames would not last one scene frame each.
    """
    first, now = pace_of(clip)
    there = (now.stride, now.frame_of(frame - first)) == (pace.stride, pace.at)
    if not there and any(other.active_clip == clip for other in bpy.data.scenes if other != scene):
        clip = _show_instead(scene, clip, clip.copy())
    set_pace(clip, frame, pace)
    return clip


def _show_instead(scene: bpy.types.Scene, former: bpy.types.MovieClip, clip: bpy.types.MovieClip) -> bpy.types.MovieClip:
    """Replace a movie clip wherever only this scene shows it: on cameras in no other scene, and in the compositor."""
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
    """Whether the clip of the settings has been moved to `path`: the name is the same, and its old file no longer exists.

    If so, Blender's movie clips of the file are set to the new path, and keep their tracks, masks and solves.
    """
    former = opened_by(absolute(settings.clip)) if settings.clip else ""
    if not former or os.path.isfile(former) or os.path.basename(former) != os.path.basename(opened_by(path)):
        return False
    while (clip := found_clip(former, settings.id_data)) is not None and clip.library is None:
        clip.filepath = bpy.path.relpath(opened_by(path)) if clip.filepath.startswith("//") else opened_by(path)
    return True


def clip_of_take(settings: bpy.types.PropertyGroup, named: str, folder: Path) -> str:
    """Present path of a take's clip, which may have been moved or copied with its project; the original may still exist elsewhere.

    Args:
        settings: of the scene that loads the take.
        named: path of the clip in the take's records.
        folder: present folder of the take.
    """
    written = [absolute(settings.clip)] if settings.clip else []
    beside = [os.path.join(os.path.dirname(bpy.data.filepath), os.path.basename(named))] if bpy.data.filepath else []
    # the scene's own clip, if it is a copy of the take's
    own = [each for each in written if _is_same(each, named) and os.path.isfile(opened_by(named)) and _content(each) == _content(named)]
    if settings.recovered_take and takes.shown(settings) == folder:
        own += written if settings.clip.startswith("//") else []
        former = Path(settings.recovered_take)
        if former != folder and former.drive == Path(named).drive:  # the clip's path relative to the take is unchanged
            own = [*own, os.path.normpath(folder.parent / os.path.relpath(named, former.parent))]
    return next((each for each in (*own, named, *written, *beside) if _is_same(each, named)), named)


def _content(path: str) -> str:
    return content_of(opened_by(path))


def _is_same(candidate: str, named: str) -> bool:
    """Whether a clip exists and has the name of another; a sequence counts by the name of its pattern, whichever image the path names."""
    return os.path.basename(as_pattern(candidate)) == os.path.basename(named) and os.path.isfile(opened_by(candidate))


def load_clip(path: str) -> bpy.types.MovieClip:
    """Load the movie clip of a file, and mark it as ours, so that we may change its timing.

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
    """Scene frame of frame `clip_frame` of a clip's file: as the user placed the clip, or `otherwise` for a clip that we loaded."""
    return otherwise if clip.get(PLACED) else scene_frame(clip, clip_frame)


def loaded_clip(settings: bpy.types.PropertyGroup) -> bpy.types.MovieClip:
    """`clip_of`, loaded now if necessary.

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
    """Index in the clip's file of the first frame used."""
    return settings.frames[0] if settings.use_frames else 0


def scene_frame(clip: bpy.types.MovieClip, clip_frame: int) -> int:
    """Scene frame at which Blender shows a frame of the clip's file."""
    first, pace = pace_of(clip)
    return pace.frame_of(clip_frame - first)


def marker_frame(clip: bpy.types.MovieClip, clip_frame: int) -> int:
    """Frame number of a frame of the clip's file in its markers and solved cameras."""
    return clip_frame - clip.frame_offset + 1


def check_film(clip: bpy.types.MovieClip | None) -> None:
    """Raise UsageError if the clip's file is missing: Blender would render nothing in its place."""
    path = absolute(clip.filepath, clip.library) if clip is not None else ""
    if clip is not None and not Path(path).is_file():
        raise UsageError(f"There is no file {path}.", "Put it back, or choose the clip again.")


def is_footage(path: Path) -> bool:
    """Whether a movie clip or an image of this .blend file shows the file `path`."""
    shown = [(clip, opened_by(absolute(clip.filepath, clip.library))) for clip in bpy.data.movieclips if clip.filepath]
    films = [file for clip, film in shown for file in (files_of(film) if clip.source == "SEQUENCE" else [Path(film)])]
    images = [Path(absolute(each.filepath, each.library)) for each in bpy.data.images if each.filepath and each.users]
    wanted = os.path.realpath(path)
    return any(os.path.realpath(each) == wanted for each in (*films, *images))


def refuse_footage(path: Path) -> None:
    """Raise UsageError if the file to be written is footage, which would be lost."""
    if is_footage(path):
        raise UsageError(f"{path} is footage that this file shows; rendering into it would destroy it.", "Render into another file.")
