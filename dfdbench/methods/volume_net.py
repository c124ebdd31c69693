"""The method ``volume-net``: a network reads how well each depth's blur explains the images."""

import copy
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from dfdbench.blur.recipe import LAST_LEVEL
from dfdbench.errors import MethodError
from dfdbench.methods.choices import FEWEST, energy_of, shares_of
from dfdbench.methods.edges import within_edges
from dfdbench.methods.fitted import REFIT, Image, Solver, evenly_spread, learned_array, wrong
from dfdbench.methods.measured_law import Calibration
from dfdbench.methods.method import Learned, TrainingPair
from dfdbench.methods.networks.inference import find_device
from dfdbench.methods.networks.volume import MOST, VolumeNet, mean_and_variance
from dfdbench.methods.networks.weights import open_weights
from dfdbench.methods.posterior import Posterior
from dfdbench.methods.readout import AS_USUAL, Chosen, rescaled
from dfdbench.methods.sgm import DIRECTIONS, path_costs_by_bands
from dfdbench.methods.sgm import MOST as MOST_OF_PATHS
from dfdbench.methods.volume_costs import (
    UNIT,
    all_costs,
    along_paths,
    finer_levels,
    guide_of,
    halved,
    levels_of,
    padded,
)
from dfdbench.system.compiled import compiled

Array = NDArray[Any]

# Looking again: how many times as coarse a nat's integer cost is; nats that costs are cut off at,
# and of a step of one level and of more, as for `SemiGlobal`.
_COARSER, _LIMIT, _STEPS = 16, 100, (0.5, 15.0)
# What the fit tries: not to look again, or within so many standard deviations of the network's
# answer, with so many times the usual smoothing; and each of these smoothed within the image's
# edges, with these strengths and this contrast.
_TRIED = ((0.0, 1), *((reach, smoothing) for smoothing in (1, 2, 13) for reach in (1.0, 2.0, 4.0)))
_STRENGTHS = (0.0, 100.0, 1000.0)
_CONTRAST = 2.0
# What a nat counts in the mean over levels, and nats that count nothing: as sharp as erred least on
# training captures of Middlebury's tracks.
_SHARPNESS, _NOTHING = 3.0, 4.0
# Training captures that it is tried on, evenly among all.
_LOOKED_AT = 32
# Standard errors that a mean gain has to exceed: with two dozen captures or more, chance alone
# brings one of those that are tried so far in one fit of twenty.
_SURE, _ROUNDING = 3.0, 0.5
# A number rounded to whole levels has this variance, in squared levels: no spread is less.
_SMALLEST = 1 / 12
# The depth of each level where depth is in levels; the name of another such scale in what a fit
# learned.
_LEVELS, _DEPTHS = np.arange(LAST_LEVEL + 1.0), "depths"
# Side of the window that a spread is averaged over: where an answer is wrong, all of a surface is.
# On training captures of three cameras and of tracks the surer half then errs up to an eighth less.
_SURFACE = (13, 13)


def looked_again(
    costs: NDArray[np.uint16],
    levels: NDArray[np.intp],
    mean: NDArray[np.float32],
    deviation: NDArray[np.float32],
    smoothing: float = 1,
    posterior: Posterior | None = None,
) -> NDArray[np.float32]:
    """Return the mean level by the costs along paths, in finer steps, about a network's answer.

    The network sees coarse levels, and larger pixels. Where the law explains the images, what lies
    between them tells more; the answer counts beside it, as a normal distribution of depth.

    Parameters
    ----------
    costs : ndarray of uint16, shape (y, x, level)
        What the levels cost, 64 a nat; written over.
    levels : ndarray of int, shape (level,)
    mean, deviation : ndarray of float32, shape (y, x)
        The answer and its standard deviation, in levels.
    smoothing : float
        How many times as much a step along a path costs as of a pair by default.
    posterior : Posterior, optional
        Told what every second level costs.

    Returns
    -------
    ndarray of float32, shape (y, x)
    """
    unit = UNIT // _COARSER
    small, large = (min(round(unit * smoothing * step), MOST_OF_PATHS // 2) for step in _STEPS)
    narrow = np.float32(unit / 2) / np.square(deviation)
    _weigh_in(costs, levels, mean, narrow, unit * MOST)
    if posterior is not None:
        planes = np.empty((len(levels[::2]), *mean.shape), np.uint16)
        _part(costs, 2, planes)
        posterior.add_all(levels[::2], planes, unit)
    found, nat = np.empty(mean.shape, np.float32), unit * DIRECTIONS
    weights = np.exp(-_SHARPNESS / nat * np.arange(_NOTHING * nat)).astype(np.float32)
    for rows, sums in path_costs_by_bands(costs.__getitem__, costs.shape, small, large):
        _mean_levels(sums, levels, weights, found[rows])
    return found


@compiled()
def _weigh_in(costs: Array, levels: Array, mean: Array, narrow: Array, unlikely: float) -> None:
    """Add to a pixel's costs, in coarser units, how far each level is from its mean, squared."""
    height, width, count = costs.shape
    cut_off = _LIMIT * UNIT // _COARSER
    for y in range(height):
        for x in range(width):
            for level in range(count):
                cost = min((costs[y, x, level] + _COARSER // 2) // _COARSER, cut_off)
                off = np.float32(levels[level]) - mean[y, x]
                far = min(narrow[y, x] * off * off, np.float32(unlikely))
                costs[y, x, level] = np.uint16(cost + np.rint(far))


@compiled()
def _mean_levels(costs: Array, levels: Array, weights: Array, means: Array) -> None:
    """Write each pixel's mean level, weighted by how far a cost is above the least."""
    height, width, count = costs.shape
    for y in range(height):
        for x in range(width):
            pixel = costs[y, x]
            least = pixel.min()
            total = mean = np.float32(0)
            for label in range(count):
                above = pixel[label] - least
                if above < len(weights):
                    total += weights[above]
                    mean += weights[above] * np.float32(levels[label])
            means[y, x] = mean / total


@compiled()
def _part(costs: Array, step: int, planes: Array) -> None:
    """Write every so manieth level's costs, shape (level, y, x)."""
    height, width, _ = costs.shape
    for y in range(height):
        for x in range(width):
            for level in range(len(planes)):
                planes[level, y, x] = costs[y, x, step * level]


class VolumeNetMethod(Solver):
    """Depth by a network that reads how well the blur of each depth explains the images.

    The fit measures the camera's blur and how often training shows each depth. What each of 32
    levels costs a pixel under that blur goes into a small network, trained on rendered rooms seen
    by many lenses, and so made for none. Where the blur explains the images well, finer levels tell
    more: about the network's answer they are looked at along paths, as `sgm` does. The answer may
    be smoothed `within_edges`. Either is done if the gain on training captures is beyond chance.

    The network's answer is the mean over depth in the data set's own unit: a mean of metres errs
    less in metres than a mean of levels. Looking again gives a mean of levels.

    Parameters
    ----------
    weights : str or Path
        A file that ``dfdbench train volume-net`` wrote, or the name of shipped weights.
    prior : bool
        Tell the network how often training shows each depth.
    finer : bool
        Let the fit find out whether it helps to look again, in finer steps, about what the network
        says, and to smooth the answer within the image's edges.
    sure : bool
        Also say how sure it is, in levels: the distribution's standard deviation, averaged over 13
        by 13 pixels, or, where it looks again, the spread of the costs about the answer, as of a
        `Solver`; times the factor with which its intervals hold on the training captures.
    device : str
        ``cpu``, ``cuda``, ``mps``, or ``auto`` for the fastest that there is.

    Raises
    ------
    MethodError
        Where the weights are absent, damaged, or of another architecture; at a call without fit.

    Notes
    -----
    The camera's own blur in a cost volume, so that a network moves to another camera: Fujimura et
    al., Deep depth from focal stack with defocus model for camera-setting invariance, IJCV 2023.

    Examples
    --------
    >>> VolumeNetMethod().trained_on
    'rooms of unseen-0 from 1000 on, seen by random lenses'
    """

    paper = "Fujimura et al., IJCV 2023, doi 10.1007/s11263-023-01964-x, for the idea"

    def __init__(
        self,
        weights: str | Path = "unseen",
        prior: bool = True,
        finer: bool = True,
        sure: bool = True,
        device: str = "auto",
    ) -> None:
        super().__init__(None, prior=prior, sure=sure)
        self._depths: NDArray[np.float64] | None = None
        if not isinstance(finer, bool):
            raise MethodError.of(wrong("finer", "true or false", finer))
        self._tried = _TRIED if finer else _TRIED[:1]
        #: Kept in results: the same name may hold other weights tomorrow.
        network, self.card, self.weights_sha256 = open_weights("volume-net", weights)
        assert isinstance(network, VolumeNet)
        self._device = find_device(device)
        # Its volumes come with the levels of a pixel side by side.
        network = network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._network = network.to(self._device)
        self.trained_on = self.card.saw

    def _learned(self, found: Sequence[Calibration], captures: Sequence[TrainingPair]) -> Learned:
        chosen = AS_USUAL
        if self._with_prior:
            read = evenly_spread(len(captures))
            shares = np.stack([shares_of(captures[index]) for index in read])
            chosen = Chosen(energy_of(shares), weight=1.0)
        trial = copy.copy(self)
        trial.calibrations, trial.chosen = tuple(found), chosen
        about, learned = captures[0].about, Calibration.all_as_learned(found)
        if about.kind == "metres":
            trial._depths = about.of_unit(_LEVELS.astype(np.float32), "levels").astype(np.float64)
            learned[_DEPTHS] = trial._depths
        finer, smoothing, strength = trial._best_tried(captures)
        best = replace(chosen, finer=finer, smoothing=smoothing, strength=strength)
        return learned | best.as_learned()

    def restore(self, learned: Learned) -> None:
        """Take over what `fit` learned."""
        learned = dict(learned)
        self._depths = None
        if _DEPTHS in learned:
            depths = learned_array(learned, _DEPTHS, "volume-net", 1)
            way = np.sign(depths[-1] - depths[0])
            right = depths.shape == _LEVELS.shape and way and depths.min() > 0
            if not (right and (way * np.diff(depths) >= 0).all()):
                raise MethodError("not what this method learns", where="volume-net", fix=REFIT)
            self._depths = depths
            del learned[_DEPTHS]
        super().restore(learned)

    def _best_tried(self, captures: Sequence[TrainingPair]) -> tuple[float, int, float]:
        """Return reach, smoothing and strength: what errs least of all that surely helps.

        Gains are of the logarithm of a capture's error: each capture counts alike.
        """
        looked_at = evenly_spread(len(captures), _LOOKED_AT)
        usual = *self._tried[0], _STRENGTHS[0]
        if len(self._tried) == 1 or len(looked_at) < FEWEST:
            return usual
        found = [self._errors_on(captures[index]) for index in looked_at]
        # All are 0 where no depth is known.
        errors = np.array([each for each in found if each.any()])
        if len(errors) < FEWEST:
            return usual
        gains = np.log(errors[:, :1] + _ROUNDING) - np.log(errors + _ROUNDING)
        chance = gains.std(axis=0, ddof=1) / math.sqrt(len(gains))
        helps = gains.mean(axis=0) > _SURE * chance
        helps[0] = True
        best = int(np.argmin(np.where(helps, errors.mean(axis=0), np.inf)))
        strength, tried = divmod(best, len(self._tried))
        return *self._tried[tried], _STRENGTHS[strength]

    def _errors_on(self, capture: TrainingPair) -> NDArray[np.float64]:
        """Return the root mean square error on a capture, in levels of the mean size.

        By strength, and for each by what else is tried.
        """
        if not capture.valid.any():
            return np.zeros(len(_STRENGTHS) * len(self._tried))
        infocus, images = self._images_of(capture)
        costs, depth, deviation = self._said(infocus, images, finer=True)
        answers = [depth]
        for reach, smoothing in self._tried[1:]:
            trial = costs.copy(), depth, deviation, reach, smoothing * len(images)
            answers.append(self._looked_again(*trial)[0])
        maps, errors = np.stack(answers), []
        for strength in _STRENGTHS:
            off = (_smoothed(strength, infocus, maps) - capture.depth)[:, capture.valid]
            errors.append(np.sqrt(np.square(off, dtype=np.float64).mean(axis=1)) / self._span)
        return np.concatenate(errors)

    def _settled(
        self, infocus: Image, images: Sequence[Image]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
        # It has learned where surfaces end.
        chosen = self.chosen
        costs, depth, deviation = self._said(infocus, images, finer=bool(chosen.finer))
        if chosen.finer:
            posterior, smoothing = self._posterior(depth.shape), chosen.smoothing * len(images)
            depth, deviation = self._looked_again(
                costs, depth, deviation, chosen.finer, smoothing, posterior
            )
        else:
            deviation = np.asarray(cv2.blur(deviation, _SURFACE), np.float32)
        depth, deviation = _smoothed(chosen.strength, infocus, np.stack([depth, deviation]))
        levels, deviation = rescaled(depth, deviation, self._scale, _LEVELS)
        return levels, deviation if self._sure.asked else None

    def _looked_again(
        self,
        costs: NDArray[np.uint16],
        depth: NDArray[np.float32],
        deviation: NDArray[np.float32],
        reach: float,
        smoothing: float,
        posterior: Posterior | None = None,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return depth and its deviation as before, by `looked_again`."""
        levels, spread = rescaled(depth, deviation, self._scale, _LEVELS)
        finer, by = finer_levels(self._network.levels), spread * np.float32(reach)
        levels = looked_again(costs, finer, levels, by, smoothing, posterior)
        if posterior is not None:
            spread = posterior.spread_about(levels)
        return rescaled(levels, spread, _LEVELS, self._scale)

    @property
    def _scale(self) -> NDArray[np.float64]:
        """The depth of each level, in the unit of the data set that it was fitted on."""
        return _LEVELS if self._depths is None else self._depths

    @property
    def _span(self) -> float:
        """A level's mean part of the range of depths."""
        return float(np.ptp(self._scale)) / LAST_LEVEL

    def _solve(
        self, infocus: Image, images: Sequence[Image], posterior: Posterior | None = None
    ) -> NDArray[np.float32]:
        return self._settled(infocus, images)[0]

    def _said(
        self, infocus: Image, images: Sequence[Image], finer: bool
    ) -> tuple[NDArray[np.uint16], NDArray[np.float32], NDArray[np.float32]]:
        """Return what levels cost, and the mean and deviation of the depth that the network says.

        The depth is in the unit of the data set that it was fitted on.
        """
        rows, columns = infocus.shape[:2]
        count, multiple = self._network.levels, 2 * self._network.multiple
        laws = [found.law for found in self.calibrations]
        levels, step = (finer_levels(count), 2) if finer else (levels_of(count), 1)
        costs, told = all_costs(laws, infocus, images, levels, step)
        volume, told = halved(costs, told, multiple, step)
        prior = -self.chosen.energy[levels_of(count)].astype(np.float32)
        guide = padded(guide_of(infocus), multiple)
        told = np.log1p(told)[np.newaxis]
        given = (volume, along_paths(volume), told, guide[np.newaxis], prior)
        with torch.inference_mode():
            logits, mask = self._network(*(_one(each).to(self._device) for each in given))
            # The middle of a part of whole levels lies between two of them.
            depths = np.interp(levels_of(count) - 0.5, _LEVELS, self._scale)
            found = mean_and_variance(
                logits, mask, torch.from_numpy(depths).float().to(self._device)
            )
        mean, variance = (each[0, :rows, :columns].cpu().numpy() for each in found)
        return costs, mean, np.sqrt(variance + np.float32(_SMALLEST * self._span**2))


def _smoothed(strength: float, infocus: Image, maps: NDArray[np.float32]) -> NDArray[np.float32]:
    if not strength:
        return maps
    return within_edges(maps, infocus, strength, _CONTRAST).astype(np.float32)


def _one(planes: Array) -> torch.Tensor:
    # PyTorch sees by strides that levels lie side by side, if the first axis has the largest.
    return torch.from_numpy(np.moveaxis(planes, 0, -1))[None].movedim(-1, 1)
