"""Digests of what the commands make from a seed, a line each: tools/digests.py [PART ...].

Run it before and after a change that must not change results, and compare the two with diff. It
knows commands only, so that it outlives every module. On another processor digests may differ.
"""

import hashlib
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
SUBURB, BARN = "scenes/suburb.yaml", "scenes/barn.yaml"
SCENES = (SUBURB, BARN, "scenes/crossing/crossing.world")
EVALUATIONS = {
    "landmarks": "--pairs 2 --spacing 1 10 --variant cnn+sift",
    "search": "--panoramas 20 --goals 2 --by-sift 1 --suburbs 1",
    "homing": "--places 1 --method epipolar --jobs 1",
}


def vrchain(*arguments: str) -> str:
    """What ``vrchain`` prints, run here."""
    command = [sys.executable, "-m", "vrchain", *arguments]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "VRCHAIN_BUILD": "build"}
    environment.setdefault("PYOPENGL_PLATFORM", "egl")
    return subprocess.run(
        command, env=environment, stdout=subprocess.PIPE, text=True, check=True
    ).stdout


def tell(name: str, data: str | bytes) -> None:
    data = data.encode() if isinstance(data, str) else data
    print(f"{hashlib.sha256(data).hexdigest()[:16]}  {name}", flush=True)


def tell_files(folder: str, pattern: str) -> None:
    for path in sorted(Path(folder).glob(pattern)):
        tell(str(path), path.read_bytes())


def scenes() -> None:
    for spec in SCENES:
        vrchain("scene", "export", spec, "-o", "scene.glb")
        tell(f"scene of {spec}", Path("scene.glb").read_bytes())


def landmarks() -> None:
    for name, x_m in (("a", "10"), ("b", "5")):
        vrchain("panorama", SUBURB, "--at", x_m, "0", "0", "-o", name)
        tell_files(name, "*.png")
    tell("landmarks a b", vrchain("landmarks", "a", "b", "--json"))


def missions() -> None:
    for spec, seed in ((BARN, "14"), (SUBURB, "0")):
        folder = f"mission_{seed}"
        vrchain("navigate", spec, "--seed", seed, "-o", folder)
        tell(f"{folder}, its ledger verified", vrchain("ledger", "verify", f"{folder}/ledger"))
        tell_files(folder, "*.json")


def without_times(found: Any) -> Any:
    """An evaluation's figures but those of the clock."""
    if not isinstance(found, dict):
        return found
    kept = {key: value for key, value in found.items() if not key.startswith(("ms_", "times_"))}
    return {key: without_times(value) for key, value in kept.items()}


def evaluations() -> None:
    for name, options in EVALUATIONS.items():
        given = [SUBURB, "--seed", "3000", "--json", *options.split()]
        found = without_times(json.loads(vrchain("evaluate", name, *given)))
        tell(f"evaluate {name}", json.dumps(found))


PARTS = {made.__name__: made for made in (scenes, landmarks, missions, evaluations)}

if __name__ == "__main__":
    if unknown := set(sys.argv[1:]) - set(PARTS):
        sys.exit(f"expected parts of {', '.join(PARTS)}, got {', '.join(sorted(unknown))}")
    with tempfile.TemporaryDirectory() as home:
        os.chdir(home)
        Path("scenes").symlink_to(ROOT / "scenes")
        for part in sys.argv[1:] or PARTS:
            PARTS[part]()
