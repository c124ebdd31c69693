"""Graph cuts: the thesis's classical method, with its energy and faster solvers for it."""

import math
import threading
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.law import ROUNDING_VARIANCE, BlurLaw
from dfdbench.blur.recipe import RECIPES
from dfdbench.errors import MethodError, Problem, unknown_name
from dfdbench.methods import mrf
from dfdbench.methods.blurred import all_blurred, information
from dfdbench.methods.data_cost import data_cost
from dfdbench.methods.fitted import Blur, Image, Solver, number_within, wrong
from dfdbench.methods.law_cost import MOST_NATS, add_energy, law_cost
from dfdbench.methods.posterior import Posterior

COLOR_SPACES = ("ycrcb", "ycrcb-float", "rgb")
SOLVERS = ("split", "expansion")
QUALITIES = get_args(mrf.Quality)
# The published table is made for 256 labels; the others take `cap` and `scale` of Table 4.1.
SMOOTHNESS: Mapping[str, Callable[[int, int, int], NDArray[np.int32]]] = {
    "published": lambda levels, cap, scale: mrf.published(levels),
    "truncated-absolute": mrf.truncated_absolute,
    "truncated-quadratic": mrf.truncated_quadratic,
    "potts": lambda levels, cap, scale: mrf.potts(levels, cap * scale),
    "adaptive-potts": lambda levels, cap, scale: mrf.potts(levels, cap * scale),
}
# data_cost stores costs in 16 bits.
_LARGEST_COST = 65535
# Of `weight`, what a nat costs under a blur law.
_PER_NAT = 3
# Of `weight`, the same times what a pixel tells of its level: the noisier the levels that pixels
# would choose by themselves, the more a nat costs, as total variation is weighted by the noise
# that it is to remove.
_PER_ERROR = 24
# What no pixel of a pair may say more: of those that the law does not explain, where surfaces end.
_MOST_NATS = 10


class GraphCuts(Solver):
    """Depth by minimising the thesis's energy: fit of the blur, and smoothness.

    The in-focus image is blurred at every level. A level costs a pixel ``weight`` times the
    squared difference to the defocus image, summed over the channels (Eq. 4.1), and two
    neighbours a function of the difference of their levels (Eq. 4.2, Table 4.1).

    Parameters
    ----------
    recipe : BlurRecipe, BlurLaw or None
        The blur that is solved with; in a run, the data set's recipe. ``text`` on a set made
        with ``published`` gives the mismatch of the program published with the thesis. Where it
        is not told, the method is fitted: see `dfdbench.methods.calibration`.
    weight : float
        c of Eq. 4.1. Under a blur law, which knows its noise, a third of it is the cost of one
        nat, a factor e of probability; more where noise leaves a pixel little to tell.
    smoothness : {"published", "truncated-absolute", "truncated-quadratic", "potts", \
"adaptive-potts"}
        ``published`` is the program's table, the absolute difference up to 228.
    cap, scale : int
        K and beta of Table 4.1, for all but ``published``; the Potts models cost ``cap * scale``.
    threshold : float
        For ``adaptive-potts``: a level change costs twice as much between neighbours whose grey
        values in the in-focus image differ by at most this.
    color_space : {"ycrcb", "ycrcb-float", "rgb"}
        In which images are compared. ``ycrcb`` rounds to 8 bits, as the published program does;
        ``ycrcb-float`` is in 32-bit float, as the thesis says (4.1). A grey image has one
        channel in all. Under a blur law it is always RGB, in which noise is alike.
    labels : int, optional
        Solve for this many evenly spaced levels only; must divide the recipe's levels.
    solver : {"split", "expansion"}
        ``expansion`` is the published algorithm; ``split`` is some thirty times faster.
    quality : {"fast", "default", "high"}
        Of ``split``: how close to the least energy, for how many cuts.
    published_offset : bool
        Add one level, as the published program does.
    prior : bool
        Where the law is fitted: weigh depths by how often training shows them, if that helps there.
    sure : bool
        Also say how sure it is: see `dfdbench.methods.fitted.Solver`.

    Raises
    ------
    MethodError
        For a parameter out of range, all of them named.

    Examples
    --------
    >>> from dfdbench.blur import synthesize
    >>> image = np.random.default_rng(0).integers(0, 256, (40, 40, 3)).astype(np.uint8)
    >>> depth = np.full((40, 40), 120, np.uint8)
    >>> depth[:, 20:] = 180
    >>> defocus = synthesize(image, depth, RECIPES["published"])
    >>> method = GraphCuts()
    >>> found = method(image, defocus)
    >>> bool(np.abs(found - depth).mean() < 1), list(method.numbers)
    (True, ['energy'])
    """

    reads_out = False
    paper = (
        "Emerson, Purdue 2019, ch. 4; Boykov, Veksler and Zabih, Fast approximate energy "
        "minimization via graph cuts, PAMI 2001"
    )

    def __init__(
        self,
        recipe: Blur | None = RECIPES["published"],
        weight: float = 12,
        smoothness: str = "published",
        cap: int = 255,
        scale: int = 1,
        threshold: float = 5,
        color_space: str = "ycrcb",
        labels: int | None = None,
        solver: str = "split",
        quality: str = "default",
        published_offset: bool = False,
        prior: bool = True,
        sure: bool = False,
    ) -> None:
        super().__init__(recipe, prior=prior, sure=sure)
        for kind, name, known in (
            ("smoothness", smoothness, tuple(SMOOTHNESS)),
            ("color_space", color_space, COLOR_SPACES),
            ("solver", solver, SOLVERS),
            ("quality", quality, QUALITIES),
        ):
            if name not in known:
                raise unknown_name(kind, str(name), known)
        count = self.levels if labels is None else labels
        problems = _problems(self.levels, count, weight, cap, scale)
        MethodError.raise_if(problems)
        step = self.levels // count
        self._table = SMOOTHNESS[smoothness](self.levels, cap, scale)[::step]
        edge = 2 if smoothness == "adaptive-potts" else 1
        self._limit = 4 * edge * int(self._table.max()) + 1
        if self._limit > _LARGEST_COST:
            most = (_LARGEST_COST - 1) // (4 * edge)
            expected = f"a largest smoothness of {most}"
            raise MethodError.of(wrong("cap and scale", expected, int(self._table.max())))
        self._weight = weight
        # The middle of each group of levels stands for it.
        self._levels = np.arange(step // 2, self.levels, step)
        self._threshold = threshold if smoothness == "adaptive-potts" else None
        self._color_space = color_space
        self._solver, self._quality = solver, quality
        self._offset = 1 if published_offset else 0
        # A thread's pairs share the memory of their costs, the largest array by far.
        self._memory = threading.local()

    @property
    def numbers(self) -> Mapping[str, float]:
        """The ``energy`` that the last call in this thread reached."""
        numbers: Mapping[str, float] = getattr(self._memory, "numbers", {})
        return numbers

    def _solve(
        self, infocus: Image, images: Sequence[Image], posterior: Posterior | None = None
    ) -> NDArray[np.float32]:
        solution = self._solved(self._energy(infocus, images, held=posterior is not None))
        if posterior is not None:
            costs = np.moveaxis(self._memory.costs, 2, 0)
            posterior.add_all(self.blur.depth_of_level(self._levels), costs, self._memory.nat)
        self._memory.numbers = {"energy": float(solution.energy)}
        depth = self.blur.depth_of_level(self._levels[solution.labels])
        return np.asarray(np.minimum(depth + self._offset, 255), np.float32)

    def solve(self, infocus: Image, *images: Image) -> mrf.Solution:
        """Return the solver's labels, energy and history."""
        return self._solved(self._energy(infocus, images))

    def _solved(self, energy: mrf.Energy) -> mrf.Solution:
        if self._solver == "expansion":
            return mrf.expansion(energy)
        return mrf.split(energy, self._quality)  # type: ignore[arg-type]

    def energy(self, infocus: Image, *images: Image) -> mrf.Energy:
        """Return what is minimised for a pair, or a stack: Eq. 4.2 with integer costs.

        Its costs lie in memory that the next call in this thread writes over.
        """
        return self._energy(infocus, images, held=True)

    def _energy(self, infocus: Image, images: Sequence[Image], held: bool = False) -> mrf.Energy:
        """Return the energy, its costs in parts where they are large and need not be held."""
        shape = (*infocus.shape[:2], len(self._levels))
        right, down = None, None
        if self._threshold is not None:
            grey = infocus if infocus.ndim == 2 else cv2.cvtColor(infocus, cv2.COLOR_RGB2GRAY)
            right, down = mrf.adaptive_potts_weights(np.asarray(grey), self._threshold)
        blur = self.blur
        if isinstance(blur, BlurLaw):
            cost = self._law_cost(infocus, images)
            # A stack's are of many images, each blurred for all rows at once.
            held = held or len(images) > 1
        else:
            # Of a recipe's residuals nothing is known but that images are rounded.
            self._memory.nat = 2 * ROUNDING_VARIANCE * self._weight
            cost = partial(
                data_cost,
                self._channels(infocus),
                self._channels(images[0]),
                blur.sigmas[self._levels],
                self._weight,
                self._limit,
                blur.kernel_size,
            )
        if held or 2 * math.prod(shape) <= mrf.MOST_HELD:
            unary, offset = cost(out=self._room(shape))
            return mrf.Energy(unary, self._table, right, down, offset)
        parts = mrf.Parts(cost, shape, self._limit)
        return mrf.Energy(parts, self._table, right, down, parts.offset())

    def _room(self, shape: tuple[int, ...]) -> NDArray[np.uint16]:
        memory: NDArray[np.uint16] | None = getattr(self._memory, "costs", None)
        if memory is None or memory.shape != shape:
            self._memory.costs = memory = None
            self._memory.costs = memory = np.empty(shape, np.uint16)
        return memory

    def _law_cost(self, infocus: Image, images: Sequence[Image]) -> Callable[..., tuple[Any, int]]:
        """Return what gives the costs of a part under the laws, and the sum of the least costs."""
        blurred = partial(all_blurred, self.blurs, infocus, images, self._levels)
        pair = len(images) == 1
        # Of a stack it is made twice, as nobody could hold it all.
        held = list(blurred()) if pair else []
        told = math.fsum(map(partial(information, levels=self._levels), held or blurred()))
        self._memory.nat = nat = self._nat(told) / self.chosen.smoothing
        limit = min(math.ceil((_MOST_NATS if pair else MOST_NATS) * nat), self._limit)
        ceiling = math.inf if pair else limit
        energy = nat * self.chosen.energy[self._levels] if self.chosen.weight else None

        def cost(
            rows: slice = slice(None), columns: slice = slice(None), out: Any = None
        ) -> tuple[Any, int]:
            offset, add = 0, False
            for one in held or blurred():
                part = one.part(rows, columns)
                out, more = law_cost(part, nat, limit, out, add, ceiling)
                offset, add = offset + more, True
                # Before the next is made: they are large.
                del one, part
            return out, offset + (0 if energy is None else add_energy(out, energy, self._limit))

        return cost

    def _nat(self, told: float) -> float:
        """Return the integer cost of a nat, where a pixel has so much information on its level."""
        most = self._limit / _MOST_NATS
        least = self._weight / _PER_NAT
        return max(
            least, min(most, self._weight / (_PER_ERROR * math.sqrt(told))) if told else least
        )

    def _channels(self, image: Image) -> Image | NDArray[np.float32]:
        if image.ndim == 2:
            return image[:, :, np.newaxis]
        if self._color_space == "rgb" or image.shape[2] != 3:
            return image
        if self._color_space == "ycrcb-float":
            # OpenCV centres these Cr and Cb on 0.5, not 128: the images' difference has neither.
            exact = cv2.cvtColor(image.astype(np.float32), cv2.COLOR_RGB2YCrCb)
            return np.asarray(exact, np.float32)
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2YCrCb), np.uint8)


def _problems(levels: int, count: Any, weight: Any, cap: Any, scale: Any) -> list[Problem]:
    problems = []
    if not isinstance(count, int) or count < 2 or count > levels or levels % count:
        divisors = [number for number in range(2, levels + 1) if levels % number == 0]
        problems.append(wrong("labels", f"one of {divisors}", count))
    problems += number_within("weight", weight, 5000)
    for name, number in (("cap", cap), ("scale", scale)):
        if not isinstance(number, int) or number < 1:
            problems.append(wrong(name, "a whole number above 0", number))
    return problems
