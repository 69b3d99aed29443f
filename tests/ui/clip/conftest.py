"""A clip that is chosen in an empty scene."""

from __future__ import annotations

from pathlib import Path

import extension
import pytest


@pytest.fixture(scope="module")
def video(tmp_path_factory) -> Path:
    """A small clip."""
    from tests.ui.clip.inputs import FRAMES, HEIGHT, WIDTH  # needs bpy, as all tests of this folder

    return extension.make_clip(tmp_path_factory.mktemp("video") / "clip.mp4", FRAMES, (WIDTH, HEIGHT))


@pytest.fixture
def settings(clean_file, video):
    """The settings of an empty scene whose clip is chosen."""
    import bpy

    import seeing_wind.ui as ui

    ui.register()
    bpy.context.scene.seeing_wind.clip = str(video)
    yield bpy.context.scene.seeing_wind
    ui.unregister()
