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
BLOCK = 128  # vertices at a time: what is noted of them stays in the first-level cache
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
    (x0, y0, z0), (x1, y1, z1) = low, high
    largest = max(abs(x0), abs(y0), abs(z0), abs(x1), abs(y1), abs(z1))
    if not (largest <= MAX_COORDINATE and math.isfinite(x0 + y0 + z0 + x1 + y1 + z1)):
        raise UsageError(f"positions from {low} to {high} mm: want finite numbers up to {MAX_COORDINATE:.3g}")
    # rounding both ends can add one step to the extent
    exponent = _exponent_above(max(x1 - x0, y1 - y0, z1 - z0) / (2**bits - 2))
    # every coordinate in steps must be an exact integer in float64
    exponent = max(exponent, math.frexp(largest)[1] - 53, min_exponent, MIN_EXPONENT)
    per_mm = math.ldexp(1.0, -exponent)
    i0, j0, k0 = round(x0 * per_mm), round(y0 * per_mm), round(z0 * per_mm)
    i1, j1, k1 = round(x1 * per_mm), round(y1 * per_mm), round(z1 * per_mm)
    return Grid(exponent, (float(i0), float(j0), float(k0)), (i1 - i0, j1 - j0, k1 - k0))


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
    x0 = x1 = positions[0, 0]
    y0 = y1 = positions[0, 1]
    z0 = z1 = positions[0, 2]
    finite = True
    for i in range(positions.shape[0]):
        x, y, z = positions[i, 0], positions[i, 1], positions[i, 2]
        x0, x1 = min(x0, x), max(x1, x)
        y0, y1 = min(y0, y), max(y1, y)
        z0, z1 = min(z0, z), max(z1, z)
        finite &= (abs(x) < np.inf) & (abs(y) < np.inf) & (abs(z) < np.inf)
    if not finite:
        for i in range(positions.shape[0]):
            x, y, z = positions[i, 0], positions[i, 1], positions[i, 2]
            if not ((abs(x) < np.inf) & (abs(y) < np.inf) & (abs(z) < np.inf)):
                return i
    box[0, 0], box[1, 0] = x0, x1
    box[0, 1], box[1, 1] = y0, y1
    box[0, 2], box[1, 2] = z0, z1
    return -1


@kernel
def _quantise(positions, inverse_step, base_x, base_y, base_z, steps):  # type: ignore[no-untyped-def]
    """Largest squared distance, and largest coordinate difference, in steps."""
    flat, flat_steps = positions.reshape(-1), steps.reshape(-1)
    bases, ways = np.empty(3 * BLOCK), np.empty(3 * BLOCK)
    for j in range(0, 3 * BLOCK, 3):
        bases[j], bases[j + 1], bases[j + 2] = base_x, base_y, base_z
    squares = 0.0
    single = 0.0
    for start in range(0, flat.shape[0], 3 * BLOCK):
        count = min(3 * BLOCK, flat.shape[0] - start)
        given, rounded = flat[start : start + count], flat_steps[start : start + count]
        for j in range(count):  # in vector registers
            place = given[j] * inverse_step
            nearest = np.rint(place)
            rounded[j] = np.int32(nearest - bases[j])
            ways[j] = abs(place - nearest)
        for j in range(0, count, 3):
            dx, dy, dz = ways[j], ways[j + 1], ways[j + 2]
            squares = max(squares, dx * dx + dy * dy + dz * dz)
            single = max(single, max(dx, max(dy, dz)))
    return squares, single


@kernel
def _fold_normals(normals, half, octahedral):  # type: ignore[no-untyped-def]
    """Row of a normal that is not finite, or -1."""
    one, zero, scale = np.float32(1.0), np.float32(0.0), np.float32(half)
    tiny = np.float32(1e-30)  # shorter ones count as zero vectors
    middle = np.int32(half)
    xyz, uv = np.empty((3, BLOCK), np.float32), np.empty((2, BLOCK), np.int32)
    for start in range(0, normals.shape[0], BLOCK):
        count = min(BLOCK, normals.shape[0] - start)
        for j in range(count):
            for k in range(3):
                xyz[k, j] = normals[start + j, k]
        finite = True
        for j in range(count):  # in vector registers
            x, y, z = xyz[0, j], xyz[1, j], xyz[2, j]
            total = abs(x) + abs(y) + abs(z)
            finite &= total < np.float32(np.inf)
            inverse = one / (total if total > tiny else one)
            u = x * inverse
            v = y * inverse
            fold = z < zero
            folded_u = np.copysign(one - abs(v), u)
            folded_v = np.copysign(one - abs(u), v)
            u = folded_u if fold else u
            v = folded_v if fold else v
            uv[0, j] = np.int32(np.rint(u * scale)) + middle
            uv[1, j] = np.int32(np.rint(v * scale)) + middle
        if not finite:
            for i in range(start, start + count):
                if not abs(normals[i, 0]) + abs(normals[i, 1]) + abs(normals[i, 2]) < np.inf:
                    return i
        for j in range(count):
            octahedral[start + j, 0] = uv[0, j]
            octahedral[start + j, 1] = uv[1, j]
    return -1
