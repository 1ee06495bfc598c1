"""What ``vrchain ledger`` knows of payloads that are panoramas; the ledger itself knows none."""

import json
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vrchain.cli.options import Json, doing
from vrchain.errors import ImageError
from vrchain.files import output_folder
from vrchain.geometry import Pose
from vrchain.ledger import NO_BLOB, Ledger, Transaction
from vrchain.ledger.errors import DamagedError, DroppedError
from vrchain.ledger.export import record_json

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from vrchain.navigation.goal.recognition import GoalSight
    from vrchain.navigation.planning.route import Plan
    from vrchain.panorama import Panorama

PICTURES = "pictures.json"  # the table beside exported pictures
_START = Pose(0.0, 0.0)


def panorama_in(folder: Path, landmarks: bytes | None) -> tuple[bytes, bytes]:
    """A saved panorama as it is published, and its landmark record if that is not known."""
    from vrchain.landmarks.extraction.record import encode_record, examine
    from vrchain.panorama import Panorama

    blob = Panorama.load(folder).encode()
    if landmarks is None:
        landmarks = encode_record(examine(Panorama.decode(blob)))  # of what others will see
    return blob, landmarks


def check_landmarks(ledger: Path) -> int:
    """How many robots' newest records were extracted again; DamagedError if one is of its own."""
    from vrchain.landmarks.retrieval.gallery import is_extracted

    count = 0
    with Ledger.open(ledger) as opened:
        for robot in opened.robots:
            newest = opened.latest(robot)
            if newest is None or newest.landmarks_digest == NO_BLOB:
                continue
            panorama, told = map(opened.payload, (newest.payload_digest, newest.landmarks_digest))
            try:
                alike = is_extracted(told, panorama)
            except ImageError as error:
                raise DamagedError(
                    f"{ledger}: {robot}'s newest payload is no panorama ({error})"
                ) from None
            if not alike:
                raise DamagedError(
                    f"{ledger}: {robot}'s newest landmark record is not what its panorama gives"
                )
            count += 1
    return count


def export_pictures(ledger: Ledger, folder: Path) -> dict[str, int]:
    """Each panorama's cylinder as ROBOT_NUMBER_REASON.png: how many, and how many could not be."""
    from vrchain.panorama import Panorama, encode_png

    counts = {"pictures": 0, "others": 0, "dropped": 0}
    with output_folder(folder, PICTURES) as scratch:
        rows = []
        for entry in ledger.entries():
            for record in entry.records:
                if not isinstance(record, Transaction):
                    continue
                name = f"{record.robot}_{record.sequence:04d}_{record.reason}.png"
                try:
                    panorama = Panorama.decode(ledger.payload(record.payload_digest))
                except DroppedError:
                    counts["dropped"] += 1
                except ImageError:
                    counts["others"] += 1
                else:
                    (scratch / name).write_bytes(encode_png(panorama.cylinder))
                    rows.append({"file": name, **record_json(record)})
                    counts["pictures"] += 1
        (scratch / PICTURES).write_text(json.dumps(rows, indent=1) + "\n")
    return counts


def route(
    ledger: Annotated[Path, typer.Argument(metavar="LEDGER", help="The ledger's folder.")],
    here: Annotated[str, typer.Argument(metavar="HERE", help="The panorama from where you are.")],
    goal: Annotated[
        list[str],
        typer.Argument(metavar="GOAL...", help="A panorama from there, or single views of it."),
    ],
    as_json: Json = False,
) -> None:
    """Tell whose panoramas show a goal, and by which common landmarks the way leads there.

    Both are folders of panoramas, or of the ledger: R2's newest is R2, the one before R2~1.
    """
    from vrchain.reader import route_to

    with Ledger.open(ledger) as opened, doing(f"looking for {', '.join(goal)} in {ledger}"):
        pictures = [_panorama(opened, picture) for picture in (here, *goal)]
        found = plan_json(*route_to(opened, pictures[0], pictures[1:]))
    print(json.dumps(found) if as_json else "\n".join(plan_lines(found)))


def _panorama(ledger: Ledger, name: str) -> "Panorama":
    """Of a folder, or of the ledger."""
    from vrchain.navigation.settings import robot_of
    from vrchain.panorama import Panorama

    robot, age = robot_of(name), name.partition("~")[2] or "0"
    if Path(name).is_dir() or robot not in ledger.robots or not age.isdecimal():
        return Panorama.load(name)
    history = ledger.history(robot)
    if int(age) >= len(history):
        raise ImageError(
            f"expected a panorama of {robot}, who published {len(history)}, got {name}"
        )
    return Panorama.decode(ledger.payload(history[-1 - int(age)].payload_digest))


def plan_lines(found: dict[str, Any]) -> list[str]:
    """What ``plan_json`` gives, for people."""
    lines = []
    for name, row in sorted(found["seen_by"].items(), key=lambda item: -item[1]["chance"]):
        there = row["from_here"]
        place = f"; from here {_way(there)}" if there and name != found["here"] else ""
        lines.append(f"{name} shows it with a chance of {row['chance']:.2f}, {_way(row)}{place}")
    legs = found["legs"]
    if not legs:
        return [*lines, f"no route: {found['why_none']}"]
    names = " - ".join([*(leg["seen_by"] for leg in legs), legs[-1]["next_by"]])
    lines.append(f"route: {names} - goal, right with a chance of {found['trust']:.2f}")
    for leg in legs:
        by, at_deg = f"landmark {leg['landmark']}", leg["bearing_deg"]
        by = "the way that it drove" if at_deg is None else f"{by} at {at_deg:.0f} degrees"
        lines.append(f"    {leg['seen_by']} to {leg['next_by']} by {by}")
    return lines


def plan_json(own: "GoalSight | None", plan: "Plan") -> dict[str, Any]:
    """A plan, with what HERE itself shows of the goal; each bearing from where its panorama heads.

    legs: from panorama to panorama, by a landmark, or if that has no bearing as the robot drove.
    seen_by: sights of the goal, where sure also as seen from here. panoramas: where they were
    taken, as seen from here. graph: landmarks that two panoramas share, with the chance of each.
    """
    from vrchain.reader import HERE

    route, stood = plan.route, plan.poses.reached({HERE: _START})
    seen_by = dict[str, Any]()
    for name, sight in (({HERE: own} if own else {}) | dict(plan.goal_seen_by)).items():
        place = sight.place(stood[name]).xy_m if name in stood else None
        seen_by[name] = {
            "chance": sight.chance,
            **_placed(sight.bearing_rad, sight.surface_m),
            "from_here": None if place is None else _from_here(place),
        }
    return {
        "here": HERE,
        "seen_by": seen_by,
        "legs": [
            {
                "seen_by": leg.seen_by, "next_by": leg.next_by, "landmark": leg.node,
                "bearing_deg": _degrees(leg.landmark.a.bearing_rad),
                "chance": leg.chance, "trust": leg.trust,
            }
            for leg in (route.legs if route else ())
        ],
        "trust": route.trust if route else None,
        "why_none": plan.why_none,
        "unreadable": list(plan.unreadable),
        "panoramas": {name: _from_here(pose.xy_m) for name, pose in stood.items()},
        "graph": [
            {"landmark": f"N{i + 1}", "a": claim.a, "b": claim.b, "score": claim.score}
            for i, claim in plan.graph.legs
        ],
    }  # fmt: skip


def _from_here(xy_m: "NDArray[np.float64]") -> dict[str, float]:
    return _placed(_START.bearing_to_rad(xy_m), _START.distance_to_m(xy_m))


def _placed(bearing_rad: float, range_m: float) -> dict[str, float]:
    return {"bearing_deg": round(degrees(bearing_rad), 2), "range_m": round(range_m, 2)}


def _degrees(bearing_rad: float | None) -> float | None:
    return None if bearing_rad is None else round(degrees(bearing_rad), 2)


def _way(row: dict[str, float]) -> str:
    return f"{row['range_m']:.1f} m at {row['bearing_deg']:.0f} degrees"
