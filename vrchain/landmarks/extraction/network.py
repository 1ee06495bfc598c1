"""The network: one pass over a panorama's picture, an answer for every cell.

EfficientNet-Lite0 up to stride 16 (see ``training.imagenet``), then back up to cells of 4 pixels.
All convolutions go round: what is cut by the picture's edge is whole to the network. In this form
it learns; robots run it as ``exact`` has it. This module imports torch; import it only where a
network is needed.
"""

import os

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from vrchain.landmarks.extraction.proposer import EMBEDDED, KINDS, LOCAL

# channels of each answer: is it a landmark; how well its box fits; log of cells to the box's left,
# top, right and bottom; its middle: bearing from the cell (0.1 rad), log of range (10 m), and the
# logs of how unsure each is; its kind; what it looks like
ANSWERS = {
    "landmark": 1, "fit": 1, "box": 4, "middle": 4, "kind": len(KINDS), "embedding": EMBEDDED,
}  # fmt: skip
# blocks: expansion, kernel, stride, channels out
_BLOCKS = (
    (1, 3, 1, 16),
    (6, 3, 2, 24), (6, 3, 1, 24),
    (6, 5, 2, 40), (6, 5, 1, 40),
    (6, 3, 2, 80), (6, 3, 1, 80), (6, 3, 1, 80),
    (6, 5, 1, 112), (6, 5, 1, 112), (6, 5, 1, 112),
)  # fmt: skip
STRIDE_4, STRIDE_8 = 2, 4  # the last block of each
_MEAN_RGB, _SPREAD_RGB = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # of ImageNet
HIDDEN = 96  # channels of what spots are made of
_WIDE, _FINE = 128, 64


def has_bfloat16() -> bool:
    """Whether this processor computes in bfloat16: emulated, that takes ten times as long.

    With ``VRCHAIN_BFLOAT16=0`` in the environment it counts as one that does not.
    """
    has = torch.cpu.get_capabilities()
    native = any(bool(has.get(name)) for name in ("avx512_bf16", "amx_bf16"))
    return native and os.environ.get("VRCHAIN_BFLOAT16") != "0"


def learning_precision() -> torch.autocast:
    """bfloat16 where the processor has it."""
    return torch.autocast("cpu", dtype=torch.bfloat16, enabled=has_bfloat16())


class Convolution(nn.Module):
    """A convolution that goes round in azimuth; padding "same" as TensorFlow has it."""

    def __init__(
        self, into: int, out: int, kernel: int = 1, stride: int = 1, groups: int = 1
    ) -> None:
        super().__init__()
        self.conv = nn.Conv2d(into, out, kernel, stride, groups=groups)
        reach = kernel - stride
        self.before, self.after = reach // 2, reach - reach // 2

    def forward(self, x: Tensor) -> Tensor:
        before, after = self.before, self.after
        if before or after:  # columns from the other end at both ends, rows of zeros above, below
            x = torch.cat([x[..., x.shape[-1] - before :], x, x[..., :after]], dim=-1)
            x = F.pad(x, (0, 0, before, after))
        found: Tensor = self.conv(x)
        return found


class Block(nn.Module):
    """An inverted residual: expand, filter each channel, project; added to what came in."""

    def __init__(self, into: int, expansion: int, kernel: int, stride: int, out: int) -> None:
        super().__init__()
        inner = into * expansion
        self.expand = Convolution(into, inner) if expansion > 1 else None
        self.filter = Convolution(inner, inner, kernel, stride, groups=inner)
        self.project = Convolution(inner, out)

    def forward(self, x: Tensor) -> Tensor:
        inner = x if self.expand is None else F.relu6(self.expand(x))
        out: Tensor = self.project(F.relu6(self.filter(inner)))
        return out + x if out.shape == x.shape else out


class Mix(nn.Module):
    """Filter each channel over a neighbourhood, mix the channels; added to what came in."""

    def __init__(self, channels: int, kernel: int = 5) -> None:
        super().__init__()
        self.filter = Convolution(channels, channels, kernel, groups=channels)
        self.norm = nn.BatchNorm2d(channels)
        self.widen = Convolution(channels, 2 * channels)
        self.project = Convolution(2 * channels, channels)

    def forward(self, x: Tensor) -> Tensor:
        out: Tensor = self.project(F.relu(self.widen(self.norm(self.filter(x)))))
        return x + out


class Spots(nn.Module):
    """What each cell looks like by itself, from all that the network sees, coarse to fine."""

    def __init__(self) -> None:
        super().__init__()
        seen = (112, 40, 24 + _FINE)  # channels at strides 16, 8 and 4
        self.norm = nn.ModuleList(nn.BatchNorm2d(channels) for channels in seen)
        self.widen = nn.ModuleList(nn.Conv2d(channels, HIDDEN + LOCAL, 1) for channels in seen)
        self.project = nn.Conv2d(HIDDEN, LOCAL, 1)

    def forward(self, coarse: Tensor, middle: Tensor, fine: Tensor) -> Tensor:
        parts = [
            widen(norm(seen))
            for seen, norm, widen in zip((coarse, middle, fine), self.norm, self.widen, strict=True)
        ]
        hidden, direct = (
            parts[2] + twice(parts[1] + twice(parts[0], "bilinear"), "bilinear")
        ).split([HIDDEN, LOCAL], dim=1)
        found: Tensor = self.project(F.relu(hidden)) + direct
        return found


class Network(nn.Module):
    """Pictures (n, 3, rows, columns), RGB 0..1, to answers a cell: see ``ANSWERS``.

    And ``local``, (n, LOCAL, ...): what the cell looks like.
    """

    mean: Tensor
    spread: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.stem = Convolution(3, 32, 3, 2)
        blocks, into = [], 32
        for expansion, kernel, stride, out in _BLOCKS:
            blocks.append(Block(into, expansion, kernel, stride, out))
            into = out
        self.blocks = nn.ModuleList(blocks)
        self.coarse = Convolution(112, _WIDE)
        # what surrounds a thing; coarser, not dilated, which torch 2.13 learns wrongly in bf16
        self.around = nn.Sequential(Mix(_WIDE), Mix(_WIDE), Mix(_WIDE))
        self.context = nn.Sequential(Mix(_WIDE), Mix(_WIDE))
        self.middle_in, self.middle = Convolution(40, _WIDE), Mix(_WIDE)
        self.down, self.fine_in = Convolution(_WIDE, _FINE), Convolution(24, _FINE)
        self.fine = Convolution(_FINE, _FINE, 3)
        self.answers = Convolution(_FINE, sum(ANSWERS.values()))
        # What the backbone sees tells landmarks apart before anything is learned, once what all of
        # them have in common is taken away: so embeddings begin there.
        self.looks = nn.ModuleList(_look(channels) for channels in (24, 40, 112))
        with torch.no_grad():
            self.answers.conv.weight[-EMBEDDED:] = 0.0
        self.centre = nn.BatchNorm1d(EMBEDDED, affine=False)  # of embeddings, landmark by landmark
        self.register_buffer("mean", torch.tensor(_MEAN_RGB).view(3, 1, 1))
        self.register_buffer("spread", torch.tensor(_SPREAD_RGB).view(3, 1, 1))
        # rows are slopes: how far away the ground is at each, the cameras' height being known
        self.level = nn.Parameter(torch.zeros(1, _WIDE, 17, 1))
        self.spots = Spots()

    def forward(self, pictures: Tensor) -> dict[str, Tensor]:
        with torch.no_grad():  # edges and textures are the same everywhere: not learned anew
            x = F.relu6(self.stem((pictures - self.mean) / self.spread))
            for block in self.blocks[: STRIDE_4 + 1]:
                x = block(x)
            stride_4 = x
            for block in self.blocks[STRIDE_4 + 1 : STRIDE_8 + 1]:
                x = block(x)
            stride_8 = x
        for block in self.blocks[STRIDE_8 + 1 :]:
            x = block(x)
        stride_16 = x
        looks = [look(seen) for look, seen in zip(self.looks, (stride_4, stride_8, x), strict=True)]
        x = self.coarse(x) + self.level
        around = twice(self.around(F.avg_pool2d(x, 2, ceil_mode=True)))
        wide = self.context(x + around[..., : x.shape[-2], : x.shape[-1]])
        wide = self.middle(twice(wide) + self.middle_in(stride_8))
        fine = F.relu(twice(self.down(wide)) + self.fine_in(stride_4))
        found = self.answers(F.relu(self.fine(fine))).float()
        answers = dict(zip(ANSWERS, found.split(list(ANSWERS.values()), dim=1), strict=True))
        embedding = answers["embedding"] + looks[0] + twice(looks[1] + twice(looks[2]))
        if not self.training:  # while it learns, ``centre`` is applied to whole landmarks
            c = self.centre
            embedding = F.batch_norm(embedding, c.running_mean, c.running_var, eps=c.eps)
        answers["embedding"] = embedding
        answers["local"] = self.spots(stride_16, stride_8, torch.cat([stride_4, fine], 1)).float()
        return answers


def _look(channels: int) -> nn.Module:
    mix = nn.Conv2d(channels, EMBEDDED, 1, bias=False)
    nn.init.orthogonal_(mix.weight)
    return nn.Sequential(nn.BatchNorm2d(channels), mix)


def twice(x: Tensor, mode: str = "nearest") -> Tensor:
    """As many rows and columns twice over."""
    return F.interpolate(x, scale_factor=2.0, mode=mode)
