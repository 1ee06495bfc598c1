import importlib
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from zipfile import ZipFile

import numpy as np
import pytest
import sights

from vrchain.errors import LearnedError, MissionError
from vrchain.geometry import Pose
from vrchain.landmarks.extraction.sift import extract
from vrchain.landmarks.extraction.weights import SHIPPED
from vrchain.landmarks.matching.common import Comparison, compare
from vrchain.landmarks.matching.variants import (
    Variant,
    at_half_resolution,
    halved,
    sift,
    variant_named,
)
from vrchain.workbench import common_landmarks

HERE, THERE = Pose(0, 0, 0.3), Pose(3, 1, -2.0)


def found_by(variant: Variant) -> Comparison:
    return variant.compare(*(variant.look(sights.look(pose)) for pose in (HERE, THERE)))


def test_sift_says_what_comparing_says_from_the_score_asked_for() -> None:
    variant, a, b = variant_named("sift"), sights.look(HERE), sights.look(THERE)
    direct = compare(extract(a), extract(b), a.rig)
    made = [c.score for c in found_by(variant).common]
    assert made == [c.score for c in direct.common] and made
    assert len(variant.keypoints(variant.look(a))) == len(extract(a))
    more, none = (len(found_by(sift(least)).common) for least in (0.02, 0.99999))
    assert more >= len(made) > none == 0


def test_one_plugged_in(monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("someone")
    module.theirs = replace(sift(), name="theirs")  # type: ignore[attr-defined]
    module.other = 3  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "someone", module)
    assert variant_named("someone:theirs").name == "theirs"
    for name in ("someone:other", "someone:missing", "nobody:theirs", "orb", ":x", ""):
        with pytest.raises(MissionError, match="no variant"):
            variant_named(name)


def test_one_plugged_in_is_found_where_it_stands_and_known_by_its_file(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Else results of what it was before an edit would be taken for its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    code = (
        "from dataclasses import replace\n"
        "from vrchain.landmarks.matching.variants import sift\n"
        "mine = replace(sift(), maker='weights')\n"
    )
    makers = []
    for text in (code, f"{code}# edited\n", code):
        (tmp_path / "plugged_in.py").write_text(text)
        monkeypatch.delitem(sys.modules, "plugged_in", raising=False)
        importlib.invalidate_caches()
        makers.append(variant_named("plugged_in:mine").maker)
    assert makers[0] == makers[2] != makers[1]
    assert all(maker.startswith("weights ") for maker in makers)


def test_one_that_ends_python_or_lies_in_a_zip(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path), str(tmp_path / "packed.zip")])
    (tmp_path / "a_script.py").write_text("import sys\nsys.exit('bye')\n")
    with pytest.raises(MissionError, match=r"no variant 'a_script:mine' \(SystemExit: bye\)"):
        variant_named("a_script:mine")
    with ZipFile(tmp_path / "packed.zip", "w") as packed:
        packed.writestr(
            "zipped.py", "from vrchain.landmarks.matching.variants import sift\nmine = sift()\n"
        )
    assert variant_named("zipped:mine").name == "sift"


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (None, "NoneType in place of a Comparison"),
        ([], "list in place of a Comparison"),
        ((3,), "a int as a claim"),
        ({"score": float("nan")}, "score nan: expected 0 to 1"),
        ({"score": 50.0}, "score 50.0: expected 0 to 1"),
        ({"support_a": np.array([0, 10**6])}, r"keypoints 0..1000000, of which it has \d+"),
        ({"support_b": np.array([-1])}, r"keypoints -1..-1"),
        ({"support_a": np.array([0.5])}, r"keypoints 0.5..0.5"),
        ({"support_a": np.empty(0, int)}, "a claim without keypoints"),
    ],
)
def test_what_one_plugged_in_gives_is_looked_at(changed: object, told: str) -> None:
    """A claim of score NaN would be none to all that counts claims."""

    def compare_so(a: object, b: object) -> object:
        found = sift().compare(a, b)
        if isinstance(changed, dict):
            return replace(found, common=(replace(found.common[0], **changed),))
        return replace(found, common=changed) if isinstance(changed, tuple) else changed

    mine = replace(sift(), name="mine", compare=compare_so)  # type: ignore[arg-type]
    with pytest.raises(MissionError, match=f"matcher 'mine' gave .*{told}"):
        found_by(variant_named(mine))
    a, b = sights.look(HERE), sights.look(THERE)
    with pytest.raises(MissionError, match="matcher 'mine' gave"):
        common_landmarks(a, b, mine)
    assert len(common_landmarks(a, b, sift()).comparison.common) == len(found_by(sift()).common)


def test_half_the_resolution_is_the_same_view() -> None:
    panorama = sights.look(HERE)
    small = halved(panorama)
    assert small.rig.span_rad == panorama.rig.span_rad
    assert small.views.shape[1] * 2 == panorama.views.shape[1]
    assert abs(float(small.views.mean()) - float(panorama.views.mean())) < 1
    variant = variant_named("sift, half resolution")
    assert variant.name == at_half_resolution(sift()).name == "sift, half resolution"
    assert len(variant.keypoints(variant.look(panorama))) < len(extract(panorama))


def test_fewer_keypoints_and_the_same_landmarks() -> None:
    panorama = sights.look(Pose(0, 0, 0.5), sights.RIG)
    every, fewer = variant_named("cnn+sift"), variant_named("cnn+sift, fewer keypoints")
    one, other = every.look(panorama), fewer.look(panorama)
    assert np.array_equal(one.proposals.embedding, other.proposals.embedding)
    assert np.array_equal(one.spots.descriptors, other.spots.descriptors)
    assert 0 < len(fewer.keypoints(other)) < len(every.keypoints(one))


def test_other_weights_stand_beside_the_shipped_ones(tmp_path: Path) -> None:
    shutil.copy(SHIPPED, tmp_path / "mine.pt")
    with pytest.raises(LearnedError, match=r"mine\.json holds no calibration"):
        variant_named(str(tmp_path / "mine.pt"))
    shutil.copy(SHIPPED.with_suffix(".json"), tmp_path / "mine.json")
    mine, shipped = variant_named(str(tmp_path / "mine.pt"), 0.3), variant_named("cnn+sift", 0.3)
    assert mine.name == "cnn+sift, mine.pt" and mine.maker == shipped.maker
    assert mine.maker != variant_named("cnn+sift").maker  # another threshold is another result
    assert variant_named("sift", 0.1).maker != variant_named("sift").maker
    assert found_by(mine).geometry is not None and found_by(shipped).geometry is not None
