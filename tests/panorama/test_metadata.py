import io
import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from vrchain.errors import ImageError
from vrchain.panorama.metadata import Metadata, metadata_of
from vrchain.panorama.sources import Source, import_panorama

NAMESPACE = "http://ns.google.com/photos/1.0/panorama/"
CROP = {
    "FullPanoWidthPixels": "1000", "FullPanoHeightPixels": "500",
    "CroppedAreaImageWidthPixels": "500", "CroppedAreaImageHeightPixels": "200",
    "CroppedAreaLeftPixels": "250", "CroppedAreaTopPixels": "100",
}  # fmt: skip


def xmp(told: dict[str, str], as_elements: bool = False) -> bytes:
    attributes = "" if as_elements else " ".join(f'GPano:{k}="{v}"' for k, v in told.items())
    elements = "".join(f"<GPano:{k}>{v}</GPano:{k}>" for k, v in told.items()) * as_elements
    return (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/">'
        '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        f'<rdf:Description rdf:about="" xmlns:GPano="{NAMESPACE}" {attributes}>{elements}'
        "</rdf:Description></rdf:RDF></x:xmpmeta>"
    ).encode()


def jpeg(
    metadata: bytes = b"", gps: dict | None = None, size: tuple[int, int] = (600, 240)
) -> bytes:
    image = Image.fromarray(np.full((size[1], size[0], 3), 90, np.uint8))
    exif = Image.Exif()
    if gps:
        exif[34853] = gps
    held = io.BytesIO()
    image.save(held, "JPEG", exif=exif, **({"xmp": metadata} if metadata else {}))
    return held.getvalue()


@pytest.mark.parametrize("as_elements", [False, True])
def test_gpano_is_read_as_attributes_and_as_elements(as_elements: bool) -> None:
    pose = {"PoseHeadingDegrees": "350.5", "PosePitchDegrees": "-3", "PoseRollDegrees": "1.5"}
    told = {"ProjectionType": "equirectangular", **CROP, **pose}
    found = metadata_of(jpeg(xmp(told, as_elements)), "a.jpg")
    assert found.projection == "equirectangular"
    assert (found.heading_deg, found.pitch_deg, found.roll_deg) == (350.5, -3.0, 1.5)
    field = found.field
    assert field is not None
    assert (field.left_rad, field.width_rad) == pytest.approx((math.pi / 2, math.pi))
    assert (field.top, field.height) == pytest.approx((math.radians(54), math.radians(72)))


def test_the_exif_tells_where() -> None:
    gps = {1: "S", 2: (50.0, 30.0, 36.0), 3: "W", 4: (0.0, 7.0, 30.0), 5: b"\x01", 6: 12.5}
    found = metadata_of(jpeg(gps=gps), "a.jpg")
    assert found.latitude_deg == pytest.approx(-50.51)
    assert found.longitude_deg == pytest.approx(-0.125)
    assert found.altitude_m == -12.5


@pytest.mark.parametrize(
    "content",
    [b"", b"no picture", jpeg(), jpeg(b"<rdf:RDF broken</rdf:RDF>"), jpeg()[:200],
     jpeg(gps={1: "N", 2: (1.0, 2.0)})],
)  # fmt: skip
def test_nothing_is_told(content: bytes) -> None:
    assert metadata_of(content, "a.jpg") == Metadata()


@pytest.mark.parametrize(
    ("changed", "word"),
    [
        ({"PosePitchDegrees": "up"}, "-90 to 90 as GPano:PosePitchDegrees, got 'up'"),
        ({"PoseRollDegrees": "nan"}, "GPano:PoseRollDegrees, got 'nan'"),
        ({"PosePitchDegrees": "400"}, "from -90 to 90 as GPano:PosePitchDegrees, got '400'"),
        ({"FullPanoWidthPixels": "0"}, "does not lie in the whole of 0 x 500"),
        ({"CroppedAreaLeftPixels": "501"}, "does not lie in the whole"),
        ({"CroppedAreaTopPixels": "-1"}, "does not lie in the whole"),
    ],
)
def test_lies_are_named(changed: dict[str, str], word: str) -> None:
    with pytest.raises(ImageError) as refused:
        metadata_of(jpeg(xmp(CROP | changed)), "a.jpg")
    assert word in str(refused.value) and "a.jpg" in str(refused.value)


def test_a_broken_or_hostile_packet_is_no_crash() -> None:
    broken = xmp(CROP).replace(b"</rdf:Description>", b"")
    with pytest.raises(ImageError, match="XMP metadata cannot be read"):
        metadata_of(jpeg(broken), "a.jpg")
    bomb = b'<!DOCTYPE a [<!ENTITY b "bbbb">]><rdf:RDF>&b;' + NAMESPACE.encode() + b"</rdf:RDF>"
    with pytest.raises(ImageError, match="XMP"):
        metadata_of(jpeg(bomb), "a.jpg")


def test_of_a_picture_of_any_size_the_metadata_are_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 100)
    assert metadata_of(jpeg(xmp(CROP)), "a.jpg").field is not None
    assert Image.MAX_IMAGE_PIXELS == 100


def test_a_part_of_a_sphere_is_imported_by_its_metadata(tmp_path: Path) -> None:
    """Half a turn wide: the rest is masked; the tilt is corrected, and options go before."""
    told = {"ProjectionType": "equirectangular", **CROP, "PosePitchDegrees": "4"}
    (tmp_path / "a.jpg").write_bytes(jpeg(xmp(told | {"PoseHeadingDegrees": "90"})))
    found = import_panorama(tmp_path / "a.jpg")
    assert found.about["model"] == "equirectangular"
    assert (found.about["pitch_deg"], found.about["heading_deg"]) == (4.0, 90.0)
    assert found.about["tilt_corrected"] is True
    seen = found.panorama.seen_cylinder
    assert seen is not None
    bearing = found.panorama.rig.bearing_of_column(np.arange(seen.shape[1]))
    level = seen[len(seen) // 2]
    assert level[np.abs(bearing) < 1.5].all() and not level[np.abs(bearing) > 1.6].any()
    cut = import_panorama(tmp_path / "a.jpg", Source(elevations_deg=(-30.0, 30.0)))
    kept = cut.panorama.seen_cylinder
    assert kept is not None and kept.any(axis=0).mean() == pytest.approx(0.5, abs=0.02)
    upright = import_panorama(tmp_path / "a.jpg", Source(pitch_deg=0.0))
    assert upright.about["pitch_deg"] == 0.0
    assert upright.panorama.rig.px_per_rad == pytest.approx(1200 / 2 / math.pi, rel=0.01)
