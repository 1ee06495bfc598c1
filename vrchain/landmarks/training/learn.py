"""Teaching the network: read it in one sitting.

make examples -> each step: some groups of panoramas, coloured anew -> loss -> AdamW
now and then: a checkpoint, from which a run that was broken off goes on, and held-out metrics
"""

import contextlib
import ctypes
import io
import json
import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from itertools import permutations
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from tqdm.auto import tqdm

from vrchain.files import name_of, write_file
from vrchain.landmarks.extraction.network import Network, learning_precision
from vrchain.landmarks.extraction.proposer import BEARING_UNIT_RAD, EMBEDDED
from vrchain.landmarks.training.examples import (
    ExampleConfig,
    Examples,
    make_examples,
    read_examples,
)
from vrchain.landmarks.training.imagenet import take_over
from vrchain.landmarks.training.losses import Target, landmark_embeddings, losses, target_of
from vrchain.landmarks.training.spots import SpotPairs, spot_loss, spots_of, spots_right
from vrchain.seeding import generator

HELD_OUT_SEED = 900  # suburbs that are never learned from, to watch the learning by


@dataclass(frozen=True)
class TrainConfig:
    """How the network is taught."""

    examples: ExampleConfig = field(default_factory=ExampleConfig)
    held_out: int = 6  # suburbs to watch the learning by
    steps: int = 1200  # of the optimiser, until landmarks are known
    spot_steps: int = 700  # after them, in which single spots are learned as well
    groups: int = 2  # groups of panoramas a step
    rate: float = 1.5e-3  # largest learning rate, of the layers that begin anew
    backbone_rate: float = 0.2  # that of the layers taken over, as a share of ``rate``
    warm_up: int = 100  # steps until the rate is reached; then it falls as a cosine, twice
    decay: float = 1e-3  # of weights, a step, as a share of the rate
    strangers: int = 1024  # landmarks of earlier groups that are told apart from the present ones
    checkpoint_steps: int = 50
    metrics_steps: int = 100
    seed: int = 0  # of every random choice


def learn(config: TrainConfig, folder: Path) -> tuple[Network, list[dict[str, Any]]]:
    """The network taught as ``config`` says, and its record: one row a metrics step.

    Examples and checkpoints are kept under ``folder``; a run broken off goes on from there.
    """
    _keep_memory()
    files = make_examples(config.examples, folder / "examples")
    watched = replace(config.examples, seed=HELD_OUT_SEED, suburbs=config.held_out)
    held_out = [read_examples(f) for f in make_examples(watched, folder / "examples")]
    suburbs = [read_examples(f) for f in files]
    network, optimiser = _begin(config)
    checkpoint = folder / f"checkpoint_{config_name(config)}.pt"
    start, record, strangers = _resume(checkpoint, network, optimiser)
    steps = config.steps + config.spot_steps
    bar = tqdm(range(start, steps), initial=start, total=steps, desc="learning", unit="step",
               disable=None)  # fmt: skip
    running: dict[str, float] = {}
    for step, batch in zip(bar, _batches(suburbs, config, start), strict=True):
        for group, rate in zip(optimiser.param_groups, _rates(config, step), strict=True):
            group["lr"] = rate
        # landmarks are known by now: single spots are learned as well, and landmarks by their parts
        further = step >= config.steps
        draws = generator(config.seed, "parts", step) if further else None
        for pictures, targets, spots in batch:
            with learning_precision():
                answers = network(pictures)
            embedded = landmark_embeddings(answers, targets, network.centre, draws)
            parts = losses(answers, targets, embedded, strangers)
            if further:
                parts["spots"] = spot_loss(answers["local"], spots)
                parts["total"] = parts["total"] + parts["spots"]
            (parts["total"] / len(batch)).backward()
            strangers = torch.cat([embedded[0].detach(), strangers])[: config.strangers]
            for name, value in parts.items():
                running[name] = 0.98 * running.get(name, value.item()) + 0.02 * value.item()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 20.0, error_if_nonfinite=True)
        optimiser.step()
        optimiser.zero_grad()
        bar.set_postfix({k: f"{v:.2f}" for k, v in running.items()}, refresh=False)
        done = step + 1
        if done % config.metrics_steps == 0 or done == steps:
            record.append({"step": done, **running, **metrics(network, held_out)})
            print(json.dumps({k: round(v, 3) for k, v in record[-1].items()}), flush=True)
        if done % config.checkpoint_steps == 0 or done == steps:
            state = {"network": network.state_dict(), "optimiser": optimiser.state_dict(),
                     "step": done, "record": record, "strangers": strangers}  # fmt: skip
            buffer = io.BytesIO()
            torch.save(state, buffer)
            write_file(checkpoint, buffer.getvalue())
    return network, record


def _keep_memory() -> None:
    """Have the C library keep what is freed: given back and asked for anew, it costs a third."""
    with contextlib.suppress(OSError, AttributeError):  # another C library
        libc = ctypes.CDLL("libc.so.6")
        for option, value in ((-4, 0), (-1, 2**31 - 1), (-2, 2**28)):  # mmap_max, trim, top_pad
            libc.mallopt(option, value)


def config_name(config: TrainConfig) -> str:
    """A name for a run, so that one run never goes on with another's checkpoint."""
    return name_of(asdict(config))


def _begin(config: TrainConfig) -> tuple[Network, torch.optim.AdamW]:
    torch.manual_seed(config.seed)
    network = Network()
    take_over(network)
    network = network.to(memory_format=torch.channels_last).train()  # type: ignore[call-overload]
    taken_over = {id(p) for part in (network.stem, network.blocks) for p in part.parameters()}
    old = [p for p in network.parameters() if id(p) in taken_over]
    new = [p for p in network.parameters() if id(p) not in taken_over]
    return network, torch.optim.AdamW([{"params": old}, {"params": new}], weight_decay=config.decay)


def _rates(config: TrainConfig, step: int) -> tuple[float, float]:
    """Learning rates of the layers taken over and of the new ones."""
    first = step < config.steps
    step, steps = (step, config.steps) if first else (step - config.steps, config.spot_steps)
    if step < config.warm_up:
        share = (step + 1) / config.warm_up
    else:
        done = (step - config.warm_up) / max(1, steps - config.warm_up)
        share = 0.5 * (1 + math.cos(math.pi * done)) + 0.01
    return config.rate * share * config.backbone_rate, config.rate * share


def _resume(
    checkpoint: Path, network: Network, optimiser: torch.optim.AdamW
) -> tuple[int, list[dict[str, Any]], Tensor]:
    strangers = torch.zeros(0, EMBEDDED)
    with contextlib.suppress(FileNotFoundError):
        state = torch.load(checkpoint, weights_only=True)
        network.load_state_dict(state["network"])
        optimiser.load_state_dict(state["optimiser"])
        return state["step"], state["record"], state["strangers"]
    return 0, [], strangers


Batch = list[tuple[Tensor, list[Target], list[SpotPairs]]]


def _batches(suburbs: list[Examples], config: TrainConfig, start: int) -> Iterator[Batch]:
    """The groups of each step, made ready while the step before is still being learned from."""

    def batch(step: int) -> Batch:
        draws = generator(config.seed, "step", step)
        spots = generator(config.seed, "spots", step) if step >= config.steps else None
        chosen = [suburbs[int(draws.integers(len(suburbs)))] for _ in range(config.groups)]
        return [_group(s, int(draws.choice(np.unique(s.group))), draws, spots) for s in chosen]

    with ThreadPoolExecutor(1) as pool:
        coming = pool.submit(batch, start)
        steps = config.steps + config.spot_steps
        for step in range(start, steps):
            ready = coming.result()
            if step + 1 < steps:
                coming = pool.submit(batch, step + 1)
            yield ready


def _group(
    suburb: Examples,
    group: int,
    draws: np.random.Generator | None = None,
    spots: np.random.Generator | None = None,
) -> tuple[Tensor, list[Target], list[SpotPairs]]:
    """The panoramas of a group and what to answer; with ``draws`` mirrored and coloured anew."""
    members = np.flatnonzero(suburb.group == group)
    mirrored = draws is not None and draws.random() < 0.5
    pictures = [suburb.picture(int(i)) for i in members]
    if mirrored:
        pictures = [p[:, ::-1] for p in pictures]
    if draws is not None:
        pictures = [recoloured(p, draws) for p in pictures]
    stacked = torch.from_numpy(np.ascontiguousarray(np.stack(pictures))).permute(0, 3, 1, 2)
    pixels = (stacked.float() / 255).contiguous(memory_format=torch.channels_last)
    targets = [target_of(suburb, int(i), mirrored) for i in members]
    return pixels, targets, spots_of(suburb, members, spots, mirrored) if spots else []


def recoloured(picture: NDArray[np.uint8], draws: np.random.Generator) -> NDArray[np.uint8]:
    """Another light, another camera: brightness, contrast, colours, sharpness and noise."""
    x = picture.astype(np.float32) / 255
    x = x ** np.float32(np.exp(draws.normal(0, 0.2)))
    x *= np.exp(draws.normal(0, [0.08, 0.05, 0.1])).astype(np.float32)  # white balance
    grey = x.mean(axis=2, keepdims=True)
    x = grey + (x - grey) * np.float32(draws.uniform(0.3, 1.5))
    x = (x - x.mean()) * np.float32(draws.uniform(0.7, 1.3)) + x.mean()
    if draws.random() < 0.3:
        x = np.asarray(cv2.GaussianBlur(x, (0, 0), float(draws.uniform(0.4, 1.2))), np.float32)
    x += draws.normal(0, draws.uniform(0, 0.03), x.shape[:2])[..., None].astype(np.float32)
    return (x.clip(0, 1) * 255).astype(np.uint8)


def metrics(network: Network, held_out: list[Examples]) -> dict[str, float]:
    """How well the network does on suburbs that it has not seen, landmarks given by truth.

    right: a landmark's most alike one in another panorama of its group is itself. overlap: of
    cells said and known to be landmarks. range_off: median of the error's share of the range.
    bearing_off_rad: median. spots_right: the cell most like a spot seen from elsewhere shows it.
    """
    network.eval()
    right, n, both, either, found_spots, n_spots = 0, 0, 0, 0, 0, 0
    range_off, bearing_off = [], []
    for suburb in held_out:
        for group in np.unique(suburb.group)[:3]:
            draws = generator(0, "watched", int(group))
            pictures, targets, spots = _group(suburb, int(group), spots=draws)
            with torch.inference_mode(), learning_precision():
                answers = network(pictures)
            embedding, ids, panorama = landmark_embeddings(answers, targets)
            of_these, in_all = spots_right(answers["local"], spots)
            found_spots, n_spots = found_spots + of_these, n_spots + in_all
            for i, j in permutations(range(len(targets)), 2):
                here, there = panorama == i, panorama == j
                known = torch.isin(ids[here], ids[there])
                nearest = (embedding[here][known] @ embedding[there].T).argmax(dim=1)
                right += int((ids[there][nearest] == ids[here][known]).sum())
                n += int(known.sum())
            for i, target in enumerate(targets):
                said = answers["landmark"][i, 0].flatten() > 0
                true = torch.zeros_like(said)
                true[target.cell] = True
                both, either = both + int((said & true).sum()), either + int((said | true).sum())
                middle = answers["middle"][i].flatten(1)[:2, target.cell].T - target.middle
                bearing_off.append(middle[:, 0].abs().numpy() * BEARING_UNIT_RAD)
                range_off.append(np.expm1(np.abs(middle[:, 1].numpy())))
    network.train()
    return {
        "right": right / max(1, n),
        "overlap": both / max(1, either),
        "range_off": float(np.median(np.concatenate(range_off))),
        "bearing_off_rad": float(np.median(np.concatenate(bearing_off))),
        "spots_right": found_spots / max(1, n_spots),
    }
