"""A whole training: examples, learning, weighing; its weights and its record beside them."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from vrchain.errors import LearnedError
from vrchain.files import check_output_file, write_file
from vrchain.landmarks.extraction.weights import save_weights
from vrchain.landmarks.matching.calibration import to_json
from vrchain.landmarks.training.calibrate import CalibrateConfig, calibrate
from vrchain.landmarks.training.examples import ExampleConfig
from vrchain.landmarks.training.learn import TrainConfig, learn


@dataclass(frozen=True)
class Profile:
    """How long to learn, and on what to weigh the result."""

    learning: TrainConfig
    weighing: CalibrateConfig


PROFILES = {
    "quick": Profile(
        TrainConfig(ExampleConfig(suburbs=24), held_out=2, steps=130, spot_steps=50, warm_up=25),
        CalibrateConfig(suburbs=8),
    ),
    "full": Profile(
        TrainConfig(ExampleConfig(suburbs=90), steps=1200, spot_steps=700), CalibrateConfig()
    ),
}


def train(profile: str, weights: Path, folder: Path) -> None:
    """Teach the network and write its weights, and beside them its record (``.json``).

    The record: configuration with its seeds, curves and metrics by step, calibration. What is
    needed to go on after a break is kept under ``folder``.
    """
    if profile not in PROFILES:
        raise LearnedError(f"no profile {profile!r}: there are {', '.join(PROFILES)}")
    if weights.suffix == ".json":
        raise LearnedError(
            f"expected a file for weights, such as {weights.with_suffix('.pt')}, got {weights}: "
            "their record is written there"
        )
    for file in (weights, weights.with_suffix(".json")):
        check_output_file(file)
    chosen = PROFILES[profile]
    network, record = learn(chosen.learning, folder)
    save_weights(network, weights)
    known = {
        "profile": profile,
        "configuration": asdict(chosen),
        "curves": record,
        "calibration": to_json(calibrate(weights, chosen.weighing)),
    }
    text = json.dumps(known, indent=1, sort_keys=True) + "\n"
    write_file(weights.with_suffix(".json"), text.encode())
