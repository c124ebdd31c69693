"""The nine scenes of the demo set, as surfaces; training and test share no photograph."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from dfdbench.simulation.raycast import Ball, Board, Floor, Surface, Texture

_WARM, _COOL, _GREEN, _ROSE = (
    (1.0, 0.85, 0.7),
    (0.75, 0.88, 1.0),
    (0.8, 1.0, 0.75),
    (1.0, 0.8, 0.85),
)

_ASTRONAUT = Texture("astronaut", 260)
_BRICK = Texture("brick", 200, _WARM)
_CAMERA = Texture("camera", 280, _COOL)
_GRASS = Texture("grass", 240, _GREEN)
_IHC = Texture("ihc", 300)
_MOON = Texture("moon", 260, _WARM)
_PAGE = Texture("page", 260)
_MOTORCYCLE = Texture("motorcycle_left", 280)
_CELL = Texture("cell", 260, _ROSE)

_CHELSEA = Texture("chelsea", 260)
_COFFEE = Texture("coffee", 280)
_COINS = Texture("coins", 240, _WARM)
_GRAVEL = Texture("gravel", 240, _COOL)
_TEXT = Texture("text", 220)

#: Each scene's surfaces. x to the right, y downwards, z away from the cameras, in metres.
SCENES: Mapping[str, tuple[Surface, ...]] = MappingProxyType(
    {
        # Training.
        "Attic": (
            Board((0, 0, 4.8), (14, 9), _BRICK, slant=0.45),
            Floor(0.95, _GRASS),
            Board((-0.55, 0.1, 2.2), (0.8, 1.3), _ASTRONAUT, slant=0.5),
            Ball((0.55, 0.3, 1.9), 0.33, _MOON),
            Board((1.0, -0.5, 3.1), (1.1, 0.9), _PAGE, slant=-0.3, tilt=0.2),
            Board((0.2, -0.4, 1.95), (0.5, 0.4), _IHC, slant=0.25),
        ),
        "Barn": (
            Board((0, 0, 4.0), (14, 9), _GRASS, slant=-0.25, tilt=-0.1),
            Floor(0.8, _BRICK),
            Ball((-0.75, 0.2, 2.6), 0.4, _IHC, upright=0.9),
            Board((0.25, -0.2, 1.65), (0.6, 0.7), _CAMERA, slant=0.35),
            Ball((0.9, 0.45, 2.2), 0.35, _MOTORCYCLE),
        ),
        "Cabin": (
            Board((0, 0, 3.2), (14, 9), _MOTORCYCLE, slant=0.4),
            Floor(0.7, _MOON),
            Board((-0.2, 0.25, 1.5), (0.5, 0.6), _BRICK, slant=-0.5, shape="disc"),
            Ball((0.55, -0.15, 1.9), 0.28, _CELL, upright=0.9),
            Board((-0.75, -0.35, 2.2), (0.7, 0.6), _PAGE, tilt=0.4),
        ),
        "Depot": (
            Board((0, 0, 4.9), (20, 12), _CAMERA, slant=-0.6),
            Floor(1.1, _CELL),
            Board((0.7, 0.15, 2.8), (1.2, 1.7), _GRASS, slant=-0.7),
            Board((-0.8, -0.1, 3.6), (1.2, 1.6), _ASTRONAUT, slant=0.6, tilt=0.1),
            Ball((-0.1, 0.45, 1.55), 0.2, _PAGE),
            Board((0.0, -0.5, 2.5), (0.9, 0.6), _BRICK, slant=0.3, shape="disc"),
        ),
        "Forge": (
            Board((0, 0, 2.9), (12, 8), _IHC, slant=-0.35, tilt=0.15),
            Floor(0.62, _CAMERA),
            Ball((-0.4, 0.1, 1.55), 0.27, _ASTRONAUT),
            Ball((0.45, 0.2, 2.1), 0.3, _BRICK, upright=0.7),
            Board((0.2, -0.45, 1.35), (0.5, 0.3), _MOON, slant=0.3),
        ),
        "Garage": (
            Board((0, 0, 4.6), (14, 9), _ASTRONAUT, slant=0.3, tilt=-0.2),
            Floor(0.85, _MOTORCYCLE),
            Board((-0.6, 0.2, 1.75), (0.55, 0.9), _IHC, slant=-0.4),
            Board((0.1, -0.1, 3.35), (1.3, 1.2), _GRASS, slant=0.3, shape="disc"),
            Ball((0.7, 0.25, 1.45), 0.22, _CAMERA, upright=0.4),
        ),
        # Test.
        "Kitchen": (
            Board((0, 0, 4.2), (14, 9), _GRAVEL, slant=0.5),
            Floor(0.85, _COFFEE),
            Ball((-0.5, 0.2, 2.0), 0.34, _CHELSEA),
            Board((0.6, -0.05, 2.6), (0.9, 1.2), _COINS, slant=-0.4),
            Board((0.1, 0.25, 1.65), (0.36, 0.4), _TEXT, slant=0.8),
        ),
        "Library": (
            Board((0, 0, 3.4), (12, 8), _COFFEE, slant=-0.28, tilt=0.1),
            Floor(0.72, _COINS),
            Ball((0.6, 0.1, 2.3), 0.4, _TEXT),
            Board((-0.45, 0.1, 1.8), (0.6, 0.75), _GRAVEL, slant=0.9),
            Board((-0.1, -0.4, 2.5), (0.8, 0.5), _CHELSEA, slant=0.5, tilt=0.5, shape="disc"),
        ),
        "Market": (
            Board((0, 0, 4.7), (16, 10), _CHELSEA, slant=-0.45, tilt=-0.1),
            Floor(0.95, _GRAVEL),
            Board((-0.9, 0.0, 3.0), (1.1, 1.5), _COFFEE, slant=0.5),
            Board((0.75, 0.1, 2.3), (0.8, 1.1), _TEXT, slant=-0.35, tilt=0.15),
            Ball((-0.1, 0.35, 1.9), 0.28, _COINS),
        ),
    }
)
