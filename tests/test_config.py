"""Settings from files: values arrive, what nobody knows is an error."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from rearticulate.config import PRESETS, FitConfig, load_config, preset
from rearticulate.errors import InputError


def written(folder, values):
    path = folder / "settings.json"
    path.write_text(values if isinstance(values, str) else json.dumps(values))
    return path


def test_a_file_changes_what_it_names(tmp_path):
    config = load_config(written(tmp_path, {"working_points": 900, "track": {"sigma": 20}}))
    assert config == replace(FitConfig(), working_points=900, track=replace(FitConfig().track, sigma=20.0))
    assert isinstance(config.track.sigma, float)
    base = FitConfig(canonical_tries=1)
    assert load_config(written(tmp_path, {}), base) == base


@pytest.mark.parametrize(
    "values, message",
    [
        ({"working_point": 900}, "unknown setting 'working_point'"),
        ({"track": {"sigmas": 1}}, "track: unknown setting 'sigmas'"),
        ({"track": 3}, "an object of settings is needed"),
        ({"working_points": "many"}, "working_points must be a number"),
        ({"working_points": True}, "working_points must be a number"),
        ([], "an object of settings is needed"),
        ("{", "settings.json"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, values, message):
    with pytest.raises(InputError, match=message):
        load_config(written(tmp_path, values))


def test_a_missing_file_is_an_input_error(tmp_path):
    with pytest.raises(InputError, match=r"nothing\.json"):
        load_config(tmp_path / "nothing.json")


def test_presets():
    assert all(preset(name) is config for name, config in PRESETS.items())
    with pytest.raises(InputError, match=", ".join(PRESETS)):
        preset("no such preset")
