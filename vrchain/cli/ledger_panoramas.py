"""What ``vrchain ledger`` knows of payloads that are panoramas; the ledger itself knows none."""

import json
from pathlib import Path

from vrchain.errors import ImageError
from vrchain.files import output_folder
from vrchain.ledger import NO_BLOB, Ledger, Transaction
from vrchain.ledger.errors import DamagedError, DroppedError
from vrchain.ledger.export import record_json

PICTURES = "pictures.json"  # the table beside exported pictures


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
