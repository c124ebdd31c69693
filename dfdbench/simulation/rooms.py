"""Draw rooms from a seed: walls and vaults, furniture, thin things, clutter at many depths."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from dfdbench.datasets.rendered import FAR, NEAR
from dfdbench.errors import InputError
from dfdbench.optics.thin_lens import ThinLens
from dfdbench.simulation.lens import Camera, depth
from dfdbench.simulation.lighting import Lamp, lit
from dfdbench.simulation.photographs import photograph
from dfdbench.simulation.raycast import Floats, Texture
from dfdbench.simulation.shapes import Frame, Outline, Panel, Round, Scene, Vector, cross, pack
from dfdbench.simulation.textures import PATTERNS, PHOTOGRAPHS, Draws, pattern

#: The least ratio of a room's farthest to its nearest depths.
SPREAD = 1.6
#: The largest x / z and y / z that rooms are made for: a field of view of 60 degrees.
WIDEST = (0.58, 0.435)
_MOST_ATTEMPTS = 100
_PREVIEW = Camera(ThinLens(1e6, 0.01, 1.0, 0.01 / 0.99 * WIDEST[0] / 320), (480, 640))
_FINE = 2.0**26  # directions are multiples of 1 / _FINE: sines may differ in their last bit
_WALLS = ("plain", "plain", "plaster", "motif", "bricks", "tiles", "stripes", "wood", "marble")
_GROUNDS = ("wood", "tiles", "speckle", "plaid", "marble", "plaster", "bricks", "plain")
_CEILINGS = ("plain", "plaster", "wood", "tiles", "speckle")
_THINGS = tuple(PATTERNS)
_BARS = ("plain", "wood", "plaster", "stripes", "speckle")
_WHITE = (1.0, 1.0, 1.0)
_SIGNS: tuple[Outline, ...] = ("rectangle", "rectangle", "disc", "lattice")
_BACKS: tuple[Outline, ...] = ("rectangle", "lattice")


@dataclass
class Room:
    """A room while it is being furnished; x right, y down and z ahead, the lens at the origin.

    Parameters
    ----------
    draws : Draws
        The source of everything drawn.
    """

    draws: Draws
    shapes: list[Panel | Round] = field(default_factory=list)
    # A pattern's kind by name; other names are photographs.
    patterns: dict[str, str] = field(default_factory=dict)
    # The ends of the room: left, right, ceiling, floor, front, back, in metres.
    left: float = -2.0
    right: float = 2.0
    top: float = -1.2
    floor: float = 1.2
    back: float = 4.0
    pool: list[Texture] = field(default_factory=list)

    def texture(self, kinds: Sequence[str], photograph: float = 0.0) -> Texture:
        """Draw a texture of these kinds or, in this share of cases, a photograph."""
        d = self.draws
        if d.chance(photograph):
            tint = (1.0, d.between(0.75, 1), d.between(0.6, 1)) if d.chance(0.5) else _WHITE
            return Texture(d.one_of(PHOTOGRAPHS), d.between(450, 1400), tint)
        name = f"pattern {len(self.patterns)}"
        self.patterns[name] = d.one_of(kinds)
        return Texture(name, d.between(350, 1100))

    def thing(self) -> Texture:
        """Return one of a few textures that this room's things share."""
        d = self.draws
        if len(self.pool) < 9:
            self.pool.append(self.texture(_THINGS, 0.35))
            return self.pool[-1]
        old = d.one_of(self.pool)
        # The same pattern in another size and shade.
        shade = d.between(0.7, 1.0)
        red, green, blue = old.tint
        tint = (shade * red, shade * green, shade * blue)
        return Texture(old.photograph, old.texels * d.between(0.7, 1.6), tint)

    def box(self, centre: Vector, size: Vector, turn: float, texture: Texture) -> None:
        """Add a box rotated about the vertical; size is width, height, depth."""
        across, down, away = upright(turn)
        w, h, t = size
        faces = (
            ((across, down, away), away, -t, (w, h)),
            ((minus(across), down, minus(away)), away, t, (w, h)),
            ((minus(away), down, across), across, -w, (t, h)),
            ((away, down, minus(across)), across, w, (t, h)),
            ((across, minus(away), down), down, -h, (w, t)),
            ((across, away, minus(down)), down, h, (w, t)),
        )
        for frame, way, offset, extent in faces:
            place = moved(centre, way, offset / 2)
            self.shapes.append(Panel(place, frame, extent, texture, closed=True))

    def rod(self, start: Vector, end: Vector, radius: float, texture: Texture) -> None:
        """Add a round bar from one place to another."""
        x, y, z = ((a + b) / 2 for a, b in zip(start, end, strict=True))
        way = [b - a for a, b in zip(start, end, strict=True)]
        length = math.sqrt(sum(part * part for part in way))
        down = _unit(way)
        side = _unit(cross(down, (0.0, 0.0, 1.0) if abs(down[2]) < 0.9 else (1.0, 0.0, 0.0)))
        frame = (side, down, cross(side, down))
        self.shapes.append(Round((x, y, z), frame, radius, texture, length / 2))

    def ball(self, centre: Vector, radius: float, texture: Texture) -> None:
        """Add a ball."""
        self.shapes.append(Round(centre, upright(self.draws.between(0, 6)), radius, texture))

    def can(self, centre: Vector, radius: float, height: float, texture: Texture) -> None:
        """Add a closed upright cylinder."""
        frame = upright(self.draws.between(0, 6))
        self.shapes.append(Round(centre, frame, radius, texture, height / 2))
        x, y, z = centre
        for end, way in ((y - height / 2, -1.0), (y + height / 2, 1.0)):
            lid: Frame = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -way, 0.0))
            size = (2 * radius, 2 * radius)
            self.shapes.append(Panel((x, end, z), lid, size, texture, "disc", closed=True))


def upright(turn: float) -> Frame:
    """Return a frame rotated by radians about the vertical."""
    c, s = _fine(math.cos(turn)), _fine(math.sin(turn))
    return (c, 0.0, s), (0.0, 1.0, 0.0), (-s, 0.0, c)


def minus(way: Vector) -> Vector:
    """Return the opposite direction."""
    return -way[0], -way[1], -way[2]


def moved(place: Vector, way: Vector, distance: float) -> Vector:
    """Return a place moved along a direction."""
    x, y, z = place
    return x + distance * way[0], y + distance * way[1], z + distance * way[2]


def _fine(number: float) -> float:
    return round(number * _FINE) / _FINE


def _unit(way: Sequence[float]) -> Vector:
    length = math.sqrt(way[0] * way[0] + way[1] * way[1] + way[2] * way[2])
    return way[0] / length, way[1] / length, way[2] / length


# --- what stands, hangs and lies in a room --------------------------------------------------------


def _small_thing(room: Room, x: float, y: float, z: float, size: float) -> None:
    """Put something of about this size at a place."""
    d, texture = room.draws, room.thing()
    kind = d.whole(0, 4)
    if kind == 0:
        radius = size * d.between(0.3, 0.5)
        room.ball((x, y - radius, z), radius, texture)
    elif kind == 1:
        height = size * d.between(0.8, 1.6)
        room.can((x, y - height / 2, z), size * d.between(0.2, 0.4), height, texture)
    elif kind == 2:
        w, h, t = (size * d.between(0.4, 1.2) for _ in range(3))
        room.box((x, y - h / 2, z), (w, h, t), d.between(-0.8, 0.8), texture)
    elif kind == 3:
        _books(room, x, y, z, size)
    else:
        _plant(room, x, y, z, size * 1.6)


def _books(room: Room, x: float, y: float, z: float, size: float) -> None:
    d, turn = room.draws, room.draws.between(-0.5, 0.5)
    across = upright(turn)[0]
    place = -size / 2
    while place < size / 2:
        thick, high = d.between(0.1, 0.25) * size, d.between(0.7, 1.2) * size
        at = moved((x, y - high / 2, z), across, place + thick / 2)
        room.box(at, (thick * 0.94, high, size * 0.7), turn, room.thing())
        place += thick


def _plant(room: Room, x: float, y: float, z: float, size: float) -> None:
    """Add a pot with stems and leaves."""
    d = room.draws
    high = size * 0.3
    room.can((x, y - high / 2, z), size * 0.17, high, room.thing())
    green = room.texture(("plaster", "plain", "stripes"))
    tint = (d.between(0.25, 0.7), 1.0, d.between(0.15, 0.5))
    green = Texture(green.photograph, green.texels, tint)
    for _ in range(d.whole(4, 8)):
        turn, lean = d.between(0, 2 * math.pi), d.between(0.1, 0.9)
        long = size * d.between(0.4, 0.8)
        way = _unit((lean * math.cos(turn), -1.0, lean * math.sin(turn)))
        way = (_fine(way[0]), _fine(way[1]), _fine(way[2]))
        foot = (x, y - high, z)
        tip = moved(foot, way, long)
        room.rod(foot, tip, size * 0.012, green)
        side = _unit(cross(way, (_fine(math.sin(turn)), 0.3, _fine(math.cos(turn)))))
        leaf = (size * d.between(0.08, 0.16), size * d.between(0.25, 0.45))
        room.shapes.append(Panel(tip, (side, way, cross(side, way)), leaf, green, "disc"))


def _table(room: Room, x: float, z: float, y: float, width: float, depth: float) -> None:
    """Add a table whose top is at y, with things on it."""
    d, wood = room.draws, room.texture(("wood", "plain", "marble", "plaid", "speckle"))
    turn = d.between(-0.6, 0.6)
    across, _, away = upright(turn)
    room.box((x, y + 0.02, z), (width, 0.04, depth), turn, wood)
    for side in (-0.46, 0.46):
        for end in (-0.46, 0.46):
            foot = moved(moved((x, y + 0.04, z), across, side * width), away, end * depth)
            room.rod(foot, (foot[0], room.floor, foot[2]), d.between(0.012, 0.03), wood)
    for _ in range(d.whole(2, 6)):
        place = moved((x, y, z), across, d.between(-0.42, 0.42) * width)
        place = moved(place, away, d.between(-0.42, 0.42) * depth)
        _small_thing(room, *place, d.between(0.08, 0.28))


def _chair(room: Room, x: float, z: float) -> None:
    d, texture = room.draws, room.thing()
    turn, seat = d.between(-3, 3), room.floor - 0.45
    across, down, away = upright(turn)
    room.box((x, seat, z), (0.42, 0.04, 0.42), turn, texture)
    for side in (-0.19, 0.19):
        for end in (-0.19, 0.19):
            foot = moved(moved((x, seat, z), across, side), away, end)
            room.rod(foot, (foot[0], room.floor, foot[2]), 0.014, texture)
    back = moved((x, seat - 0.32, z), away, 0.2)
    kind = d.one_of(_BACKS)
    panel = Panel(back, (across, down, away), (0.42, 0.55), texture, kind, 0.08, 0.25)
    room.shapes.append(panel)


def _shelf(room: Room, x: float, z: float, turn: float) -> None:
    """Add shelves full of things."""
    d, wood = room.draws, room.texture(("wood", "plain", "plaster"))
    across, down, away = upright(turn)
    width, depth, gap = d.between(0.7, 1.4), 0.28, d.between(0.28, 0.42)
    high = d.between(room.top + 0.1, room.floor - 1.0)
    count = min(d.whole(2, 5), int((room.floor - high) / gap))
    for level in range(count + 1):
        y = high + level * gap
        room.box((x, y, z), (width, 0.025, depth), turn, wood)
        place = -width / 2 + 0.1
        while level and place < width / 2 - 0.1:
            at = moved((x, y - 0.0125, z), across, place)
            _small_thing(room, *at, min(gap * 0.6, d.between(0.1, 0.24)))
            place += d.between(0.2, 0.5)
    for side in (-width / 2, width / 2):
        middle = moved((x, high + count * gap / 2, z), across, side)
        room.box(middle, (0.025, count * gap, depth), turn, wood)
    if d.chance(0.5):
        middle = moved((x, high + count * gap / 2, z), away, depth / 2)
        room.shapes.append(Panel(middle, (across, down, away), (width, count * gap), wood))


def _lamp(room: Room, x: float, y: float, z: float) -> None:
    """Hang a shade or a ball on a wire from the ceiling."""
    d, texture = room.draws, room.thing()
    radius = d.between(0.07, 0.22)
    room.rod((x, room.top, z), (x, y, z), d.between(0.004, 0.012), room.texture(_BARS))
    if d.chance(0.5):
        room.ball((x, y + radius, z), radius, texture)
    else:
        height = d.between(0.12, 0.4)
        room.can((x, y + height / 2, z), radius, height, texture)


def _hanging(room: Room, x: float, y: float, z: float) -> None:
    """Hang a cloth, sign or disc from the ceiling."""
    d, texture, wire = room.draws, room.thing(), room.texture(_BARS)
    across, down, away = upright(d.between(-1, 1))
    size = (d.between(0.15, 0.6), d.between(0.15, 0.6))
    for side in (-0.4, 0.4):
        end = moved((x, y, z), across, side * size[0])
        room.rod((end[0], room.top, end[2]), end, 0.004, wire)
    kind = d.one_of(_SIGNS)
    centre = (x, y + size[1] / 2, z)
    panel = Panel(centre, (across, down, away), size, texture, kind, d.between(0.04, 0.1), 0.3)
    room.shapes.append(panel)


def _stand(room: Room, x: float, y: float, z: float) -> None:
    """Put a thing on a thin stand on the floor."""
    d, texture = room.draws, room.texture(_BARS)
    room.rod((x, y, z), (x, room.floor, z), d.between(0.006, 0.03), texture)
    room.can((x, y + 0.01, z), d.between(0.08, 0.2), 0.02, texture)
    _small_thing(room, x, y, z, d.between(0.12, 0.35))


def _pole(room: Room, x: float, z: float) -> None:
    """Add a thin pole between floor and ceiling, upright or leaning."""
    d = room.draws
    lean = 0.0 if d.chance(0.5) else d.between(-0.6, 0.6)
    start, end = (x - lean, room.top, z), (x + lean, room.floor, z)
    room.rod(start, end, d.between(0.006, 0.05), room.texture(_BARS))


def _column(room: Room, x: float, z: float) -> None:
    d = room.draws
    height, middle = room.floor - room.top, (room.floor + room.top) / 2
    room.can((x, middle, z), d.between(0.1, 0.3), height, room.thing())


def _crates(room: Room, x: float, z: float) -> None:
    d, y = room.draws, room.floor
    for _ in range(d.whole(1, 4)):
        size = (d.between(0.25, 0.7), d.between(0.15, 0.5), d.between(0.25, 0.7))
        at = (x + d.between(-0.08, 0.08), y - size[1] / 2, z + d.between(-0.08, 0.08))
        room.box(at, size, d.between(-0.8, 0.8), room.thing())
        y -= size[1]
        if y < room.top + 0.6:
            break


def _curtain(room: Room, x: float, z: float, turn: float) -> None:
    d, texture = room.draws, room.thing()
    across = upright(turn)[0]
    radius = d.between(0.03, 0.08)
    height, middle = room.floor - room.top, (room.floor + room.top) / 2
    for number in range(d.whole(5, 12)):
        at = moved((x, middle, z), across, number * radius * 1.7)
        room.shapes.append(Round(at, upright(0), radius, texture, height / 2 * 0.98))


def _screen(room: Room, x: float, z: float) -> None:
    """Add a slanted board, or a fence of bars."""
    d, texture = room.draws, room.thing()
    turn, lean = d.between(-1.1, 1.1), d.between(-0.35, 0.35)
    across, _, away = upright(turn)
    c, s = _fine(math.cos(lean)), _fine(math.sin(lean))
    down = (s * away[0], c, s * away[2])
    size = (d.between(0.4, 1.3), d.between(0.5, 1.5))
    y = d.between(room.top + size[1] / 2, room.floor - size[1] / 2)
    shape: Outline = "lattice" if d.chance(0.4) else "rectangle"
    frame = (across, down, cross(across, down))
    bars = (d.between(0.06, 0.2), d.between(0.12, 0.35))
    room.shapes.append(Panel((x, y, z), frame, size, texture, shape, *bars))


def _pictures(room: Room, z: float) -> None:
    d, frame = room.draws, upright(0)
    for _ in range(d.whole(0, 5)):
        size = (d.between(0.25, 0.9), d.between(0.25, 0.8))
        x = d.between(room.left + 0.4, room.right - 0.4)
        y = d.between(room.top + size[1] / 2, room.floor - size[1] / 2)
        room.box((x, y, z - 0.02), (size[0] + 0.06, size[1] + 0.06, 0.03), 0.0, room.thing())
        photo = Texture(d.one_of(PHOTOGRAPHS), d.between(450, 700) / size[0])
        room.shapes.append(Panel((x, y, z - 0.037), frame, size, photo))


# --- the room ------------------------------------------------------------------------------------


def _shell(room: Room) -> None:
    """Add walls, floor and ceiling; one may be round, or slant like a roof."""
    d = room.draws
    x, y, z = (room.left + room.right) / 2, (room.top + room.floor) / 2, room.back / 2 - 0.75
    # Walls extend behind each other, so that no vault or roof leaves a gap.
    width, height, depth = (room.right - room.left, room.floor - room.top, room.back + 1.5)
    tall = height + 3.0
    wall = room.texture(_WALLS, 0.1)
    other = room.texture(_WALLS, 0.1) if d.chance(0.5) else wall
    across, down, away = upright(0)
    round_back = d.chance(0.25)
    if round_back:
        radius = width / 2 * d.between(1.02, 1.6)
        centre = (x, y, room.back - radius)
        room.shapes.append(Round(centre, upright(math.pi), radius, wall, tall / 2))
    else:
        _pictures(room, room.back)
    ground = room.texture(_GROUNDS)
    room.shapes += [
        Panel((x, y, room.back), (across, down, away), (width, tall), wall),
        Panel((x, y, -1.5), (across, down, minus(away)), (width, tall), wall),
        Panel((room.left, y, z), (away, down, minus(across)), (depth, tall), other),
        Panel((room.right, y, z), (minus(away), down, across), (depth, tall), other),
        Panel((x, room.floor, z), (across, away, down), (width, depth), ground),
    ]
    _ceiling(room, (width, depth), may_be_vault=not round_back)


def _ceiling(room: Room, size: tuple[float, float], may_be_vault: bool) -> None:
    d, (width, depth) = room.draws, size
    x, z = (room.left + room.right) / 2, room.back / 2 - 0.75
    across, down, away = upright(0)
    ceiling = room.texture(_CEILINGS)
    kind = d.whole(0, 3)
    if kind == 0 and may_be_vault:
        radius = width / 2
        frame = (down, minus(away), minus(across))
        centre = (x, room.top + radius * 0.6, z)
        room.shapes.append(Round(centre, frame, radius, ceiling, depth / 2))
    elif kind == 1:
        # A roof that slants to one side.
        slope = d.between(0.3, 1.0) * d.one_of((-1, 1))
        length = math.sqrt(1 + slope * slope)
        frame = ((1 / length, slope / length, 0.0), away, (slope / length, -1 / length, 0.0))
        low = room.top + abs(slope) * 0.15
        room.shapes.append(Panel((x, low, z), frame, (width * 2, depth), ceiling))
    else:
        room.shapes.append(Panel((x, room.top, z), (across, away, down), size, ceiling))
        if d.chance(0.4):
            beam = room.texture(("wood", "plain"))
            for number in range(d.whole(2, 5)):
                z = 0.5 + number * d.between(0.6, 0.9)
                room.box((x, room.top + 0.07, z), (width, 0.14, 0.12), 0.0, beam)


def _furnish(room: Room) -> None:
    """Put things at places spread over the view, from near to far."""
    d = room.draws
    for _ in range(d.whole(7, 14)):
        z = _fine(0.75 * (max(room.back - 0.4, 1.2) / 0.75) ** d.share())
        x = z * d.between(-0.5, 0.5)
        y = z * d.between(-0.34, 0.34)
        x = min(max(x, room.left + 0.25), room.right - 0.25)
        y = min(max(y, room.top + 0.1), room.floor - 0.1)
        kind = d.whole(0, 11)
        if kind <= 1 and z > 1.2:
            _table(room, x, z, min(max(y, room.floor - 0.9), room.floor - 0.4), d.between(0.5, 1.3),
                   d.between(0.4, 0.8))  # fmt: skip
        elif kind == 2 and z > 1.2:
            _shelf(room, x, z, d.between(-0.4, 0.4))
        elif kind == 3 and z > 1.0:
            _chair(room, x, z)
        elif kind == 4 and z > 1.2:
            _crates(room, x, z)
        elif kind == 5:
            _pole(room, x, z)
        elif kind == 6 and z > 1.4:
            _column(room, x, z)
        elif kind == 7 and z > 1.4:
            _curtain(room, x, z, d.between(-0.5, 0.5))
        elif kind == 8:
            _screen(room, x, max(z, 1.3))
        elif d.chance(0.5):
            _stand(room, x, y, z)
        elif d.chance(0.5):
            _lamp(room, x, y, z)
        else:
            _hanging(room, x, y, z)


def draw_room(seed: int, number: int) -> Scene:
    """Return a lit room as a camera at the origin sees it.

    Parameters
    ----------
    seed : int
        Seed of a set of rooms.
    number : int
        Number of a room in the set.

    Notes
    -----
    A room is redrawn until everything visible in a view of `WIDEST` is between `NEAR` and `FAR`,
    and the farthest twentieth is at least `SPREAD` times as far as the nearest. Outside that view
    there is only ambient light.
    """
    for attempt in range(_MOST_ATTEMPTS):
        draws = Draws("room", seed, number, attempt)
        room = _furnished(draws)
        axes = _axes(draws)
        shapes = [_seen(shape, axes) for shape in room.shapes]
        blank = {shape.texture.photograph: np.ones((1, 1, 3)) for shape in shapes}
        if not _fits(depth(pack(shapes, blank), _PREVIEW)):
            continue
        lamps = [_bulb(room, axes) for _ in range(draws.whole(1, 3))]
        photographs = {name: _photograph(room, name) for name in blank}
        return lit(pack(shapes, photographs), lamps, draws.between(0.15, 0.45), WIDEST)
    raise InputError("no room of this seed has the depths it should", where=f"scene {number}")


def _fits(metres: NDArray[np.float32]) -> bool:
    if metres.min() < NEAR or metres.max() > FAR:
        return False
    near, far = np.quantile(metres, (0.05, 0.95))
    return bool(far >= SPREAD * near)


def _photograph(room: Room, name: str) -> Floats:
    kind = room.patterns.get(name)
    return pattern(kind, Draws(*room.draws.key, name)) if kind else photograph(name)


def _furnished(draws: Draws) -> Room:
    d, room = draws, Room(draws)
    height = d.between(2.1, 3.0)
    room.floor = d.between(0.45, height - 0.45)
    room.top = room.floor - height
    width = d.between(2.2, 5.0)
    room.right = d.between(0.8, width - 0.8)
    room.left = room.right - width
    room.back = d.between(2.0, 4.8)
    _shell(room)
    _furnish(room)
    return room


def _bulb(room: Room, axes: Frame) -> Lamp:
    d = room.draws
    x = d.between(room.left + 0.3, room.right - 0.3)
    place = (x, d.between(room.top + 0.25, room.top + 0.7), d.between(-0.8, room.back * 0.7))
    return Lamp(_turned(place, axes), d.between(0.06, 0.25), d.between(0.7, 1.7))


def _axes(d: Draws) -> Frame:
    """Draw the camera's right, bottom and view directions in the room; a fifth are in portrait."""
    yaw, pitch, roll = d.between(-0.6, 0.6), d.between(-0.4, 0.4), d.between(-0.12, 0.12)
    if d.chance(0.2):
        roll += d.one_of((-1, 1)) * math.pi / 2
    right, _, ahead = upright(yaw)
    c, s = _fine(math.cos(pitch)), _fine(math.sin(pitch))
    view = (c * ahead[0], s, c * ahead[2])
    bottom = cross(view, right)
    c, s = _fine(math.cos(roll)), _fine(math.sin(roll))
    pairs = list(zip(right, bottom, strict=True))
    across, down = [c * a + s * b for a, b in pairs], [c * b - s * a for a, b in pairs]
    return (across[0], across[1], across[2]), (down[0], down[1], down[2]), view


def _turned(place: Vector, axes: Frame) -> Vector:
    x, y, z = (place[0] * a[0] + place[1] * a[1] + place[2] * a[2] for a in axes)
    return x, y, z


def _seen(shape: Panel | Round, axes: Frame) -> Panel | Round:
    across, down, away = (_turned(way, axes) for way in shape.frame)
    return replace(shape, centre=_turned(shape.centre, axes), frame=(across, down, away))
