"""What recorders and drivers do to bags, and what is made of it."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import pytest

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

import recordings
from recordings import START_NS, Row, changed, fields, published, recording, stamped, write
from sights import RIG

from vrchain.errors import BagError
from vrchain.panorama import Codec, Panorama
from vrchain.ros.contents import clocked, contents_of
from vrchain.ros.robots import robot_in

NS = 1_000_000_000
CAMERA_3 = "/R1/camera_3/image_raw"


@cache
def clean() -> recordings.Outcome:
    folder = Path(mkdtemp())
    return published([write(recording(), folder / "bag")], folder / "ledger")


def outcome_of(rows: list[Row], folder: Path, **more: object) -> recordings.Outcome:
    return published([write(rows, folder / "bag")], folder / "ledger", **more)


def same(found: recordings.Outcome) -> bool:
    return (found.times_s, found.digests) == (clean().times_s, clean().digests)


def refused(rows: list[Row], folder: Path, **more: object) -> str:
    """The one line; nothing is published."""
    with pytest.raises(BagError) as told:
        outcome_of(rows, folder, **more)
    from vrchain.ledger import Ledger

    with Ledger.open(folder / "ledger") as ledger:
        assert ledger.latest("R1") is None
    assert "\n" not in str(told.value)
    return str(told.value)


def test_a_clean_recording() -> None:
    found = clean()
    assert found.said == () and found.played.broken == 0
    assert found.times_s == (0.0, 5.0, 10.0)  # 3 m on: a look every 2.5 m, at whole seconds
    assert [m and round(m.x_m, 2) for m in found.moved] == [None, 3.0, 3.0]


def test_stamps_that_differ_from_when_they_were_received(tmp_path: Path) -> None:
    rows = [replace(row, received_ns=row.received_ns + 3 * NS) for row in recording()]
    found = outcome_of(rows, tmp_path)
    assert same(found) and found.said == ()


def test_a_camera_whose_clock_began_at_its_start(tmp_path: Path) -> None:
    rows = changed(
        recording(), "camera_3", lambda row: stamped(row, row.received_ns - START_NS + NS)
    )
    found = outcome_of(rows, tmp_path)
    assert same(found)
    (line,) = found.said
    assert CAMERA_3 in line and "clock" in line


@pytest.mark.parametrize("where", ["/R1/", "camera_3", "odom"])
def test_stamps_of_zero(where: str, tmp_path: Path) -> None:
    found = outcome_of(changed(recording(), where, lambda row: stamped(row, 0)), tmp_path)
    assert same(found)
    assert found.said and all("stamps" in line for line in found.said)


def test_a_clock_that_is_set_back_meanwhile(tmp_path: Path) -> None:
    def back(row: Row) -> Row:
        late = row.received_ns > START_NS + 6 * NS
        return stamped(row, row.received_ns - 100 * NS) if late else row

    found = outcome_of(changed(recording(), "/R1/", back), tmp_path)
    assert same(found) and any("step" in line for line in found.said)


def test_one_stamp_that_is_wrong(tmp_path: Path) -> None:
    def wrong(row: Row) -> Row:
        odd = row.received_ns == START_NS + 3 * NS
        return stamped(row, row.received_ns + 500 * NS) if odd else row

    assert same(outcome_of(changed(recording(), "/R1/", wrong), tmp_path))


def delayed(rows: list[Row], step_s: float) -> list[Row]:
    """Camera k later by k steps, as free-running cameras are."""

    def later(row: Row) -> Row:
        by_ns = round(int(row.topic.split("camera_")[1][0]) * step_s * NS)
        return stamped(replace(row, received_ns=row.received_ns + by_ns), row.received_ns + by_ns)

    return sorted(changed(rows, "camera_", later), key=lambda row: row.received_ns)


def test_cameras_that_are_a_little_apart(tmp_path: Path) -> None:
    found = outcome_of(delayed(recording(), 0.005), tmp_path)
    assert found.digests == clean().digests
    assert found.times_s == pytest.approx(clean().times_s, abs=0.03)


def test_cameras_that_are_far_apart(tmp_path: Path) -> None:
    rows = delayed(recording(), 0.02)
    line = refused(rows, tmp_path)
    slop = re.search(r"--slop ([\d.]+)", line)
    assert slop and "camera_7" in line
    found = published([tmp_path / "bag"], tmp_path / "again", slop_s=float(slop[1]))
    assert found.digests == clean().digests


def test_a_camera_that_drops_pictures(tmp_path: Path) -> None:
    def dropped(row: Row) -> Row | None:
        return None if row.received_ns == START_NS + 10 * NS else row

    found = outcome_of(changed(recording(), CAMERA_3, dropped), tmp_path)
    assert found.times_s == (0.0, 5.0, 11.0)


def test_no_calibration(tmp_path: Path) -> None:
    rows = changed(recording(), "camera_3/camera_info", lambda row: None)
    assert "no camera_info was recorded" in refused(rows, tmp_path)
    for size in ("k", "p"):
        zero = changed(
            recording(),
            "camera_info",
            lambda row, size=size: replace(
                row, message=fields(row.message, **{size: getattr(row.message, size) * 0})
            ),
        )
        folder = tmp_path / size
        folder.mkdir()
        if size == "k":
            assert "zeros" in refused(zero, folder)
        else:
            assert same(outcome_of(zero, folder))  # P is of rectified pictures alone


RIG_FILE = """
camera_height_m: 1.0
cameras:
""" + "".join(
    f"  - {{topic: camera_{k}/image_raw, bearing_deg: {45 * k}, "
    f"intrinsics: [{RIG.focal_px!r}, {RIG.focal_px!r}, 159.5, 119.5]}}\n"
    for k in range(8)
)


def test_a_rig_tells_what_the_bag_does_not(tmp_path: Path) -> None:
    bare = changed(recording(), "camera_info", lambda row: None)
    bare = changed(bare, recordings.STATIC, lambda row: None)
    (tmp_path / "rig.yaml").write_text(RIG_FILE)
    assert same(outcome_of(bare, tmp_path, rig=tmp_path / "rig.yaml"))


def test_a_rig_of_lenses_alone_looks_where_the_transforms_say(tmp_path: Path) -> None:
    lenses = re.sub("bearing_deg: [0-9]+, ", "", RIG_FILE)
    (tmp_path / "rig.yaml").write_text(lenses)
    bare = changed(recording(), "camera_info", lambda row: None)
    assert same(outcome_of(bare, tmp_path, rig=tmp_path / "rig.yaml"))
    nowhere, own = changed(bare, recordings.STATIC, lambda row: None), tmp_path / "nowhere"
    own.mkdir()
    assert "no transform leads" in refused(nowhere, own, rig=tmp_path / "rig.yaml")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("cameras: 3", "cameras as a list"),
        ("camera: []", "expected a rig of"),
        ("cameras: [{topic: camera_0/image_raw, bearing: 90}]", "got bearing"),
        ("cameras: []\ncameras: []", "there twice"),
        ("[1, 2", "cannot read the rig"),
        ("cameras: [{topic: camera_9/image_raw}]", "camera_9/image_raw is not in the bags"),
        ("cameras: [{topic: camera_0/image_raw, intrinsics: [1, 2]}]", "four intrinsics"),
        ("cameras: [{topic: camera_0/image_raw, intrinsics: [a]}]", "intrinsics [fx"),
        (
            "cameras: [{topic: camera_0/image_raw, bearing_deg: left}]",
            "expected numbers as bearing",
        ),
        ("camera_height_m: high", "expected a number as camera_height_m, got 'high'"),
        ("camera_height_m: .nan", "give --rig a camera_height_m"),
        ("cameras: [{topic: camera_0/image_raw, encoding: 8}]", "an encoding, as rgb8, got 8"),
        ("odometry: nonsense", "the rig's odometry /R1/nonsense is not there: there is /R1/odom"),
    ],
)
def test_a_wrong_rig(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text(text)
    assert said in refused(recording(), tmp_path, rig=tmp_path / "rig.yaml")


def test_transforms_in_the_first_part_alone(tmp_path: Path) -> None:
    rows = recording()
    half = next(k for k, row in enumerate(rows) if row.received_ns >= START_NS + 6 * NS)
    first, second = (write(part, tmp_path / f"part_{k}") for k, part in enumerate(
        (rows[:half], rows[half:])))  # fmt: skip
    assert same(published([second, first], tmp_path / "both"))
    with pytest.raises(BagError, match="first part"):
        published([second], tmp_path / "second")


def test_pictures_that_were_never_recorded(tmp_path: Path) -> None:
    line = refused(changed(recording(), "image_raw", lambda row: None), tmp_path)
    assert "no pictures were recorded" in line and "/R1/camera_0/camera_info" in line
    nothing = changed(recording(), "camera", lambda row: None)
    (tmp_path / "none").mkdir()
    assert "no camera at all" in refused(nothing, tmp_path / "none")


def test_odometry_that_is_set_anew(tmp_path: Path) -> None:
    def anew(row: Row) -> Row:
        if row.received_ns < START_NS + 7 * NS:
            return row
        x_m = row.message.pose.pose.position.x
        return replace(row, message=fields(row.message, pose__pose__position__x=x_m - 4.2))

    found = outcome_of(changed(recording(), "odom", anew), tmp_path)
    assert found.times_s == (0.0, 5.0, 10.0)
    assert [m is None for m in found.moved] == [True, False, True]
    assert any("set anew" in line for line in found.said)


def test_null_quaternions(tmp_path: Path) -> None:
    def null(row: Row, every: int = 3) -> Row:
        if (row.received_ns - START_NS) // 100_000_000 % every:
            return row
        zero = {f"pose__pose__orientation__{axis}": 0.0 for axis in "xyzw"}
        return replace(row, message=fields(row.message, **zero))

    found = outcome_of(changed(recording(), "odom", null), tmp_path)
    assert found.digests == clean().digests
    (tmp_path / "all").mkdir()
    every = changed(recording(), "odom", lambda row: null(row, 1))
    assert "orientation is null" in refused(every, tmp_path / "all")


def test_no_odometry(tmp_path: Path) -> None:
    rows = changed(recording(), "/odom", lambda row: None)
    line = refused([row for row in rows if row.topic != "/tf"], tmp_path)
    assert "expected nav_msgs/msg/Odometry under /R1/" in line


def test_transforms_tell_the_way_where_odometry_does_not(tmp_path: Path) -> None:
    found = outcome_of(changed(recording(), "/odom", lambda row: None), tmp_path)
    assert same(found) and found.moved == clean().moved
    assert found.said == (
        "R1: no nav_msgs/msg/Odometry was recorded: transforms from /R1/odom of tf are used",
    )


def test_poses_that_the_rig_names(tmp_path: Path) -> None:
    from vrchain.ros.messages import POSE
    from vrchain.ros.telling import Messages

    def as_pose(row: Row) -> Row:
        told = row.message
        pose = Messages(False).make(POSE, header=told.header, pose=told.pose.pose)
        return replace(row, topic="/R1/slam_pose", message=pose)

    rows = [row for row in changed(recording(), "/odom", as_pose) if row.topic != "/tf"]
    for named in ("slam_pose", "/R1/slam_pose"):
        own = tmp_path / named.strip("/").replace("/", "_")
        own.mkdir()
        (own / "rig.yaml").write_text(f"odometry: {named}\ncameras: []\n")
        assert same(outcome_of(rows, own, rig=own / "rig.yaml"))


@pytest.mark.parametrize(
    ("until_s", "times_s", "broken"),
    [(5, (0.0, 6.0, 10.0), 0), (8, (0.0, 10.0), 1), (11, (0.0,), 2)],
)
def test_pictures_that_are_broken(
    until_s: int, times_s: tuple[float, ...], broken: int, tmp_path: Path
) -> None:
    """Those of the next moment serve, three times at most."""

    def cut(row: Row) -> Row:
        if not 5 * NS <= row.received_ns - START_NS <= until_s * NS:
            return row
        return replace(row, message=fields(row.message, data=row.message.data[:50]))

    rows = changed(recording(codec=Codec("jpeg", 90)), CAMERA_3, cut)
    found = outcome_of(rows, tmp_path)
    assert (found.times_s, found.played.broken) == (times_s, broken)
    assert any(CAMERA_3 in line for line in found.said)


def test_a_message_that_came_late_in_the_first_of_two_bags(tmp_path: Path) -> None:
    """How messages of two bags follow one another rests on every topic, in both readings."""
    late = next(k for k, row in enumerate(recording()) if row.topic == "/R1/scan")
    rows = recording()
    rows[late] = replace(rows[late], received_ns=rows[late].received_ns + 60 * NS)
    first = [row for row in recording() if row.received_ns < START_NS + 6 * NS]
    parts = rows[: len(first)], rows[len(first) :]
    bags = [write(part, tmp_path / f"bag_{k}") for k, part in enumerate(parts)]
    assert same(published(bags, tmp_path / "ledger"))


def test_services_and_unknown_types_beside(tmp_path: Path) -> None:
    rows = recording()
    odd = [replace(row, topic="/R1/set_pose/_service_event") for row in rows if "scan" in row.topic]
    assert same(outcome_of(sorted(rows + odd, key=lambda row: row.received_ns), tmp_path))


def test_red_and_blue_of_a_jpeg(tmp_path: Path) -> None:
    import cv2

    def exchanged(row: Row) -> Row:
        image = cv2.imdecode(row.message.data, cv2.IMREAD_COLOR)
        coded = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 98])[1].ravel()
        label = "rgb8; jpeg compressed rgb8"
        return replace(row, message=fields(row.message, data=coded, format=label))

    from vrchain.ledger import Ledger

    rows = recording(codec=Codec("jpeg", 98))
    first = {}
    for name, given in {"right": rows, "other": changed(rows, "image_raw", exchanged)}.items():
        folder = tmp_path / name
        folder.mkdir()
        digest = outcome_of(given, folder).digests[0]
        with Ledger.open(folder / "ledger") as ledger:
            first[name] = Panorama.decode(ledger.payload(bytes.fromhex(digest))).views.astype(int)
    off = abs(first["right"] - first["other"]).mean()
    assert off < 3 < abs(first["right"] - first["other"][..., ::-1]).mean()


def test_robots_may_have_frames_of_one_name(tmp_path: Path) -> None:
    """Each has its transforms below its own namespace; the second's cameras are mounted turned."""

    def of(name: str, turns: int) -> list[Row]:
        found = []
        for row in recording():
            message = row.message
            if row.topic == "/tf_static":
                own = message.transforms
                shifted = [own[(k + turns) % len(own)].transform for k in range(len(own))]
                turned = [fields(t, transform=s) for t, s in zip(own, shifted, strict=True)]
                row = replace(
                    row, topic="/R1/tf_static", message=fields(message, transforms=turned)
                )
            found.append(replace(row, topic=row.topic.replace("/R1/", f"/{name}/")))
        return found

    contents = contents_of([write([*of("R1", 0), *of("R2", 1)], tmp_path / "bag")])
    first, second = (
        [c.topic.rpartition("camera_")[2][0] for c in robot_in(
            contents, name, f"/{name}", {}, 0.05).ring.cameras]
        for name in ("R1", "R2")
    )  # fmt: skip
    assert first != second and sorted(first) == sorted(second)


def test_a_recording_of_the_future_is_refused(tmp_path: Path) -> None:
    made = write(recording(), tmp_path / "bag")
    with pytest.raises(BagError, match=r"recording of the past, it ends at 2023-11-14 22:13 UTC"):
        published([made], tmp_path / "ledger", now_ns=START_NS - 100_000_000_000)
    assert published([made], tmp_path / "again", now_ns=START_NS).digests


def test_what_was_held_up_on_its_way_keeps_its_stamp() -> None:
    """For two seconds nothing comes, then all at once; a clock that steps back is another thing."""
    stamps = [START_NS + k * NS // 10 for k in range(120)]
    received = [max(t, START_NS + 7 * NS) if t > START_NS + 5 * NS else t for t in stamps]
    times, _, wrong = clocked(stamps, received)
    assert times.tolist() == stamps and wrong == 0
    stepped = [t - 5 * NS * (k > 60) for k, t in enumerate(stamps)]
    times, _, wrong = clocked(stepped, stamps)
    assert times.tolist() == stamps and wrong == 59
