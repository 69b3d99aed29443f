"""Model folders: what is found, what is refused, and what the doctor says."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from seeing_wind.engine.command.doctor import optional_models
from seeing_wind.engine.errors import WRONG_INPUT, MissingPackage, ModelError
from seeing_wind.engine.observe.models.catalogue import KNOWN, cached, known
from seeing_wind.engine.observe.models.depth import predict_depth
from seeing_wind.engine.observe.models.folders import config_of, find, load_plain, package
from seeing_wind.engine.progress import NoProgress


@pytest.fixture(autouse=True)
def empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The hub's cache is somewhere else and empty."""
    import huggingface_hub.constants as constants

    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path / "hub"))
    return tmp_path / "hub"


def test_a_model_that_is_not_there_says_how_to_get_it() -> None:
    with pytest.raises(ModelError, match="no folder") as caught:
        find("apple/DepthPro-hf", "depth")
    assert "hf download apple/DepthPro-hf" in caught.value.hint
    with pytest.raises(ModelError) as caught:
        find("my/own", "mask")
    assert "facebook/sam2.1-hiera-tiny" in caught.value.hint and caught.value.exit_code == WRONG_INPUT


@pytest.mark.parametrize("name", ["", "nowhere", "../up/there", "a/b/c", "/no/such", "x" * 300 + "/y"])
def test_odd_names_are_refused_like_missing_ones(name: str) -> None:
    with pytest.raises(ModelError):
        find(name or "none", "depth")


def test_pickles_are_not_read(tmp_path: Path) -> None:
    torch.save({"a": torch.zeros(1)}, tmp_path / "scaled_offline.pth")
    with pytest.raises(ModelError, match="pickle"):
        find(str(tmp_path), "tracks")
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(ModelError, match="holds nothing"):
        find(str(empty), "tracks")


def test_the_hubs_cache_is_found_without_going_online(empty_cache: Path) -> None:
    place = empty_cache / "models--facebook--sam2.1-hiera-tiny"
    (place / "refs").mkdir(parents=True)
    (place / "refs" / "main").write_text("0123456789abcdef0123456789abcdef01234567")
    snapshot = place / "snapshots" / "0123456789abcdef0123456789abcdef01234567"
    snapshot.mkdir(parents=True)
    save_file({"a": torch.zeros(1)}, snapshot / "model.safetensors")
    assert cached("facebook/sam2.1-hiera-tiny") == snapshot == find("facebook/sam2.1-hiera-tiny", "mask")
    assert cached("facebook/sam2.1-hiera-large") is None


@pytest.mark.parametrize("text", [None, "{", "[]"])
def test_a_broken_config_is_an_error(tmp_path: Path, text: str | None) -> None:
    if text is not None:
        (tmp_path / "config.json").write_text(text)
    with pytest.raises(ModelError, match="config.json"):
        config_of(tmp_path)


def test_another_kind_of_model_is_an_error(tmp_path: Path) -> None:
    save_file({"a": torch.zeros(1)}, tmp_path / "model.safetensors")
    (tmp_path / "config.json").write_text(json.dumps({"model_type": "bert"}))
    with pytest.raises(ModelError, match="bert"):
        predict_depth(str(tmp_path), np.zeros((8, 8, 3), np.uint8), 10.0, NoProgress())


def test_damaged_or_foreign_weights_of_a_plain_module_are_an_error(tmp_path: Path) -> None:
    (tmp_path / "model.safetensors").write_bytes(b"rubbish" * 9)
    with pytest.raises(ModelError, match="do not fit"):
        load_plain(torch.nn.Linear(2, 2), tmp_path, "this")
    save_file({"other": torch.zeros(1)}, tmp_path / "model.safetensors")
    with pytest.raises(ModelError, match="do not fit"):
        load_plain(torch.nn.Linear(2, 2), tmp_path, "this")


def test_a_missing_package_says_how_to_install_it() -> None:
    with pytest.raises(MissingPackage, match="no_such_thing") as caught:
        package("no_such_thing", "pip install it")
    assert caught.value.hint == "pip install it"


def test_the_catalogue_names_licences_and_ways() -> None:
    assert {entry.task for entry in KNOWN} == {"depth", "detector", "mask", "outline", "tracks"}
    for entry in KNOWN:
        assert entry.licence and ("download" in entry.how or "npm pack" in entry.how)
        assert entry.commercial == ("NC" not in entry.licence and "research" not in entry.licence)
        assert known(entry.name.upper()) is entry


def test_the_doctor_lists_models_with_licence_and_advice(empty_cache: Path) -> None:
    from seeing_wind.engine.command.doctor import optional_models

    checks = {check["name"]: check for check in optional_models()}
    assert len(checks) == len(KNOWN) and all(check["optional"] for check in checks.values())
    pro = checks["depth model apple/DepthPro-hf"]
    assert not pro["ok"] and "no commercial use" in pro["detail"] and "hf download" in pro["advice"]
    assert "no commercial" not in checks["mask model facebook/sam2.1-hiera-tiny"]["detail"]


def test_what_an_optional_package_needs_is_said_as_it_works() -> None:
    """No index of packages has this project, so its folder is what is installed."""
    advice = [check["advice"] for check in optional_models() if "hf download" in check["advice"] and "git+" not in check["advice"]]
    assert len(advice) > 4 and all(one.startswith('pip install "PROJECT[models]", PROJECT being the folder') for one in advice)
