"""A scene file's mistakes are refused with the key and what is allowed."""

from dataclasses import asdict, fields
from pathlib import Path

import pytest

from vrchain.errors import SpecError
from vrchain.paths import SCENES
from vrchain.world import load_spec
from vrchain.world.spec import SceneSpec, parse_spec


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "scene.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_every_key_reaches_its_field(tmp_path: Path) -> None:
    text = (
        "{name: hamlet, seed: 0, extent_m: [80, 90.5], houses: {count: 3, setback_m: [5, 6]},"
        "shops: {count: 2}, barns: {count: 0}, twins: 0.5, light: {sun_elevation_deg: 30}}"
    )
    spec = load_spec(write(tmp_path, text))
    assert (spec.name, spec.seed, spec.extent_m) == ("hamlet", 0, (80.0, 90.5))
    assert (spec.houses.count, spec.houses.setback_m) == (3, (5.0, 6.0))
    assert spec.light.sun_elevation_deg == 30.0
    assert (spec.shops.count, spec.barns.count, spec.twins) == (2, 0, 0.5)
    assert spec.trees == SceneSpec().trees  # what is left out keeps its default


def test_a_time_of_day_sets_what_the_file_leaves_out() -> None:
    assert parse_spec({"light": {"time": "noon"}}) == SceneSpec()
    evening = parse_spec({"light": {"time": "evening"}}).light
    assert evening.sun_elevation_deg < 20
    given = parse_spec({"light": {"time": "evening", "sun_azimuth_deg": 10, "ambient": 0.7}}).light
    assert (given.time, given.sun_azimuth_deg, given.ambient) == ("evening", 10.0, 0.7)
    assert given.sun_elevation_deg == evening.sun_elevation_deg


def test_the_suburb_of_the_scenes_folder_has_its_size_and_seed() -> None:
    spec = load_spec(SCENES / "suburb.yaml")
    assert (spec.extent_m, spec.seed) == ((130.0, 180.0), 2000)


def test_defaults_are_within_their_own_ranges() -> None:
    def as_document(value: object) -> object:
        if isinstance(value, dict):
            return {k: as_document(v) for k, v in value.items()}
        return list(value) if isinstance(value, tuple) else value

    document = as_document(asdict(SceneSpec()))
    assert isinstance(document, dict)
    assert parse_spec(document) == parse_spec({}) == SceneSpec()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("colour: 3", ["'colour'", *(f.name for f in fields(SceneSpec))]),
        ("houses: {number: 3}", ["'houses.number'", "count", "setback_m", "two_storey"]),
        ("houses: {count: -1}", ["houses.count", "-1", "0..500"]),
        ("twins: -0.1", ["twins", "-0.1", "0..1"]),
        ("twins: 1.01", ["twins", "1.01", "0..1"]),
        ("twins: .nan", ["twins", "nan", "0..1"]),
        ("twins: true", ["twins", "a number in 0..1", "True"]),
        ("twins: {share: 0.5}", ["twins", "a number in 0..1", "share"]),
        ("shops: {count: -3}", ["shops.count", "-3", "0..40"]),
        ("shops: {count: .nan}", ["shops.count", "whole number", "nan"]),
        ("shops: 3", ["shops", "keys and values", "3"]),
        ("shops: {kinds: [bakery]}", ["'shops.kinds'", "count"]),
        ("barns: {count: 21}", ["barns.count", "21", "0..20"]),
        ("barns: {count: 1.0}", ["barns.count", "whole number", "1.0"]),
        ("barn: {count: 1}", ["'barn'", "barns"]),
        ("streets: {spacing_m: 0}", ["streets.spacing_m", "0", "60..200"]),
        ("extent_m: [60, 60]\nhouses: {count: 0}\nshops: {count: 20}", ["shops.count", "0..12"]),
        ("houses: {count: 2.5}", ["houses.count", "whole number", "2.5"]),
        ("houses: {count: true}", ["houses.count", "whole number", "True"]),
        ("houses: {count: many}", ["houses.count", "whole number", "many"]),
        ("houses: {count: }", ["houses.count", "None"]),
        ("houses: 30", ["houses", "keys and values", "30"]),
        ("houses: [1, 2]", ["houses", "keys and values"]),
        ("houses: {setback_m: [7, 5]}", ["houses.setback_m", "smaller number first"]),
        ("houses: {setback_m: 5}", ["houses.setback_m", "list of 2", "4..8"]),
        ("extent_m: [130, -180]", ["extent_m", "-180", "60..600"]),
        ("extent_m: [130]", ["extent_m", "list of 2"]),
        ("extent_m: [130, .nan]", ["extent_m", "nan", "60..600"]),
        ("trees: {height_m: [.nan, 9]}", ["trees.height_m", "nan"]),
        ("streets: {width_m: .inf}", ["streets.width_m", "inf", "5..12"]),
        ("light: {ambient: 1.5}", ["light.ambient", "0.2..1"]),
        ("light: {time: dawn}", ["light.time", "noon, evening, overcast", "dawn"]),
        ("light: {time: [noon]}", ["light.time", "noon"]),
        ("light: {time: evening, sun: 3}", ["'light.sun'", "sun_azimuth_deg", "time"]),
        ("season: dry", ["season", "spring", "summer", "autumn", "winter", "dry"]),
        ("seed: -4", ["seed", "-4"]),
        ("seed: 1e3000", ["seed"]),
        ("name: 7", ["name", "7"]),
        ("name: ''", ["name"]),
        ("3: 4", ["'3'", "extent_m"]),
        ("extent_m: [60, 60]\nhouses: {count: 100}", ["houses.count", "100", "0..12"]),
        ("extent_m: [60, 60]\nhouses: {count: 0}\ntrees: {count: 2000}",
         ["trees.count", "2000", "3600 m2"]),
    ],
)  # fmt: skip
def test_a_bad_value_is_named_with_what_is_allowed(
    tmp_path: Path, text: str, words: list[str]
) -> None:
    with pytest.raises(SpecError) as caught:
        load_spec(write(tmp_path, text))
    message = str(caught.value)
    assert "\n" not in message
    assert [w for w in ["scene.yaml", *words] if w not in message] == []


@pytest.mark.parametrize(
    ("words", "texts"),
    [
        ("expected keys and values", ["", "- 1\n- 2", "just words", "7"]),
        (
            "not valid YAML",
            [
                "a: [1, 2",
                "a: b: c",
                "\tx: 1",
                "!!python/object:os.system {}",
                "name: 2026-02-30",
                "seed: " + "1" * 5000,
                "twins: !!float x",
                "name: !!bool x",
                "name: " + "[" * 3000,
                "seed: 3\nname: a\nseed: 4",
                "seed: 3\nlight: {time: noon, time: evening}",
            ],
        ),
    ],
)
def test_what_is_no_plain_mapping_is_refused_in_one_line(
    tmp_path: Path, words: str, texts: list[str]
) -> None:
    for text in texts:
        with pytest.raises(SpecError, match=words) as caught:
            load_spec(write(tmp_path, text))
        assert "\n" not in str(caught.value)


def test_a_missing_file_a_folder_and_a_picture_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="no scene file"):
        load_spec(tmp_path / "nowhere.yaml")
    with pytest.raises(SpecError, match="is a folder"):
        load_spec(tmp_path)
    picture = tmp_path / "picture.png"
    picture.write_bytes(b"\x89PNG\r\n\x1a\n\xff\xfe\x00")
    with pytest.raises(SpecError, match="cannot read"):
        load_spec(picture)
