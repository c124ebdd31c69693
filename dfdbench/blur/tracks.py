"""Tracks: the same scenes made harder in a way that methods do not know."""

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from dfdbench.errors import UnknownNameError

#: The label of images without a track: the method knows the blur.
CLEAN = "clean"

_GAUSSIAN = 2.0
#: The exponent at which a point-spread function is practically a disk: it falls from 90 % to 10 %
#: of its height within a tenth of its radius.
DISK = 32.0


@dataclass(frozen=True)
class Formation:
    """How a pair's images come about, where that departs from the data set's blur recipe.

    Parameters
    ----------
    sigma_min, sigma_step : float
        Factors for the recipe's own `sigma_min` and `sigma_step`.
    exponent : float
        p of the point-spread function, see `dfdbench.blur.point_spread`.
    layers : bool
        Composite layers from back to front instead of blurring each pixel on its own.
    shift : float
        How far the defocus image is shifted, in pixels; the direction is drawn for each pair.
    gain : float
        The defocus image's largest change in brightness, as a share; drawn for each pair.
    noise : float
        Standard deviation of Gaussian noise on both images, in grey levels.
    linear : bool
        Blur in linear light: both images are decoded and encoded by the sRGB curve.
    read_noise : float
        Standard deviation of the noise that does not depend on the light, as a share of full
        scale.
    full_well : float
        Electrons at full scale, which set the shot noise; 0 for none.
    planes : int
        The number of images, focused at evenly spaced depth levels, that replace the defocus image.
    infocus : bool
        Whether there is an image in focus everywhere.
    magnification : float
        How much larger the defocus image is, about the middle, as a share.
    falloff : tuple of float
        The light missing at the corners of the defocus image, as two shares that go with r^2 and
        r^4; r is 1 at the corners.
    lateral : float
        How much larger red, and smaller blue, is in both images, as a share.
    longitudinal : float
        How many depth levels red is further out of focus than green; 0.7 times as many for blue.
    """

    sigma_min: float = 1.0
    sigma_step: float = 1.0
    exponent: float = _GAUSSIAN
    layers: bool = False
    shift: float = 0.0
    gain: float = 0.0
    noise: float = 0.0
    linear: bool = False
    read_noise: float = 0.0
    full_well: float = 0.0
    planes: int = 0
    infocus: bool = True
    magnification: float = 0.0
    falloff: tuple[float, float] = (0.0, 0.0)
    lateral: float = 0.0
    longitudinal: float = 0.0

    @property
    def whole(self) -> bool:
        """Whether pixels depend on their position in the image, so that patches do not show it."""
        return bool(self.magnification or self.lateral or any(self.falloff))


@dataclass(frozen=True)
class Track:
    """Something that methods rely on, taken away in three severities.

    A released track never changes; a change is a new version. Severity 0 is the data set itself.

    Parameters
    ----------
    name, version : str, int
        Stores carry both in their names.
    title : str
        What differs, in a few words.
    steps : tuple of str
        What differs at each severity, from 1 on, in words.
    severities : tuple of Formation
        How the images are formed at each severity.
    """

    name: str
    version: int
    title: str
    steps: tuple[str, ...]
    severities: tuple[Formation, ...]

    @property
    def labels(self) -> list[str]:
        """Its name with each severity, such as ``noise-1``."""
        return [f"{self.name}-{number}" for number in range(1, len(self.severities) + 1)]


@dataclass(frozen=True)
class Degradation:
    """A track at one of its severities.

    Parameters
    ----------
    track : Track
        The track.
    severity : int
        From 0, which is clean.

    Examples
    --------
    >>> found = find_degradation("noise-2")
    >>> found.label, found.formation.noise
    ('noise-2', 3.0)
    """

    track: Track
    severity: int

    @property
    def label(self) -> str:
        """The part after ``@`` in a data set's name; ``clean`` at severity 0."""
        return f"{self.track.name}-{self.severity}" if self.severity else CLEAN

    @property
    def formation(self) -> Formation:
        """How the images come about."""
        return self.track.severities[self.severity - 1] if self.severity else Formation()

    @property
    def text(self) -> str:
        """What differs, in a few words."""
        return f"{self.track.title}: {self.track.steps[self.severity - 1]}"


def _track(name: str, title: str, steps: Iterable[str], severities: Iterable[Formation]) -> Track:
    """Return the first version of a track."""
    return Track(name, 1, title, tuple(steps), tuple(severities))


# How the light missing at the corners is split between r^2 and r^4 was drawn, not chosen.
_MAGNIFICATIONS = (0.002, 0.006, 0.012)
_FALLOFFS = ((0.0169, 0.0831), (0.0411, 0.1589), (0.2271, 0.1229))
_COLOURS = ((0.0004, 4.0), (0.0008, 8.0), (0.0016, 16.0))
_CAMERAS = tuple(
    Formation(exponent=DISK, layers=True, linear=True, read_noise=read, full_well=10 / read)
    for read in (0.001, 0.003, 0.01)
)

_ALL = (
    _track(
        "noise",
        "Gaussian noise on both images before they are rounded",
        map("sigma {:g} grey levels".format, (1, 3, 6)),
        (Formation(noise=sigma) for sigma in (1.0, 3.0, 6.0)),
    ),
    _track(
        "psf",
        "another point-spread function, exp(-(r / c)^p), as wide at every level as the recipe's",
        map("p = {:g}".format, (3, 8, 32)),
        (Formation(exponent=p) for p in (3.0, 8.0, DISK)),
    ),
    _track(
        "law",
        "the least blur and what each level adds, both drawn once a severity",
        map("within {:g} %".format, (10, 20, 40)),
        # Drawn, not chosen: up or down, by between half of the range and all of it.
        (
            Formation(sigma_min=1.0985, sigma_step=0.9261),
            Formation(sigma_min=1.1589, sigma_step=0.848),
            Formation(sigma_min=1.2461, sigma_step=1.2914),
        ),
    ),
    _track(
        "occlusion",
        "layers composited from back to front, as light does, and wider blur",
        map("blur times {:g}".format, (1, 1.5, 2)),
        (Formation(sigma_min=k, sigma_step=k, layers=True) for k in (1.0, 1.5, 2.0)),
    ),
    _track(
        "shift",
        "the defocus image moved against the in-focus one, another way each pair",
        map("{:g} pixel".format, (0.25, 0.5, 1)),
        (Formation(shift=pixels) for pixels in (0.25, 0.5, 1.0)),
    ),
    _track(
        "gain",
        "the defocus image brighter or darker, drawn each pair",
        map("within {:g} %".format, (2, 5, 10)),
        (Formation(gain=share) for share in (0.02, 0.05, 0.1)),
    ),
    _track(
        "camera",
        "a camera: linear light, a disk, layers, shot and read noise on both images",
        map("read noise 10 electrons, {:,} at full scale".format, (10_000, 3_333, 1_000)),
        _CAMERAS,
    ),
    _track(
        "magnification",
        "the defocus image larger about the middle, as a lens breathes that focuses elsewhere",
        map("{:g} %".format, (0.2, 0.6, 1.2)),
        (Formation(magnification=share) for share in _MAGNIFICATIONS),
    ),
    _track(
        "vignetting",
        "the defocus image darker towards the corners, as a wide aperture makes it",
        map("{:g} % less light at the corners".format, (10, 20, 35)),
        (Formation(falloff=falloff) for falloff in _FALLOFFS),
    ),
    _track(
        "colour",
        "red larger and blue smaller in both images, and both farther off focus than green",
        ("0.04 %, 4 levels", "0.08 %, 8 levels", "0.16 %, 16 levels"),
        (Formation(lateral=share, longitudinal=off) for share, off in _COLOURS),
    ),
    _track(
        "lens",
        "a camera as on the track camera, with magnification, fall-off and colour errors",
        map("severity {:g} of each".format, (1, 2, 3)),
        (
            replace(camera, magnification=share, falloff=falloff, lateral=lateral, longitudinal=off)
            for camera, share, falloff, (lateral, off) in zip(
                _CAMERAS, _MAGNIFICATIONS, _FALLOFFS, _COLOURS, strict=True
            )
        ),
    ),
)

_PLANES = range(1, 11)
#: Focal stacks: their severity is the number of focus planes.
STACKS: Mapping[str, Track] = {
    name: _track(
        name,
        title,
        map("{:g} focus planes".format, _PLANES),
        (Formation(layers=True, planes=count, infocus=infocus) for count in _PLANES),
    )
    for name, title, infocus in (
        ("stack", "a focal stack beside the in-focus image", True),
        ("stack-only", "a focal stack without an in-focus image", False),
    )
}

#: The tracks by name.
TRACKS: Mapping[str, Track] = {track.name: track for track in _ALL}
#: The tracks that show in patches of an image, on which networks are trained.
OF_PATCHES = tuple(track.name for track in _ALL if not track.severities[0].whole)
_FIRST = ("noise", "psf", "law", "occlusion", "shift", "gain", "camera")
#: The suites that rank the leaderboard's rows: tracks at their severities, by the suite's name. A
#: suite never changes, so rows keep their ranks; new tracks go into the next suite.
SUITES: Mapping[str, tuple[str, ...]] = {
    suite: tuple(f"{name}-{severity}" for name in names for severity in (1, 2, 3))
    for suite, names in (
        ("tracks-1", _FIRST),
        ("tracks-2", (*_FIRST, "magnification", "vignetting", "colour", "lens")),
    )
} | {label: (label,) for label in ("stack-5", "stack-9")}


def find_degradation(label: str) -> Degradation:
    """Return a track at a severity, from ``TRACK-SEVERITY``.

    Raises
    ------
    UnknownNameError
        If there is no such track or severity; it names the near misses.

    Examples
    --------
    >>> find_degradation("camera-2").track.title
    'a camera: linear light, a disk, layers, shot and read noise on both images'
    >>> find_degradation("camera-0").label
    'clean'
    """
    known = {
        f"{track.name}-{severity}": Degradation(track, severity)
        for track in (*TRACKS.values(), *STACKS.values())
        for severity in range(len(track.severities) + 1)
    }
    if label in known:
        return known[label]
    # Match the whole label: for "noise1", the track's name alone would be half an answer.
    near = difflib.get_close_matches(label[:99].casefold(), known, n=3, cutoff=0.6)
    fix = f"did you mean {' or '.join(near)}? " if near else ""
    names = ", ".join((*TRACKS, *STACKS))
    expected = f"TRACK-SEVERITY, of: {names}; severities from 0, which is {CLEAN}"
    fix = f"{fix}`dfdbench list` shows them all."
    raise UnknownNameError(f"unknown track {label!r}", expected=expected, fix=fix)
