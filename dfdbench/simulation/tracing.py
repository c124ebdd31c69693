"""Trace rays through a scene of flat and round surfaces, compiled with numba.

It uses only ``+ - * /``, square roots and `floor`, without `fastmath`. IEEE 754 fixes the result of
each, so a scene gives the same light on every machine and with any number of threads.
"""

import math
from typing import Final

import numpy as np

from dfdbench.system.compiled import compiled

#: Kinds of surfaces, as in the column `kind` of a scene.
RECTANGLE: Final = 0
DISC: Final = 1
LATTICE: Final = 2
SPHERE: Final = 3
CYLINDER: Final = 4

#: Columns of a surface's row. CENTRE, ACROSS, DOWN and AWAY are the first of three each. The last
#: three form a frame: ACROSS and DOWN measure the place on the surface, AWAY is a plane's normal.
CENTRE: Final = 0
ACROSS: Final = 3
DOWN: Final = 6
AWAY: Final = 9
HALF_WIDTH: Final = 12  # of a sphere or a cylinder: the radius
HALF_HEIGHT: Final = 13
PITCH: Final = 14  # of a lattice's bars, in metres
BAR: Final = 15  # a bar's share of the pitch
TEXELS: Final = 16  # per metre
TINT: Final = 17
COLUMNS: Final = 20

_LEAST = 1e-6  # metres that a ray travels before it can meet anything
_OFF = 2e-3  # metres off the surface at which a ray of light starts
_RUN = 16  # neighbouring places whose light is computed with the same few surfaces
_LEAST_SKY = 0.35  # share of even light that reaches a corner, in place of reflected light
_FINEST = 0.5  # pixels: where everything is sharp, no texel is larger than this
_SPREAD = 0.7  # distance between neighbouring rays, by the blur's diameter and their number


@compiled(inline="always")
def _along(row, first, x, y, z):  # type: ignore[no-untyped-def]
    return row[first] * x + row[first + 1] * y + row[first + 2] * z


@compiled(inline="always")
def row_of(rows, item):  # type: ignore[no-untyped-def]
    """Return a surface's numbers up to BAR as a tuple: an array would be counted at every ray."""
    a, i = rows, item
    first = (a[i, 0], a[i, 1], a[i, 2], a[i, 3], a[i, 4], a[i, 5], a[i, 6], a[i, 7])
    last = (a[i, 8], a[i, 9], a[i, 10], a[i, 11], a[i, 12], a[i, 13], a[i, 14], a[i, 15])
    return first + last


# Without branches that depend on the ray, it is compiled for several rays at once; so is the next.
# Where it divides by 0, NumPy's rules give a miss.
@compiled(inline="always")
def _meet_flat(kind, row, ox, oy, oz, dx, dy, dz):  # type: ignore[no-untyped-def]
    falling = _along(row, AWAY, dx, dy, dz)
    x, y, z = row[0] - ox, row[1] - oy, row[2] - oz
    t = _along(row, AWAY, x, y, z) / falling
    x, y, z = t * dx - x, t * dy - y, t * dz - z
    u, v = _along(row, ACROSS, x, y, z), _along(row, DOWN, x, y, z)
    hit = (falling != 0.0) & (t >= _LEAST)
    hit &= (abs(u) <= row[HALF_WIDTH]) & (abs(v) <= row[HALF_HEIGHT])
    if kind == DISC:
        a, b = u / row[HALF_WIDTH], v / row[HALF_HEIGHT]
        hit &= a * a + b * b <= 1.0
    elif kind == LATTICE:
        a, b = (u + row[HALF_WIDTH]) / row[PITCH], (v + row[HALF_HEIGHT]) / row[PITCH]
        hit &= (a - math.floor(a) <= row[BAR]) | (b - math.floor(b) <= row[BAR])
    return t if hit else math.inf


@compiled(inline="always")
def _meet_round(kind, row, ox, oy, oz, dx, dy, dz):  # type: ignore[no-untyped-def]
    x, y, z = ox - row[0], oy - row[1], oz - row[2]
    a = dx * dx + dy * dy + dz * dz
    b = dx * x + dy * y + dz * z
    c = x * x + y * y + z * z - row[HALF_WIDTH] * row[HALF_WIDTH]
    rise, height, half = 0.0, 0.0, math.inf
    if kind == CYLINDER:
        rise, height = _along(row, DOWN, dx, dy, dz), _along(row, DOWN, x, y, z)
        half = row[HALF_HEIGHT]
        a -= rise * rise
        b -= rise * height
        c -= height * height
    square = b * b - a * c
    root = math.sqrt(max(square, 0.0))
    near, far = (-b - root) / a, (-b + root) / a
    entered = (near > _LEAST) & (abs(height + near * rise) <= half)
    left = (far > _LEAST) & (abs(height + far * rise) <= half)
    t = near if entered else far
    return t if (square >= 0.0) & (a >= 1e-12) & (entered | left) else math.inf


@compiled(inline="always", error_model="numpy")
def meet(kind, row, ox, oy, oz, dx, dy, dz):  # type: ignore[no-untyped-def]
    """Return a surface's distance along a ray, in lengths of its direction; infinity for a miss.

    Parameters
    ----------
    kind : int
        The surface's kind.
    row : tuple of float
        Its numbers, from `row_of`.
    ox, oy, oz, dx, dy, dz : float
        The ray's origin and direction.
    """
    if kind <= LATTICE:
        return _meet_flat(kind, row, ox, oy, oz, dx, dy, dz)
    return _meet_round(kind, row, ox, oy, oz, dx, dy, dz)


@compiled(inline="always")
def arctan2(y, x):  # type: ignore[no-untyped-def]
    """Return the angle of (x, y) to 1e-5 radians, the same on every machine.

    The polynomial has the first terms of the series in Abramowitz and Stegun, 4.4.49.
    """
    if x == 0.0 and y == 0.0:
        return 0.0
    swapped = abs(y) > abs(x)
    r = abs(x) / abs(y) if swapped else abs(y) / abs(x)
    s = r * r
    p = 0.0208351 * s - 0.0851330
    p = p * s + 0.1801410
    p = p * s - 0.3302995
    angle = (p * s + 0.9998660) * r
    if swapped:
        angle = math.pi / 2 - angle
    if x < 0.0:
        angle = math.pi - angle
    return -angle if y < 0.0 else angle


@compiled(inline="always")
def place_on(kind, row, x, y, z):  # type: ignore[no-untyped-def]
    """Return a point's place on a surface in metres, (across, down); unroll round surfaces."""
    x, y, z = x - row[0], y - row[1], z - row[2]
    u, v = _along(row, ACROSS, x, y, z), _along(row, DOWN, x, y, z)
    if kind >= SPHERE:
        u = arctan2(u, _along(row, AWAY, x, y, z)) * row[HALF_WIDTH]
    return u, v


@compiled(inline="always")
def _bilinear(values, first, width, height, x, y):  # type: ignore[no-untyped-def]
    i, j = int(x), int(y)
    i, j = max(0, min(i, width - 1)), max(0, min(j, height - 1))
    fx, fy = min(max(x - i, 0.0), 1.0), min(max(y - j, 0.0), 1.0)
    right = 1 if i + 1 < width else 0
    below = width if j + 1 < height else 0
    a = first + j * width + i
    b, c = a + right, a + below
    d = c + right
    wa, wb = (1.0 - fx) * (1.0 - fy), fx * (1.0 - fy)
    wc, wd = (1.0 - fx) * fy, fx * fy
    return a, b, c, d, wa, wb, wc, wd


@compiled(inline="always")
def _mirrored(position, last):  # type: ignore[no-untyped-def]
    if 0.0 <= position <= last:
        return position
    if last <= 0.0:
        return 0.0
    period = 2.0 * last
    rest = position - period * math.floor(position / period)
    return last - abs(rest - last)


@compiled(inline="always")
def colour_at(atlas, levels, starts, texture, u, v, texels, finest):  # type: ignore[no-untyped-def]
    """Return a texture's linear red, green and blue at a place.

    Parameters
    ----------
    atlas : ndarray of float32, shape (texel, 3)
        All textures, each as a pyramid.
    levels : ndarray of int64, shape (level, 3)
        First texel, width and height of each level of each texture.
    starts : ndarray of int64, shape (texture + 1,)
        Each texture's first level, and the end of the last texture.
    texture : int
        The texture's number.
    u, v : float
        The place in metres; a texture is mirrored beyond its edge.
    texels : float
        Texels per metre.
    finest : float
        Detail smaller than this, in metres, is omitted.
    """
    first, end = starts[texture], starts[texture + 1]
    width, height = levels[first, 1], levels[first, 2]
    x = _mirrored(u * texels + 0.5 * width, width - 1.0)
    y = _mirrored(v * texels + 0.5 * height, height - 1.0)
    level, size, ratio = first, 1.0, finest * texels
    while ratio >= 2.0 and level + 1 < end:
        level, size, ratio = level + 1, size * 2.0, ratio * 0.5
    if level > first:
        x, y = (x - 0.5 * (size - 1.0)) / size, (y - 0.5 * (size - 1.0)) / size
    a, b, c, d, wa, wb, wc, wd = _bilinear(
        atlas, levels[level, 0], levels[level, 1], levels[level, 2], x, y
    )
    red = wa * atlas[a, 0] + wb * atlas[b, 0] + wc * atlas[c, 0] + wd * atlas[d, 0]
    green = wa * atlas[a, 1] + wb * atlas[b, 1] + wc * atlas[c, 1] + wd * atlas[d, 1]
    blue = wa * atlas[a, 2] + wb * atlas[b, 2] + wc * atlas[c, 2] + wd * atlas[d, 2]
    return red, green, blue


@compiled(inline="always")
def light_at(lightmap, charts, item, u, v):  # type: ignore[no-untyped-def]
    """Return the light that falls on a place of a surface.

    Parameters
    ----------
    lightmap : ndarray of float32, shape (node,)
        The charts of all surfaces.
    chart : ndarray of float64, shape (5,)
        The surface's chart: first node, nodes across and down, half extents in metres.
    u, v : float
        The place in metres.
    """
    width, height = int(charts[item, 1]), int(charts[item, 2])
    x = (u / charts[item, 3] + 1.0) * (0.5 * (width - 1))
    y = (v / charts[item, 4] + 1.0) * (0.5 * (height - 1))
    a, b, c, d, wa, wb, wc, wd = _bilinear(lightmap, int(charts[item, 0]), width, height, x, y)
    return wa * lightmap[a] + wb * lightmap[b] + wc * lightmap[c] + wd * lightmap[d]


@compiled()
def list_tiles(kinds, rows, near, bounds, tile, shape, view, items, nears):  # type: ignore[no-untyped-def]
    """List the surfaces that each tile's rays may meet, nearest first; return the lists' ends.

    Parameters
    ----------
    kinds, rows, near : ndarray
        The scene's surfaces, and the smallest z of each.
    bounds : ndarray of float64, shape (surface, 8)
        Minimum x / z and y / z of the rays that may meet it, then the maxima; a direction (x, y),
        and the minimum and the maximum along it.
    tile : int
        A tile's side in pixels.
    shape : tuple of int
        Height and width in pixels.
    view : tuple of float
        Focal length in pixels; half the side of a square around the lens, and the focus distance,
        in metres.
    items : ndarray of int64
        Receives the surfaces, tile by tile.
    nears : ndarray of float64
        Receives the minimum z at which a ray of the tile may meet each.

    Notes
    -----
    A plane maps tile and lens projectively. So what holds for rays between the corners of both
    holds for all: past which edge of a surface they pass, or that they meet it. Surfaces that begin
    behind one that every ray of a tile meets are left out.
    """
    height, width = shape
    down, across = (height + tile - 1) // tile, (width + tile - 1) // tile
    ends = np.zeros(down * across + 1, np.int64)
    end = 0
    corners = np.empty(7)
    for number in range(down * across):
        first, limit = end, math.inf
        left = ((number % across) * tile - 0.5 - 0.5 * (width - 1)) / view[0] - 1e-6
        top = ((number // across) * tile - 0.5 - 0.5 * (height - 1)) / view[0] - 1e-6
        right, bottom = left + tile / view[0] + 2e-6, top + tile / view[0] + 2e-6
        for item in range(len(kinds)):
            if near[item] >= limit or left > bounds[item, 2] or right < bounds[item, 0]:
                continue
            if top > bounds[item, 3] or bottom < bounds[item, 1]:
                continue
            n, m = bounds[item, 4], bounds[item, 5]
            middle = 0.5 * (n * (left + right) + m * (top + bottom))
            half = 0.5 * (abs(n) * (right - left) + abs(m) * (bottom - top))
            if middle - half > bounds[item, 7] or middle + half < bounds[item, 6]:
                continue
            least = near[item]
            if kinds[item] <= LATTICE:
                _corners(rows, item, left, top, right, bottom, view, corners)
                w, h = rows[item, HALF_WIDTH], rows[item, HALF_HEIGHT]
                if corners[6] > 0.0:
                    if corners[1] < 0.0 or corners[2] > w or corners[3] < -w:
                        continue
                    if corners[4] > h or corners[5] < -h:
                        continue
                    least = max(least, corners[0])
                    inside = corners[2] >= -w and corners[3] <= w
                    inside = inside and corners[4] >= -h and corners[5] <= h
                    if inside and corners[0] > 0.0 and kinds[item] == RECTANGLE:
                        limit = min(limit, corners[1])
            place = end
            while place > first and nears[place - 1] > least:
                items[place], nears[place] = items[place - 1], nears[place - 1]
                place -= 1
            items[place], nears[place] = item, least
            end += 1
        while end > first and nears[end - 1] > limit:
            end -= 1
        ends[number + 1] = end
    return ends


@compiled()
def _corners(rows, item, left, top, right, bottom, view, out):  # type: ignore[no-untyped-def]
    # Minimum and maximum of z, across, and down, over the rays between a tile's corners and the
    # lens's; last 1, or 0 if the plane is parallel to some of the rays.
    out[0], out[2], out[4] = math.inf, math.inf, math.inf
    out[1], out[3], out[5] = -math.inf, -math.inf, -math.inf
    row, sign = row_of(rows, item), 0.0
    for corner in range(16):
        ox = view[1] if corner & 1 else -view[1]
        oy = view[1] if corner & 2 else -view[1]
        dx = (right if corner & 4 else left) - ox / view[2]
        dy = (bottom if corner & 8 else top) - oy / view[2]
        falling = _along(row, AWAY, dx, dy, 1.0)
        if falling == 0.0 or falling * sign < 0.0:
            out[6] = 0.0
            return
        sign = falling
        x, y, z = row[0] - ox, row[1] - oy, row[2]
        t = _along(row, AWAY, x, y, z) / falling
        x, y, z = t * dx - x, t * dy - y, t - z
        u, v = _along(row, ACROSS, x, y, z), _along(row, DOWN, x, y, z)
        out[0], out[1] = min(out[0], t), max(out[1], t)
        out[2], out[3] = min(out[2], u), max(out[3], u)
        out[4], out[5] = min(out[4], v), max(out[5], v)
    out[6] = 1.0


@compiled(error_model="numpy")
def _meet_in_order(kinds, rows, items, nears, rays, zs, met):  # type: ignore[no-untyped-def]
    # Replace each ray's z by that of the first surface that it meets before it, and note which.
    farthest = math.inf
    for item, least in zip(items, nears):  # noqa: B905 - numba knows no `strict`
        if least >= farthest:
            break
        kind, row = kinds[item], row_of(rows, item)
        # Each with the code of one kind.
        if kind == RECTANGLE:
            _meet_each(RECTANGLE, row, item, least, rays, zs, met)
        elif kind == DISC:
            _meet_each(DISC, row, item, least, rays, zs, met)
        elif kind == LATTICE:
            _meet_each(LATTICE, row, item, least, rays, zs, met)
        elif kind == SPHERE:
            _meet_each(SPHERE, row, item, least, rays, zs, met)
        else:
            _meet_each(CYLINDER, row, item, least, rays, zs, met)
        farthest = zs.max()


@compiled(inline="always")
def _meet_each(kind, row, item, least, rays, zs, met):  # type: ignore[no-untyped-def]
    ox, oy, dx, dy = rays
    for ray in range(len(zs)):
        t = meet(kind, row, ox[ray], oy[ray], 0.0, dx[ray], dy[ray], 1.0)
        # What is nearer than `CLOSEST` can be met before its `least`.
        first = (t < zs[ray]) & (least < zs[ray])
        met[ray] = item if first else met[ray]
        zs[ray] = t if first else zs[ray]


@compiled(error_model="numpy")
def gather(  # type: ignore[no-untyped-def]
    scene, tiles, tile_size, points, picks, view, ring, channel, begin, end, out
):
    """Sum the light of rows `begin` to `end` of an image, as a mean over the lens and the pixel.

    Parameters
    ----------
    scene : tuple
        Kinds, rows, near ends, textures' numbers, first levels, levels, atlas, charts, lightmap.
    tiles : tuple of ndarray
        The end of each tile's surfaces, and the arrays that `list_tiles` filled.
    tile_size : int
        In pixels.
    points : ndarray of float64, shape (set, sample, 4)
        A ray's place on the lens, (x, y) relative to a round lens's radius, and in its pixel, from
        -1/2 to 1/2.
    picks : ndarray, shape (y, x)
        The set that a pixel uses.
    view : tuple of float
        Focal length in pixels; lens radius and focus distance in metres.
    ring : tuple of float
        Distance and radius in metres of a second stop before the lens; radius 0 for none.
    channel : int
        The channel to fill; -1 for all.
    begin, end : int
        The rows to compute.
    out : ndarray of float64, shape (y, x, 3)
        Receives the light.
    """
    kinds, rows, _, textures, starts, levels, atlas, charts, lightmap = scene
    ends, items, nears = tiles
    focal, radius, focus = view
    height, width = out.shape[:2]
    count = points.shape[1]
    spread = _SPREAD * 2.0 * radius / math.sqrt(count)
    rays, zs, met = np.empty((4, count)), np.empty(count), np.empty(count, np.int64)
    ox, oy, dx, dy = rays
    for y in range(begin, end):
        for x in range(width):
            tile = (y // tile_size) * ((width + tile_size - 1) // tile_size) + x // tile_size
            first, last = ends[tile], ends[tile + 1]
            own = points[picks[y, x]]
            for ray in range(count):
                ox[ray], oy[ray] = radius * own[ray, 0], radius * own[ray, 1]
                dx[ray] = (x - 0.5 * (width - 1) + own[ray, 2]) / focal - ox[ray] / focus
                dy[ray] = (y - 0.5 * (height - 1) + own[ray, 3]) / focal - oy[ray] / focus
            zs[:], met[:] = math.inf, -1
            if ring[1] > 0.0:
                for ray in range(count):
                    a, b = ox[ray] + ring[0] * dx[ray], oy[ray] + ring[0] * dy[ray]
                    zs[ray] = -math.inf if a * a + b * b > ring[1] * ring[1] else math.inf
            _meet_in_order(kinds, rows, items[first:last], nears[first:last], rays, zs, met)
            red, green, blue = 0.0, 0.0, 0.0
            for ray in range(count):
                item, z = met[ray], zs[ray]
                if item < 0:
                    continue
                u, v = ox[ray] + z * dx[ray], oy[ray] + z * dy[ray]
                u, v = place_on(kinds[item], row_of(rows, item), u, v, z)
                light = light_at(lightmap, charts, item, u, v)
                finest = max(_FINEST * z / focal, spread * abs(1.0 - z / focus))
                texels = rows[item, TEXELS]
                r, g, b = colour_at(atlas, levels, starts, textures[item], u, v, texels, finest)
                red += light * r * rows[item, TINT]
                green += light * g * rows[item, TINT + 1]
                blue += light * b * rows[item, TINT + 2]
            for number, light in enumerate((red, green, blue)):
                if channel < 0 or channel == number:
                    out[y, x, number] = light / count


@compiled(error_model="numpy")
def distances(scene, tiles, tile_size, focal, out):  # type: ignore[no-untyped-def]
    """Fill `out` with the z in metres that a pinhole sees at each pixel's centre.

    All parameters are as in `gather`.
    """
    kinds, rows = scene[0], scene[1]
    ends, items, nears = tiles
    height, width = out.shape
    rays, zs, met = np.zeros((4, 1)), np.empty(1), np.empty(1, np.int64)
    for y in range(height):
        for x in range(width):
            tile = (y // tile_size) * ((width + tile_size - 1) // tile_size) + x // tile_size
            rays[2, 0] = (x - 0.5 * (width - 1)) / focal
            rays[3, 0] = (y - 0.5 * (height - 1)) / focal
            zs[0] = math.inf
            first, last = ends[tile], ends[tile + 1]
            _meet_in_order(kinds, rows, items[first:last], nears[first:last], rays, zs, met)
            out[y, x] = zs[0]


@compiled()
def fall(  # type: ignore[no-untyped-def]
    kinds, rows, hulls, places, normals, lamps, ball, ambient, reach, sky, out
):
    """Fill `out` with the light that falls on places; see `dfdbench.simulation.lighting.lit`.

    Parameters
    ----------
    kinds, rows : ndarray
        The scene's surfaces.
    hulls : ndarray of float64, shape (surface, 4)
        Middle and radius of a ball around each surface.
    places, normals : ndarray of float64, shape (node, 3)
        The places, and the side that light comes from.
    lamps : ndarray of float64, shape (lamp, 5)
        Place, radius, strength.
    ball : ndarray of float64, shape (point, 3)
        Points of a lamp's surface, of radius 1.
    ambient, reach : float
        The even light, and the distance in metres within which a surface blocks it.
    sky : ndarray of float64, shape (ray, 3)
        Directions around (0, 0, 1), with a density that follows their cosine.
    out : ndarray of float64, shape (node,)
        Receives the light.
    """
    for begin in range(0, len(places), _RUN):
        run = places[begin : begin + _RUN]
        x, y, z = run[len(run) // 2]
        reached = 0.0
        for node in range(len(run)):
            a, b, c = run[node, 0] - x, run[node, 1] - y, run[node, 2] - z
            reached = max(reached, math.sqrt(a * a + b * b + c * c))
        reached += 2 * _OFF
        close = _between(hulls, x, y, z, x, y, z, reached + reach)
        for node in range(begin, begin + len(run)):
            _add_sky(
                kinds, rows, close, places[node], normals[node], ambient, reach, sky, out, node
            )
        for lamp in lamps:
            wide = max(reached, lamp[3])
            close = _between(hulls, x, y, z, lamp[0], lamp[1], lamp[2], wide)
            for node in range(begin, begin + len(run)):
                _add_lamp(kinds, rows, close, places[node], normals[node], lamp, ball, out, node)


@compiled()
def _between(hulls, ax, ay, az, bx, by, bz, wide):  # type: ignore[no-untyped-def]
    # The surfaces whose balls are within a distance of the line from a to b.
    found = np.empty(len(hulls), np.int64)
    count = 0
    x, y, z = bx - ax, by - ay, bz - az
    square = x * x + y * y + z * z
    for item in range(len(hulls)):
        p, q, r = hulls[item, 0] - ax, hulls[item, 1] - ay, hulls[item, 2] - az
        along = (p * x + q * y + r * z) / square if square > 0.0 else 0.0
        along = min(max(along, 0.0), 1.0)
        p, q, r = p - along * x, q - along * y, r - along * z
        limit = wide + hulls[item, 3]
        if p * p + q * q + r * r <= limit * limit:
            found[count] = item
            count += 1
    return found[:count]


@compiled()
def _add_lamp(kinds, rows, close, place, normal, lamp, ball, out, node):  # type: ignore[no-untyped-def]
    nx, ny, nz = normal
    x, y, z = place[0] + _OFF * nx, place[1] + _OFF * ny, place[2] + _OFF * nz
    seen = 0.0
    for point in range(len(ball)):
        dx = lamp[0] + lamp[3] * ball[point, 0] - x
        dy = lamp[1] + lamp[3] * ball[point, 1] - y
        dz = lamp[2] + lamp[3] * ball[point, 2] - z
        facing = dx * nx + dy * ny + dz * nz
        if facing > 0.0 and not _hidden(kinds, rows, close, x, y, z, dx, dy, dz):
            square = dx * dx + dy * dy + dz * dz
            seen += facing / (square * math.sqrt(square))
    out[node] += lamp[4] * seen / len(ball)


@compiled()
def _add_sky(  # type: ignore[no-untyped-def]
    kinds, rows, close, place, normal, ambient, reach, sky, out, node
):
    nx, ny, nz = normal
    x, y, z = place[0] + _OFF * nx, place[1] + _OFF * ny, place[2] + _OFF * nz
    # Two directions at right angles to the normal and to each other.
    if abs(nx) < 0.6:
        ax, ay, az = 0.0, nz, -ny
    else:
        ax, ay, az = -nz, 0.0, nx
    length = math.sqrt(ax * ax + ay * ay + az * az)
    ax, ay, az = ax / length, ay / length, az / length
    bx, by, bz = ny * az - nz * ay, nz * ax - nx * az, nx * ay - ny * ax
    free = 0
    for ray in range(len(sky)):
        p, q, r = reach * sky[ray, 0], reach * sky[ray, 1], reach * sky[ray, 2]
        dx = p * ax + q * bx + r * nx
        dy = p * ay + q * by + r * ny
        dz = p * az + q * bz + r * nz
        if not _hidden(kinds, rows, close, x, y, z, dx, dy, dz):
            free += 1
    out[node] = ambient * (_LEAST_SKY + (1.0 - _LEAST_SKY) * free / len(sky))


@compiled(error_model="numpy")
def _hidden(kinds, rows, close, ox, oy, oz, dx, dy, dz):  # type: ignore[no-untyped-def]
    found = False
    for item in close:
        if meet(kinds[item], row_of(rows, item), ox, oy, oz, dx, dy, dz) < 1.0:
            found = True
            break
    return found
