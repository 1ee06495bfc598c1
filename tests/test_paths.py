"""The project's own files are found from any folder, and never hide the user's."""

from pathlib import Path

import pytest

from vrchain.paths import SCENES, scene_file


def test_a_scene_of_the_project_is_found_anywhere_unless_the_user_has_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert scene_file("scenes/barn.yaml") == SCENES / "barn.yaml"
    assert scene_file("scenes/crossing/crossing.world") == SCENES / "crossing" / "crossing.world"
    for other in ("barn.yaml", "scenes/none.yaml", "../scenes/barn.yaml", "scenes/" + "a" * 300):
        assert scene_file(other) == Path(other)
    (tmp_path / "scenes").mkdir()
    (tmp_path / "scenes" / "barn.yaml").touch()
    assert scene_file("scenes/barn.yaml") == Path("scenes/barn.yaml")
