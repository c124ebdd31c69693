"""How a network is trained: a checked record of every choice, and the files that hold it."""

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import torch
from pydantic import Field, ValidationError, ValidationInfo, field_validator, model_validator

from dfdbench.blur.tracks import OF_PATCHES
from dfdbench.errors import InputError, Problem
from dfdbench.methods.networks.architectures import UNET_FILTERS
from dfdbench.methods.networks.choices import FILTERS, SITES, SIZED, narrowed, plain_choices
from dfdbench.methods.networks.inference import Readout
from dfdbench.system.files import read_as
from dfdbench.system.strict import Positive, Record, problems_of
from dfdbench.system.text import parse_toml

Count = Annotated[int, Field(ge=1)]
Expansion = Literal["eight", "basic", "one"]
#: Division by more than this makes no sense.
_NARROWEST = 128
_ONE_A_FILTER = Field(min_length=len(SIZED), max_length=len(SIZED))
_ONE_A_SITE = Field(min_length=len(SITES), max_length=len(SITES))
_Beta = Annotated[float, Field(ge=0, lt=1)]
#: Rows and columns of a filter, or one number for both.
_Size = int | tuple[int, int]
_Activation = Literal["relu", "prelu", "sigmoid", "tanh", "elu", "srelu"]
_OF_DFD_NET = ("sampling_size", "first_activation", "kernels", "activations")
#: Processors without one of these emulate bf16, and training takes twenty times as long.
_BF16_INSTRUCTIONS = ("amx_bf16", "avx512_bf16")


class TrainingConfiguration(Record):
    """All choices of a training but the data and the seed.

    Defaults are the thesis's (5.2). Its text does not say how many patches make a step; 28 follows
    from its author's sources and its Fig. 5.8.

    Parameters
    ----------
    filters : str or list of int, optional
        A name of Table D.2, or the numbers themselves; by default the published ones.
    narrow : int
        Divide all widths but the last by this.
    sampling_size : int
        Filters that halve and double the resolution (5.4.5); DfD-Net only.
    first_activation : {"prelu", "sigmoid"}
        ``sigmoid`` is the particle swarm's choice (6.1); DfD-Net only.
    kernels, activations, normalized : list, optional
        What else a particle describes, as in `DfDNet`: 14 filter sizes, 9 activations in place of
        `first_activation` and PReLU, and which of 9 sites have batch normalization. For U-Net true
        or false: batch normalization after each convolution, or none, as published.
    crop : int
        Rows and columns of the image patches.
    crops_per_step : int
        Patches drawn for each step, before expansion.
    expansion : {"eight", "basic", "one"}
        ``eight``: every patch in four rotations, also mirrored. ``basic``: mirrored left-right,
        then up-down, each with probability 1/2 (5.2.1). ``one``: in one of all eight, drawn at
        random.
    noise : float
        Standard deviation of Gaussian noise on all six channels, in grey levels (5.4.4).
    redraw_depth : bool
        Move each patch's depth map to another level within those of the training pairs, tilt it,
        and blur the in-focus patch anew. Then few scenes show every level on every texture.
    recipe : {"published", "text"}, optional
        For `redraw_depth`: the blur recipe; by default the data set's, if it has one.
    tilt : float
        For `redraw_depth`: the steepest slope added along rows and columns, in levels per pixel.
    tracks : list of str
        Draw one of these tracks for each patch, with a severity from 0 (clean) to 3, and form both
        images of the patch by it. Needs `redraw_depth`.
    unknown : {"level", "ignore"}
        Pixels without ground truth: train them as the level they are stored with, or leave them
        out.
    initial_filters : {"random", "differences"}
        ``differences``: the first convolution starts from differences of the two images.
    normalization : {"batch", "fixed"}
        Normalise by the means of each batch, or by those stored with the initial weights, as in
        inference. The means of small batches say more about their textures than about blur.
    label_width : float
        0: cross-entropy with the true level. Above 0: with a Gaussian of this standard deviation
        around it, in levels, so that near misses count as such.
    learning_rate, weight_decay, betas
        Parameters of Adam.
    decay_prelu : bool
        Apply weight decay to the slopes of the PReLUs too, as in dlib, not only to filters. It is
        independent of the schedule. U-Net has no PReLU.
    schedule : {"dlib", "cosine"}
        Lower the learning rate if the loss makes no progress, as dlib's trainer judges it, or along
        a cosine to 0.
    patience, shrink, minimum_learning_rate
        For ``dlib``: steps without progress, factor, and the rate at which training ends.
    steps : int, optional
        Training ends at this step at the latest; ``cosine`` needs it.
    warm_up : int
        For ``cosine``: steps over which the learning rate rises.
    precision : {"float32", "bf16", "auto"}
        Of all convolutions but the first, which must distinguish differences too small for bf16.
        ``auto``: bf16 if the processor supports it, see `precision_for`.
    readout : {"mode", "median"}
        Which level of a pixel's distribution is the answer, both in logs and when the weights are
        used: the likeliest, as in the thesis, or the median.
    evaluate_every, evaluate_pairs : int
        How often the metrics are logged, and on how many pairs each of training and test.
    """

    filters: str | Annotated[list[Count], Field(min_length=1)] | None = None
    narrow: Annotated[int, Field(ge=1, le=_NARROWEST)] = 1
    sampling_size: Annotated[int, Field(ge=1, le=8)] = 2
    first_activation: Literal["prelu", "sigmoid"] = "prelu"
    kernels: Annotated[list[_Size], _ONE_A_FILTER] | None = None
    activations: Annotated[list[_Activation], _ONE_A_SITE] | None = None
    normalized: bool | Annotated[list[bool], _ONE_A_SITE] | None = None
    crop: Annotated[int, Field(ge=12)] = 32
    crops_per_step: Annotated[int, Field(ge=1, le=65_536)] = 28
    expansion: Expansion = "eight"
    noise: Annotated[float, Field(ge=0, le=100, allow_inf_nan=False)] = 0.0
    redraw_depth: bool = False
    recipe: Literal["published", "text"] | None = None
    tilt: Annotated[float, Field(ge=0, le=8, allow_inf_nan=False)] = 1.0
    tracks: tuple[str, ...] = ()
    unknown: Literal["level", "ignore"] = "level"
    initial_filters: Literal["random", "differences"] = "random"
    normalization: Literal["batch", "fixed"] = "batch"
    label_width: Annotated[float, Field(ge=0, le=64, allow_inf_nan=False)] = 0.0
    learning_rate: Positive = 1e-4
    weight_decay: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0005
    betas: tuple[_Beta, _Beta] = (0.5, 0.99)
    decay_prelu: bool = True
    schedule: Literal["dlib", "cosine"] = "dlib"
    patience: Annotated[int, Field(ge=10)] = 2500
    shrink: Annotated[float, Field(gt=0, lt=1)] = 0.1
    minimum_learning_rate: Positive = 1e-10
    steps: Count | None = None
    warm_up: Annotated[int, Field(ge=0)] = 0
    precision: Literal["float32", "bf16", "auto"] = "float32"
    readout: Readout = "mode"
    evaluate_every: Count = 2500
    evaluate_pairs: Count = 6

    @field_validator("*", mode="before")
    @classmethod
    def _no_switch(cls, value: Any, info: ValidationInfo) -> Any:
        # Python takes true for 1.
        default = cls.model_fields[str(info.field_name)].default
        switch = isinstance(default, bool) or info.field_name == "normalized"
        if isinstance(value, bool) and not switch:
            raise ValueError("a number or a name, not true or false")
        return value

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.schedule == "cosine" and self.steps is None:
            raise ValueError("schedule cosine needs steps")
        if self.recipe and not self.redraw_depth:
            raise ValueError("recipe is of patches whose depth is redrawn: redraw_depth = true")
        for name in self.tracks:
            if name not in OF_PATCHES:
                raise ValueError(f"tracks: any of {', '.join(OF_PATCHES)}, got {name}")
        if isinstance(self.filters, str) and self.filters not in FILTERS:
            raise ValueError(f"filters: one of {', '.join(FILTERS)}, got {self.filters}")
        for size in self.kernels or ():
            if not {*(size if isinstance(size, tuple) else (size,))} <= {1, 3, 5, 7, 9}:
                raise ValueError(f"kernels: odd numbers from 1 to 9, got {size}")
        if self.activations and self.first_activation != "prelu":
            raise ValueError("activations and first_activation both say what comes first")
        return self

    def with_examples_of_eight(self) -> Self:
        """Return it with as many examples per step as its patches give in eight orientations.

        This is how 5.2.1 compares the schemes of expansion.

        Examples
        --------
        >>> TrainingConfiguration(expansion="basic").with_examples_of_eight().crops_per_step
        224
        """
        patches = self.crops_per_step * (1 if self.expansion == "eight" else 8)
        return self.model_copy(update={"crops_per_step": patches})

    def architecture(self, method: str) -> dict[str, Any]:
        """Return the constructor arguments of a method's network.

        Raises
        ------
        InputError
            If the configuration has a choice that the network lacks.

        Examples
        --------
        >>> TrainingConfiguration(narrow=8).architecture("u-net")
        {'filters': [8, 16, 32, 64, 128]}
        """
        if method == "u-net":
            self._refuse_choices_of_dfd_net()
            widths = self.filters or UNET_FILTERS
            found: dict[str, Any] = {
                "filters": [max(2, int(number) // self.narrow) for number in widths]
            }
            return found | ({"normalized": True} if self.normalized else {})
        chosen = self.filters if self.filters is not None else "original"
        filters = FILTERS[chosen] if isinstance(chosen, str) else tuple(chosen)
        given = self.normalized
        sites = [given] * len(SITES) if isinstance(given, bool) else given
        return {
            "filters": list(narrowed(filters, self.narrow)),
            "sampling_size": self.sampling_size,
            "first_activation": self.first_activation,
            **plain_choices(self.kernels, self.activations, sites),
        }

    def _refuse_choices_of_dfd_net(self) -> None:
        fields = type(self).model_fields
        refused = [name for name in _OF_DFD_NET if getattr(self, name) != fields[name].default]
        refused += ["filters"] * isinstance(self.filters, str)
        refused += ["normalized"] * isinstance(self.normalized, list)
        refused += ["normalization"] * (self.normalization == "fixed" and not self.normalized)
        InputError.raise_if(
            Problem("U-Net has no such choice", where=name, got=str(getattr(self, name)))
            for name in refused
        )


def shipped_configurations() -> dict[str, str]:
    """Return the texts of the configurations that come with the package, by name."""
    folder = Path(str(files("dfdbench.training.configurations")))
    return {path.stem: path.read_text("utf-8") for path in sorted(folder.glob("*.toml"))}


def read_configuration(
    name: str, changes: Mapping[str, Any] | None = None
) -> TrainingConfiguration:
    """Read a shipped configuration by its name, or a TOML file by its path.

    Parameters
    ----------
    name : str
        A name, or a file's path.
    changes : mapping, optional
        Values that replace those of the file.

    Raises
    ------
    InputError
        If there is no such file or it is not a configuration; every problem is named.

    Examples
    --------
    >>> read_configuration("published", {"noise": 2}).noise
    2.0
    """
    shipped = shipped_configurations()
    if name in shipped:
        text = shipped[name]
    elif Path(name).is_file():
        text = read_as(InputError, Path(name), "the configuration").decode(errors="replace")
    else:
        what, expected = f"no such configuration as {name}", f"a file or {', '.join(shipped)}"
        raise InputError(what, where="--config", expected=expected)
    try:
        choices = {**parse_toml(text), **(changes or {})}
    except ValueError as error:
        raise InputError("not a TOML file", where=name, got=str(error)) from error
    known = TrainingConfiguration.model_fields
    problems = [
        Problem("unknown choice", where=f"{name}: {choice}", expected=f"one of: {', '.join(known)}")
        for choice in choices.keys() - known.keys()
    ]
    kept = {choice: value for choice, value in choices.items() if choice in known}
    try:
        configuration = TrainingConfiguration.model_validate(kept)
    except ValidationError as error:
        problems += problems_of(error, "the configuration cannot be used", file=name)
    InputError.raise_if(problems)
    return configuration


def precision_for(device: torch.device) -> tuple[Literal["float32", "bf16"], str]:
    """Return the fastest precision of a device, and the reason in words.

    Examples
    --------
    >>> precision, reason = precision_for(torch.device("cpu"))
    >>> precision in ("float32", "bf16")
    True
    """
    if device.type == "cuda":
        if torch.cuda.is_bf16_supported(including_emulation=False):
            return "bf16", "this graphics processor has bf16"
        return "float32", "this graphics processor has no bf16"
    if device.type == "cpu":
        # PyTorch before 2.6 cannot report this; float32 is always correct.
        known: Mapping[str, object] = getattr(torch.cpu, "get_capabilities", dict)()
        there = [name for name in _BF16_INSTRUCTIONS if known.get(name)]
        if there:
            return "bf16", f"this processor has {there[0]}"
    return "float32", f"no fast bf16 is known of this {device.type}"


def settled(configuration: TrainingConfiguration, device: torch.device) -> TrainingConfiguration:
    """Return a configuration in which the device's fastest precision replaces ``auto``.

    Examples
    --------
    >>> settled(TrainingConfiguration(precision="auto"), torch.device("meta")).precision
    'float32'
    """
    if configuration.precision != "auto":
        return configuration
    return configuration.model_copy(update={"precision": precision_for(device)[0]})
