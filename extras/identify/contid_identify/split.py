"""Which part of a recording is fitted and which is kept out: blocks of time, every fifth kept out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from contid.kinematics.array import Array

Mask: TypeAlias = NDArray[np.bool_]

#: Blocks of a recording; of the first five the middle one is kept out, and so on.
BLOCKS: Final = 30
_EVERY: Final = 5
_KEPT: Final = 2
#: Pieces of a block, over which the bootstrap of errors draws.
_PIECES: Final = 4
#: Pieces of a decay, over which errors may be correlated.
_DECAY_PIECES: Final = 6


@dataclass(frozen=True, eq=False)
class TimeSplit:
    """Blocks of time of each sample.

    Attributes:
        blocks: number of the block of each sample.
        pieces: number of its piece of a block.
        kept_out: whether it is kept out of the fit.
        ends_s: times of the first sample and the last.
    """

    blocks: Array
    pieces: Array
    kept_out: Mask
    ends_s: tuple[float, float] = (0.0, 1.0)

    @property
    def fitted(self) -> Mask:
        """Mask of the samples of the fit."""
        return ~self.kept_out

    def kept_out_at(self, at_s: Array) -> Mask:
        """Mask of other times ``at_s`` between the first sample and the last."""
        return np.asarray(_block_of(at_s, self.ends_s) % _EVERY == _KEPT)


def split_time(at_s: Array) -> TimeSplit:
    """The split of samples by their times, in blocks of equal duration."""
    ends_s = (float(at_s[0]), float(at_s[-1]))
    blocks = _block_of(at_s, ends_s)
    return TimeSplit(blocks, _block_of(at_s, ends_s, BLOCKS * _PIECES), blocks % _EVERY == _KEPT, ends_s)


def _block_of(at_s: Array, ends_s: tuple[float, float], count: int = BLOCKS) -> Array:
    span = max(ends_s[1] - ends_s[0], 1e-9)
    return np.asarray(np.floor((at_s - ends_s[0]) / span * (1.0 - 1e-12) * count).astype(int))


def joined_split(times: Sequence[Array]) -> TimeSplit:
    """The split of several recordings, one after the other; each has blocks of its own."""
    splits = [split_time(each) for each in times]
    return TimeSplit(
        np.concatenate([each.blocks + k * BLOCKS for k, each in enumerate(splits)]),
        np.concatenate([each.pieces + k * BLOCKS * _PIECES for k, each in enumerate(splits)]),
        np.concatenate([each.kept_out for each in splits]),
    )


def decay_blocks(counts: Sequence[int]) -> Array:
    """The number of the block of each sample of decays one after the other; a decay has blocks of its own."""
    return np.concatenate(
        [k * _DECAY_PIECES + np.arange(count) * _DECAY_PIECES // count for k, count in enumerate(counts)]
    )
