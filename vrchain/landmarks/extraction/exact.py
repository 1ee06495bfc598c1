"""The network as robots run it: in whole numbers, so that every processor gives the same bits.

What a layer takes and gives are whole numbers, and its weights are multiples of a power of two,
both so small that float32 holds every sum of their products exactly: in whatever order a processor
adds, the sum is the same. Sums are then rounded to bfloat16, as processors that have it do by
themselves, and to whole numbers. This is integer inference (Jacob et al., "Quantization and
Training of Neural Networks for Efficient Integer-Arithmetic-Only Inference", 2018), computed by
floating-point units. This module imports torch; import it only where a network is needed.
"""

from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor, nn

from vrchain.landmarks.extraction.network import (
    ANSWERS,
    HIDDEN,
    STRIDE_4,
    STRIDE_8,
    Block,
    Convolution,
    Mix,
    Network,
    has_bfloat16,
    twice,
)
from vrchain.landmarks.extraction.proposer import LOCAL

Factors = tuple[Tensor, Tensor]
"""What numbers are multiplied by, and what is then added, channel by channel."""

_HELD = 2**24  # float32 holds all whole numbers up to here
_WEIGHT_BITS = 16  # of a channel's largest weight, at most


@dataclass(frozen=True)
class _Scale:
    """Whole numbers for ``low`` to ``high``; ``one`` of them make 1."""

    one: float
    low: float
    high: float

    def settled(self, x: Tensor) -> Tensor:
        """Rounded, and within the bounds; in place."""
        return x.round_().clamp_(self.low * self.one, self.high * self.one)


_PIXEL = _Scale(1, 0, 255)
_CLIPPED = _Scale(127 / 6, 0, 6)  # behind a ReLU6
_NORMED = _Scale(32, -16, 16)  # behind a normalisation
_LARGE = _Scale(16, -128, 128)
_FINE = _Scale(4, 0, 128)  # what most weights at once are applied to

# From here to twice as much bfloat16 holds whole numbers only: a sum with this added is rounded to
# one by rounding it to bfloat16.
_LIFT = 128.0
_LIFTED = 0x4300, 0x437F  # the bits of 128 and of 255 in bfloat16; of what is below 0, less than 0


def _clipped(x: Tensor) -> Tensor:
    """ReLU6 of a layer's sums, which are lifted if they are bfloat16; in place."""
    if x.dtype == torch.bfloat16:
        x.view(torch.int16).clamp_(*_LIFTED)  # as its bits, in order as it is: in half the time
        return x.sub_(_LIFT)
    return x.round_().clamp_(0, 127)


@dataclass(frozen=True, eq=False)
class _Layer:
    """A convolution of whole numbers.

    edge: what is above and below a picture. lifts: its sums are for ``_clipped``.
    """

    weight: Tensor
    bias: Tensor
    stride: int
    groups: int
    before: int
    after: int
    edge: Tensor
    lifts: bool

    def __call__(self, x: Tensor) -> Tensor:
        """Sums, of a picture that goes round."""
        return self.sums(self.ringed(x))

    def sums(self, x: Tensor) -> Tensor:
        """The same of a picture to which ``ringed`` has added what the kernel reaches."""
        x = x.to(self.weight.dtype)
        found = F.conv2d(x, self.weight, self.bias, self.stride, groups=self.groups)
        return found if self.lifts else found.bfloat16()

    def ringed(self, x: Tensor) -> Tensor:
        """With columns from the other end at both ends, and rows of the edge above and below."""
        before, after = self.before, self.after
        if not before and not after:
            return x
        n, channels, rows, columns = x.shape
        size = n, channels, rows + before + after, columns + before + after
        whole = torch.empty(size, dtype=x.dtype, memory_format=torch.channels_last)
        self.blank(whole)
        within = whole[:, :, before : before + rows]
        within[..., before : before + columns] = x
        within[..., :before] = x[..., columns - before :]
        within[..., before + columns :] = x[..., :after]
        return whole

    def blank(self, x: Tensor) -> None:
        """Set the rows above and below the picture, in place."""
        x[:, :, : self.before] = self.edge
        x[:, :, x.shape[2] - self.after :] = self.edge


@dataclass(frozen=True, eq=False)
class _Maker:
    """Layers for a processor that computes in bfloat16, or for one that does in float32."""

    dtype: torch.dtype

    def layer(
        self,
        own: nn.Module,
        into: _Scale,
        out: _Scale,
        *,
        before: Factors | None = None,
        behind: Factors | None = None,
    ) -> _Layer:
        """A convolution, with the normalisations before and behind it, of each channel."""
        conv = own.conv if isinstance(own, Convolution) else own
        assert isinstance(conv, nn.Conv2d)
        weight = conv.weight.double()
        bias = torch.zeros(len(weight)).double() if conv.bias is None else conv.bias.double()
        edge = torch.zeros(1)
        if before is not None:
            factor, summand = before
            bias = bias + (weight * summand[:, None, None]).sum((1, 2, 3))
            weight = weight * factor[:, None, None]
            edge = torch.round(-summand / factor)[:, None, None]
        if behind is not None:
            factor, summand = behind
            weight, bias = weight * factor[:, None, None, None], bias * factor + summand
        lifts = out is _CLIPPED
        weight, bias = _exact(
            weight * (out.one / into.one), bias * out.one + _LIFT * lifts,
            max(-into.low, into.high) * into.one,
        )  # fmt: skip
        if lifts and self.dtype != torch.bfloat16:
            bias = bias - _LIFT
        reach = (own.before, own.after) if isinstance(own, Convolution) else (0, 0)
        return _Layer(
            weight.to(self.dtype).contiguous(memory_format=torch.channels_last),
            bias.to(self.dtype), conv.stride[0], conv.groups, *reach, edge.to(self.dtype), lifts,
        )  # fmt: skip

    def block(self, block: Block) -> "_Block":
        """An inverted residual."""
        return _Block(
            None if block.expand is None else self.layer(block.expand, _LARGE, _CLIPPED),
            self.layer(block.filter, _CLIPPED, _CLIPPED),
            self.layer(block.project, _CLIPPED, _LARGE),
        )

    def mix(self, mix: Mix) -> "_Mix":
        """A filter of each channel, and a mixture of the channels."""
        return _Mix(
            self.layer(mix.filter, _LARGE, _NORMED, behind=_normalisation(mix.norm)),
            self.layer(mix.widen, _NORMED, _NORMED),
            self.layer(mix.project, _NORMED, _LARGE),
        )


def _normalisation(norm: nn.Module) -> Factors:
    assert isinstance(norm, nn.BatchNorm1d | nn.BatchNorm2d)
    assert norm.running_mean is not None and norm.running_var is not None
    factor = (norm.running_var.double() + norm.eps).rsqrt()
    if norm.affine:
        factor = factor * norm.weight.double()
    summand = -norm.running_mean.double() * factor
    return factor, summand + norm.bias.double() if norm.affine else summand


def _exact(weight: Tensor, bias: Tensor, largest: float) -> tuple[Tensor, Tensor]:
    """The nearest multiples, a channel, of the least power of two with which no sum is too long.

    largest: of the numbers that the weights are applied to. Multiples are no longer than bfloat16.
    """
    rows = weight.flatten(1)
    bits = _WEIGHT_BITS - rows.abs().amax(1).clamp_min(1e-9).log2().ceil()
    while True:
        one = 2.0**bits
        whole, added = (
            torch.round(x).bfloat16().double() for x in (rows * one[:, None], bias * one)
        )
        too_long = whole.abs().sum(1) * largest + added.abs() >= _HELD
        if not too_long.any():
            return (whole / one[:, None]).reshape(weight.shape), added / one
        bits = bits - too_long.double()


@dataclass(frozen=True, eq=False)
class _Block:
    expand: _Layer | None
    filter: _Layer
    project: _Layer

    def __call__(self, x: Tensor) -> Tensor:
        inner = self.filter.ringed(x)
        if self.expand is not None:  # after the ring: a sixth to copy
            inner = _clipped(self.expand.sums(inner))
            self.filter.blank(inner)
        out = self.project.sums(_clipped(self.filter.sums(inner)))
        return _LARGE.settled(out + x if out.shape == x.shape else out)


@dataclass(frozen=True, eq=False)
class _Mix:
    filter: _Layer
    widen: _Layer
    project: _Layer

    def __call__(self, x: Tensor) -> Tensor:
        wide = F.relu(_NORMED.settled(self.widen.sums(_NORMED.settled(self.filter(x)))))
        return _LARGE.settled(self.project.sums(wide) + x)


class ExactNetwork:
    """A network with what it has learned: pictures to answers, the same on every processor."""

    @torch.no_grad()
    def __init__(self, network: Network, bfloat16: bool | None = None) -> None:
        """bfloat16: compute in it, else in float32; None: in what the processor is faster with."""
        if bfloat16 is None:
            bfloat16 = has_bfloat16()
        make = _Maker(torch.bfloat16 if bfloat16 else torch.float32)
        n, spots, layer = network, network.spots, make.layer
        mean, spread = n.mean.double().flatten(), n.spread.double().flatten()
        self.stem = layer(n.stem, _PIXEL, _CLIPPED, before=(1 / (255 * spread), -mean / spread))
        self.blocks = [make.block(b) for b in n.blocks if isinstance(b, Block)]
        self.coarse = layer(n.coarse, _LARGE, _LARGE)
        self.level = torch.round(n.level * _LARGE.one).bfloat16()
        self.around = [make.mix(m) for m in n.around if isinstance(m, Mix)]
        self.context = [make.mix(m) for m in n.context if isinstance(m, Mix)]
        self.middle_in, self.middle = layer(n.middle_in, _LARGE, _LARGE), make.mix(n.middle)
        self.down, self.fine_in = layer(n.down, _LARGE, _FINE), layer(n.fine_in, _LARGE, _FINE)
        self.fine, self.answers = layer(n.fine, _FINE, _LARGE), layer(n.answers, _LARGE, _LARGE)
        self.looks = [
            layer(look[1], _LARGE, _NORMED, before=_normalisation(look[0]))
            for look in n.looks
            if isinstance(look, nn.Sequential)
        ]
        self.widen = [
            layer(conv, _LARGE, _NORMED, before=_normalisation(norm))
            for norm, conv in zip(spots.norm, spots.widen, strict=True)
        ]
        self.project = layer(spots.project, _NORMED, _NORMED)
        self.centre = [x.float()[:, None, None] for x in _normalisation(n.centre)]

    def __call__(self, picture: NDArray[np.uint8]) -> dict[str, NDArray[np.float32]]:
        """Answers a cell, (channels, rows / 4, columns / 4) each: ``ANSWERS``, and ``local``.

        picture: (rows, columns, 3) uint8 RGB; see ``raster``.
        """
        with torch.inference_mode():
            pixels = torch.from_numpy(picture).permute(2, 0, 1)[None].bfloat16()
            found = self._answers(pixels.contiguous(memory_format=torch.channels_last))
            return {name: answer[0].numpy() for name, answer in found.items()}

    def _answers(self, x: Tensor) -> dict[str, Tensor]:
        x, seen = _clipped(self.stem(x)), []
        for block in self.blocks:
            x = block(x)
            seen.append(x)
        stride_4, stride_8, stride_16 = seen[STRIDE_4], seen[STRIDE_8], x
        x = _LARGE.settled(self.coarse(x) + self.level)
        around = _LARGE.settled(F.avg_pool2d(x, 2, ceil_mode=True))
        for mix in self.around:
            around = mix(around)
        wide = _LARGE.settled(x + twice(around)[..., : x.shape[-2], : x.shape[-1]])
        for mix in self.context:
            wide = mix(wide)
        wide = self.middle(_LARGE.settled(twice(wide) + self.middle_in(stride_8)))
        fine = _FINE.settled(twice(self.down(wide)) + self.fine_in(stride_4))
        found = self.answers(F.relu(_LARGE.settled(self.fine(fine)))).float() / _LARGE.one
        answers = dict(zip(ANSWERS, found.split(list(ANSWERS.values()), dim=1), strict=True))
        looks = [
            look(x).float() / _NORMED.one
            for look, x in zip(self.looks, (stride_4, stride_8, stride_16), strict=True)
        ]
        embedding = answers["embedding"] + looks[0] + twice(looks[1] + twice(looks[2]))
        factor, summand = self.centre
        answers["embedding"] = embedding * factor + summand
        fine *= _LARGE.one / _FINE.one
        answers["local"] = self._spots(stride_16, stride_8, torch.cat([stride_4, fine], 1))
        return answers

    def _spots(self, *coarse_to_fine: Tensor) -> Tensor:
        a, b, c = (widen(x) for widen, x in zip(self.widen, coarse_to_fine, strict=True))
        both = c + twice(b + twice(a, "bilinear"), "bilinear")
        hidden, direct = both.split([HIDDEN, LOCAL], dim=1)
        found = self.project(F.relu(_NORMED.settled(hidden))).float() + direct.float()
        return found / _NORMED.one
