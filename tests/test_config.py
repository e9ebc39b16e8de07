"""Settings from files: values arrive, what nobody knows is an error."""

from __future__ import annotations

import json
from dataclasses import fields, is_dataclass, replace
from typing import get_type_hints

import numpy as np
import pytest

from rearticulate.config import MECHANISMS, PRESETS, FitConfig, NeuralConfig, load_config, preset
from rearticulate.errors import InputError
from rearticulate.training.pairs import PairConfig


def written(folder, values):
    path = folder / "settings.json"
    path.write_text(values if isinstance(values, str) else json.dumps(values))
    return path


def test_a_file_changes_what_it_names(tmp_path):
    config = load_config(written(tmp_path, {"working_points": 900, "neural": {"radius": 20}}))
    assert config == replace(FitConfig(), working_points=900, neural=NeuralConfig(radius=20.0))
    assert isinstance(config.neural.radius, float)
    base = FitConfig(canonical_tries=1)
    assert load_config(written(tmp_path, {}), base) == base


@pytest.mark.parametrize(
    "values, message",
    [
        ({"working_point": 900}, "unknown setting 'working_point'"),
        ({"neural": {"radii": 1}}, "neural: unknown setting 'radii'"),
        ({"neural": 3}, "an object of settings is needed"),
        ({"working_points": "many"}, "working_points must be a whole number"),
        ({"working_points": True}, "working_points must be a whole number"),
        ([], "an object of settings is needed"),
        ("{", "settings.json"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, values, message):
    with pytest.raises(InputError, match=message):
        load_config(written(tmp_path, values))


def test_mechanisms_are_left_out_by_name(tmp_path):
    assert FitConfig().without == () and all(FitConfig().uses(name) for name in MECHANISMS)
    config = load_config(written(tmp_path, {"without": ["network"]}))
    assert config == FitConfig(without=("network",)) and not config.uses("network")
    assert load_config(written(tmp_path, {"without": []}), config) == FitConfig()
    for wrong in (["networks"], [3], [["network"]], "network", None):
        with pytest.raises(InputError, match="without must be") as caught:
            load_config(written(tmp_path, {"without": wrong}))
        assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match=f"without must be one of {', '.join(MECHANISMS)}, not 'x'"):
        FitConfig(without=("x",))


def test_a_missing_file_is_an_input_error(tmp_path):
    with pytest.raises(InputError, match=r"nothing\.json"):
        load_config(tmp_path / "nothing.json")


def test_presets():
    assert all(preset(name) is config for name, config in PRESETS.items())
    with pytest.raises(InputError, match=", ".join(PRESETS)):
        preset("no such preset")


def numeric(config):
    """(owner, name, bounds) of every number among the settings."""
    hints = get_type_hints(type(config), include_extras=True)
    for f in fields(config):
        if is_dataclass(getattr(config, f.name)):
            yield from numeric(getattr(config, f.name))
        elif type(getattr(config, f.name)) in (int, float):
            yield config, f.name, hints[f.name].__metadata__[0]


NUMERIC = [*numeric(FitConfig()), *numeric(PairConfig())]


@pytest.mark.parametrize(("owner", "name", "bounds"), NUMERIC, ids=lambda x: x if isinstance(x, str) else "")
def test_every_number_has_bounds(owner, name, bounds):
    below = [bounds.low] * bounds.open + [bounds.low - 1]
    for wrong in (float("nan"), float("inf"), -float("inf"), True, "1", None, [1], 1e300, *below):
        with pytest.raises(InputError, match=name):
            replace(owner, **{name: wrong})
    assert type(getattr(replace(owner, **{name: np.float32(7 if bounds.hold(7) else 1)}), name)) is type(
        getattr(owner, name)
    )


def test_settings_of_another_class_are_refused(tmp_path):
    with pytest.raises(InputError, match="neural must be a NeuralConfig"):
        FitConfig(neural={"parts": 5})
    for text in (
        '{"a":' * 100_000 + "1" + "}" * 100_000,
        '{"working_points": NaN}',
        '{"working_points": 9, "working_points": 8}',
    ):
        with pytest.raises(InputError, match="not valid JSON") as caught:
            load_config(written(tmp_path, text))
        assert "\n" not in str(caught.value)
