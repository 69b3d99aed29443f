"""Settings from plain mappings: unknown keys refused, missing keys named."""

from __future__ import annotations

import pytest

from seeing_wind.engine.errors import UsageError
from seeing_wind.engine.settings import BodyEdit, BuildSettings, ObserveSettings, from_mapping, to_mapping


def test_a_typing_error_never_runs_with_a_default() -> None:
    with pytest.raises(UsageError, match=r"edit\.toml: unknown setting mass_sclae"):
        from_mapping(BodyEdit, {"name": "a", "mesh": "a.obj", "mass_sclae": 2.0}, "edit.toml")


def test_what_is_missing_is_named() -> None:
    with pytest.raises(UsageError, match="mesh is missing"):
        from_mapping(BodyEdit, {"name": "a"}, "edit.toml")


def test_settings_survive_a_plain_mapping() -> None:
    settings = ObserveSettings(box=(1.0, 2.0, 3.0, 4.0), frames=(2, 9), fps=29.97)
    assert from_mapping(ObserveSettings, to_mapping(settings), "here") == settings
    assert from_mapping(BuildSettings, to_mapping(BuildSettings()), "here") == BuildSettings()
