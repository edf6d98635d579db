"""Positions on a grid whose step is a power of two, and unit normals on an octahedron.

Positions: with step s = 2**e, a coordinate x becomes the integer rint(x / s). The grid is therefore the
same in every tile of equal step, equal positions stay equal wherever they are stored, x / s and the
error are computed without rounding, and ``steps * s`` (at most 21 bits) is exact in float32::

    |----|----|----|----|----|       origin = rint(min / s) * s, a multiple of s
    origin    ^ x                    steps  = rint(x / s) - rint(min / s) >= 0

Normals: a direction is projected to the octahedron |x| + |y| + |z| = 1, whose lower half is folded
outwards into the square [-1, 1]^2. A grid with an odd number of points per side keeps the six axis
directions exact.

Source: Q. Meyer et al., On floating-point normal vectors, EGSR 2010, section 4 (octahedral normals).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import UsageError
from nurbs_cache.jit import kernel

MIN_POSITION_BITS, MAX_POSITION_BITS = 8, 21  # 21: a third of a 64-bit word, and exact in float32
MIN_NORMAL_BITS, MAX_NORMAL_BITS = 8, 12  # per coordinate: 0.96 to 0.06 degrees
MAX_COORDINATE = 2.0**60  # mm; beyond, squares and float32 would overflow
MIN_EXPONENT = -100  # finest step 2**-100 mm, so that steps stay normal numbers in float32
BLOCK = 256  # positions that are quantised at a time
_ROUND_UP = 1.0 + 2.0**-50
_SAFE_SQUARE = 1e-280  # squares below lose digits


@dataclass(frozen=True)
class Grid:
    """Where a tile's positions lie.

    Attributes:
        exponent: the step is 2**exponent mm.
        base: origin in steps, per axis; an integer below 2**53.
        extent: largest position in steps from the origin, per axis.
    """

    exponent: int
    base: tuple[float, float, float]
    extent: tuple[int, int, int]

    @property
    def step(self) -> float:
        """Distance of grid points, mm."""
        return math.ldexp(1.0, self.exponent)

    @property
    def origin(self) -> tuple[float, float, float]:
        """Position of the grid's corner, mm."""
        x, y, z = (math.ldexp(b, self.exponent) for b in self.base)
        return x, y, z


def choose_grid(lower: npt.ArrayLike, upper: npt.ArrayLike, bits: int, min_exponent: int = MIN_EXPONENT) -> Grid:
    """The finest grid for a box that needs at most ``bits`` bits a coordinate.

    Args:
        lower, upper: (3,) corners of the box, mm; equal ones are fine.
        bits: 8 to 21.
        min_exponent: no finer step than 2**min_exponent mm. Tiles that shall share one grid give the same.

    Raises:
        UsageError: bits out of range, or a box that is not finite or beyond 2**60 mm.
    """
    if not MIN_POSITION_BITS <= bits <= MAX_POSITION_BITS:
        raise UsageError(f"{bits} bits a position, want {MIN_POSITION_BITS} to {MAX_POSITION_BITS}")
    low: list[float] = np.asarray(lower, np.float64).tolist()
    high: list[float] = np.asarray(upper, np.float64).tolist()
    largest = max(map(abs, low + high))
    if not (largest <= MAX_COORDINATE and all(map(math.isfinite, low + high))):
        raise UsageError(f"positions from {low} to {high} mm: want finite numbers up to {MAX_COORDINATE:.3g}")
    # rounding both ends can add one step to the extent
    exponent = _exponent_above(max(b - a for a, b in zip(low, high, strict=True)) / (2**bits - 2))
    # every coordinate in steps must be an exact integer in float64
    exponent = max(exponent, math.frexp(largest)[1] - 53, min_exponent, MIN_EXPONENT)
    first = [float(round(math.ldexp(x, -exponent))) for x in low]
    last = [float(round(math.ldexp(x, -exponent))) for x in high]
    extent = [int(b - a) for a, b in zip(first, last, strict=True)]
    return Grid(exponent, (first[0], first[1], first[2]), (extent[0], extent[1], extent[2]))


def _exponent_above(length: float) -> int:
    """Smallest e with 2**e >= length."""
    mantissa, exponent = math.frexp(length)
    return MIN_EXPONENT if length == 0.0 else exponent - (mantissa == 0.5)


def quantise_positions(positions: npt.NDArray[np.float64], grid: Grid) -> tuple[npt.NDArray[np.int32], float]:
    """Positions (n, 3) in mm as (n, 3) int32 steps from the grid's origin, and the largest distance moved.

    The distance (mm) is measured over all positions and rounded up.
    """
    steps = np.empty(positions.shape, np.int32)
    base_x, base_y, base_z = grid.base
    squares, single = _quantise(positions, 1.0 / grid.step, base_x, base_y, base_z, steps)
    moved = math.sqrt(squares) if squares > _SAFE_SQUARE else single * math.sqrt(3.0)
    distance = moved * _ROUND_UP * grid.step
    # Among subnormal numbers a product has no bits left to be rounded up in.
    return steps, math.nextafter(distance, math.inf) if distance > 0.0 else 0.0


def box_of(positions: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """(2, 3) corners of the box of (n, 3) positions, n > 0.

    Raises:
        UsageError: a position is not finite.
    """
    box = np.empty((2, 3))
    bad = _measure_box(positions, box)
    if bad >= 0:
        raise UsageError(f"vertex {bad}: position {positions[bad].tolist()} mm is not finite")
    return box


def quantise_normals(normals: npt.NDArray[np.float32], bits: int) -> npt.NDArray[np.int32]:
    """Directions (n, 3) as (n, 2) int32 octahedral coordinates, 0 to 2**bits - 2.

    Lengths do not matter; a zero vector becomes +z. The direction moves by ``normal_error_deg`` at most.

    Raises:
        UsageError: a normal is not finite, or bits are out of range.
    """
    if not MIN_NORMAL_BITS <= bits <= MAX_NORMAL_BITS:
        raise UsageError(f"{bits} bits a normal coordinate, want {MIN_NORMAL_BITS} to {MAX_NORMAL_BITS}")
    octahedral = np.empty((len(normals), 2), np.int32)
    bad = _fold_normals(normals, 2 ** (bits - 1) - 1, octahedral)
    if bad >= 0:
        raise UsageError(f"vertex {bad}: normal {normals[bad].tolist()} is not finite")
    return octahedral


def normal_error_deg(bits: int) -> float:
    """Largest angle between a direction and its quantised form, degrees.

    Rounding moves a point of the square by half a cell's diagonal at most; the way to the sphere
    stretches by 3 at most (by sqrt 3 onto the octahedron's face, by sqrt 3 from its centre to the sphere).
    """
    moved = math.sqrt(0.5) / (2 ** (bits - 1) - 1)
    return 1.001 * math.degrees(3.0 * moved)  # 0.1 %: arc against tangent, and float32


@kernel
def _measure_box(positions, box):  # type: ignore[no-untyped-def]
    """Row of a position that is not finite, or -1."""
    n = positions.shape[0]
    x0 = x1 = u0 = u1 = positions[0, 0]
    y0 = y1 = v0 = v1 = positions[0, 1]
    z0 = z1 = w0 = w1 = positions[0, 2]
    finite = True
    # two by two: a minimum need not wait for the one before
    for pair in range((n + 1) // 2):
        i = 2 * pair
        j = min(i + 1, n - 1)
        x, y, z = positions[i, 0], positions[i, 1], positions[i, 2]
        u, v, w = positions[j, 0], positions[j, 1], positions[j, 2]
        x0, x1, u0, u1 = min(x0, x), max(x1, x), min(u0, u), max(u1, u)
        y0, y1, v0, v1 = min(y0, y), max(y1, y), min(v0, v), max(v1, v)
        z0, z1, w0, w1 = min(z0, z), max(z1, z), min(w0, w), max(w1, w)
        finite &= (abs(x) < np.inf) & (abs(y) < np.inf) & (abs(z) < np.inf)
        finite &= (abs(u) < np.inf) & (abs(v) < np.inf) & (abs(w) < np.inf)
    if not finite:
        for i in range(n):
            x, y, z = positions[i, 0], positions[i, 1], positions[i, 2]
            if not ((abs(x) < np.inf) & (abs(y) < np.inf) & (abs(z) < np.inf)):
                return i
    box[0, 0], box[1, 0] = min(x0, u0), max(x1, u1)
    box[0, 1], box[1, 1] = min(y0, v0), max(y1, v1)
    box[0, 2], box[1, 2] = min(z0, w0), max(z1, w1)
    return -1


@kernel
def _quantise(positions, inverse_step, base_x, base_y, base_z, steps):  # type: ignore[no-untyped-def]
    """Largest squared distance, and largest coordinate difference, in steps."""
    squares = 0.0
    single = 0.0
    n = positions.shape[0]
    way = np.empty((2, BLOCK))
    for start in range(0, n, BLOCK):
        count = min(BLOCK, n - start)
        for j in range(count):  # in vector registers
            i = start + j
            x = positions[i, 0] * inverse_step
            y = positions[i, 1] * inverse_step
            z = positions[i, 2] * inverse_step
            rx = np.rint(x)
            ry = np.rint(y)
            rz = np.rint(z)
            steps[i, 0] = np.int32(rx - base_x)
            steps[i, 1] = np.int32(ry - base_y)
            steps[i, 2] = np.int32(rz - base_z)
            dx = abs(x - rx)
            dy = abs(y - ry)
            dz = abs(z - rz)
            way[0, j] = dx * dx + dy * dy + dz * dz
            way[1, j] = max(dx, max(dy, dz))
        for j in range(count):
            squares = max(squares, way[0, j])
            single = max(single, way[1, j])
    return squares, single


@kernel
def _fold_normals(normals, half, octahedral):  # type: ignore[no-untyped-def]
    """Row of a normal that is not finite, or -1."""
    one = np.float32(1.0)
    scale = np.float32(half)
    tiny = np.float32(1e-30)  # shorter ones count as zero vectors
    finite = True
    for i in range(normals.shape[0]):
        x, y, z = normals[i, 0], normals[i, 1], normals[i, 2]
        total = abs(x) + abs(y) + abs(z)
        finite &= total < np.inf
        inverse = one / (total if total > tiny else one)
        u = x * inverse
        v = y * inverse
        fold = z < np.float32(0.0)
        folded_u = np.copysign(one - abs(v), u)
        folded_v = np.copysign(one - abs(u), v)
        u = folded_u if fold else u
        v = folded_v if fold else v
        octahedral[i, 0] = np.int32(np.rint(u * scale)) + half
        octahedral[i, 1] = np.int32(np.rint(v * scale)) + half
    if not finite:
        for i in range(normals.shape[0]):
            if not abs(normals[i, 0]) + abs(normals[i, 1]) + abs(normals[i, 2]) < np.inf:
                return i
    return -1
