"""When a file is saved for the first time, its results are copied from the temporary folder to the file's own."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.app.handlers import persistent

from .takes import copy, is_temporary


@persistent
def _before_save(path: str = "", *_: object) -> None:
    if not path:
        return
    for scene in bpy.data.scenes:
        settings = scene.seeing_wind
        if scene.library is None and not settings.unfinished and is_temporary(Path(settings.recovered_take)):
            try:
                _take_along(settings, Path(path).parent)
            except OSError as error:
                print(f"Seeing Wind: the results stay in {settings.recovered_take}: {error}")


def _take_along(settings: bpy.types.PropertyGroup, home: Path) -> None:
    """Copy the take and re-simulations from the temporary folder to `home`, and make the settings refer to the copies."""
    former = Path(settings.recovered_take)
    folder, number = home / former.name, 2
    while folder.exists():
        folder, number = home / f"{former.name.removesuffix('.take')}.{number}.take", number + 1
    kept = [settings, *settings.edits]
    for each in {name for edit in kept for name in (edit.simulated_take, edit.coarse_take) if name}:
        source = Path(each)
        if source.parent == former.parent and source.is_dir():
            target = folder.with_name(folder.name.removesuffix(".take") + source.name.removeprefix(former.name.removesuffix(".take")))
            copy(source, target)
            for edit in kept:
                for name in ("simulated_take", "coarse_take"):
                    if getattr(edit, name) == each:
                        setattr(edit, name, str(target))
            _repoint(source, target)
    if former.is_dir():
        copy(former, folder)
        settings.recovered_take = settings.started_take = str(folder)


def _repoint(former: Path, folder: Path) -> None:
    """Make point caches and cache files of a re-simulation refer to its copy."""
    owners = [modifier for obj in bpy.data.objects for modifier in obj.modifiers if modifier.type == "MESH_CACHE"]
    for owner in (*owners, *bpy.data.cache_files):
        path = Path(bpy.path.abspath(owner.filepath))
        if former in path.parents:
            owner.filepath = str(folder / path.relative_to(former))


def register() -> None:
    """Attach the handler, once."""
    unregister()
    bpy.app.handlers.save_pre.append(_before_save)


def unregister() -> None:
    """Detach the handler."""
    if _before_save in bpy.app.handlers.save_pre:
        bpy.app.handlers.save_pre.remove(_before_save)
