"""Trimmed surfaces with their curves as flat arrays: the form that is stored, read back and handed to kernels.

A ``GeometryBatch`` holds the faces of one part as structure-of-arrays tables that point into one
another by row, and into one pool of float64 numbers by offset::

    surfaces --first_loop--> loops --first_coedge--> coedges --edge---> edges --curve--> curves --> values
        |                                               `---pcurve--> curves                        ^
        `---------------------------knots, points, frame--------------------------------------------'

Surfaces and curves are parametrised *natively*: angles in radians for everything that turns, lengths
in millimetres for everything that is straight, knot units for B-splines. Trimming curves live in the
same native parameters, so a helix on a cylinder stays a straight line. The exact rational NURBS of a
tagged surface, with the closed-form map of its parameters, is derived from the same record.

Kinds of surfaces, with ``O, X, Y, Z, a, b`` the 14 numbers at ``frame`` (X, Y, Z are mutually
orthonormal except where said)::

    NURBS       tensor product; control points (n_u, n_v, 3), or homogeneous (n_u, n_v, 4) if rational
    PLANE       O + u X + v Y
    CYLINDER    O + cos(u) X + sin(u) Y + v Z          X, Y carry the radii (elliptic, oblique allowed)
    CONE        O + (a + v sin b)(cos(u) X + sin(u) Y) + v cos(b) Z            b = half angle
    SPHERE      O + a cos(v)(cos(u) X + sin(u) Y) + a sin(v) Z
    TORUS       O + (a + b cos v)(cos(u) X + sin(u) Y) + b sin(v) Z
    REVOLUTION  C(v) turned by u about the axis through O along Z; C is the curve in row ``profile``
    EXTRUSION   C(u) + v Z                             Z is the (unit) direction

Kinds of curves, in ``dim`` = 2 or 3 dimensions::

    NURBS       control points (n, dim), or homogeneous (n, dim + 1) rows (w x, w y, [w z,] w) if rational
    ELLIPSE     C + cos(t) A + sin(t) B                at ``points``: C, A, B, each ``dim`` numbers
    HYPERBOLA   C + cosh(t) A + sinh(t) B              likewise
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from enum import IntEnum
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import CorruptRecordError

MAGIC = b"NGB1\0\0\0\0"


class SurfaceKind(IntEnum):
    """What a surface's record holds; see the module's table."""

    NURBS = 0
    PLANE = 1
    CYLINDER = 2
    CONE = 3
    SPHERE = 4
    TORUS = 5
    REVOLUTION = 6
    EXTRUSION = 7


class CurveKind(IntEnum):
    """What a curve's record holds; see the module's table."""

    NURBS = 0
    ELLIPSE = 1
    HYPERBOLA = 2


# What stands in place of an edge's curve: it is one point; it lies where its p-curves run on their surface.
POLE = -1
ON_SURFACE = -2


class FaceStatus(IntEnum):
    """How a face came through, best first. The worst of reading and tessellating counts."""

    EXACT = 0
    HEALED = 1
    DEGRADED = 2
    FAILED = 3


class FaceReason(IntEnum):
    """Coded reason why a face is not ``EXACT``."""

    NONE = 0
    # healed while reading
    OFFSET_APPROXIMATED = 10
    PCURVE_REBUILT = 11
    LOOP_GAP_CLOSED = 12
    LOOP_REORIENTED = 13
    LOOP_SHIFTED_BY_PERIOD = 14
    SEAM_ADDED = 15
    LOOP_MISSING = 16
    DEGENERATE_EDGE_DROPPED = 17
    WEIGHTS_NORMALISED = 18
    KNOTS_REPAIRED = 19
    # degraded or failed while reading
    KERNEL_CRASHED = 30
    KERNEL_REFUSED = 31
    NOT_FINITE = 32
    BAD_WEIGHTS = 33
    BAD_KNOTS = 34
    ZERO_AREA = 35
    # while tessellating
    LOOPS_CROSS = 50
    SNAP_ROUNDED = 51
    EVEN_ODD_MASK = 52
    BOX_AS_POINTS = 53
    BUDGET_EXHAUSTED = 54
    FILE_GAP = 55
    NO_TRIANGLES = 56
    NORMALS_NOT_KEPT = 57
    APPEARANCE_NOT_KEPT = 58


SURFACE_DTYPE = np.dtype(
    [
        ("kind", "u1"),  # SurfaceKind
        ("rational", "u1"),  # 1: control points are homogeneous
        ("reversed", "u1"),  # 1: the face's outside is against S_u x S_v
        ("status", "u1"),  # FaceStatus given by the reader
        ("reason", "u2"),  # FaceReason given by the reader
        ("degree_u", "i4"),
        ("degree_v", "i4"),
        ("n_u", "i4"),  # control points per direction (NURBS)
        ("n_v", "i4"),
        ("profile", "i4"),  # row of the profile curve (REVOLUTION, EXTRUSION), else -1
        ("first_loop", "i4"),
        ("n_loops", "i4"),  # 0: the whole native domain
        ("material", "i4"),  # row in the scene's materials
        ("source", "i4"),  # row in ``sources``
        ("knots_u", "i8"),  # offset in ``values``
        ("knots_v", "i8"),
        ("points", "i8"),
        ("frame", "i8"),  # offset of the 14 frame numbers, -1 for NURBS
        ("u0", "f8"),  # native domain that is used (loops lie inside)
        ("u1", "f8"),
        ("v0", "f8"),
        ("v1", "f8"),
        ("u_period", "f8"),  # 0: not periodic
        ("v_period", "f8"),
        ("approximation_error", "f8"),  # mm; what reading itself changed (offset surfaces)
        ("tolerance", "f8"),  # mm; the file's own tolerance of the face
    ],
    align=True,
)

CURVE_DTYPE = np.dtype(
    [
        ("kind", "u1"),  # CurveKind
        ("dim", "u1"),  # 2 (p-curve) or 3
        ("rational", "u1"),
        ("degree", "i4"),
        ("n", "i4"),  # control points (NURBS)
        ("knots", "i8"),  # offset in ``values``
        ("points", "i8"),
        ("t0", "f8"),  # used parameter range, t0 < t1
        ("t1", "f8"),
    ],
    align=True,
)

EDGE_DTYPE = np.dtype(
    [
        ("id", "u8"),  # id in the whole assembly: part << 32 | row
        ("curve", "i4"),  # row of the 3D curve; or POLE, ON_SURFACE
        ("vertex0", "i4"),  # row in ``vertices`` at t0
        ("vertex1", "i4"),  # row in ``vertices`` at t1
        ("t0", "f8"),
        ("t1", "f8"),
        ("tolerance", "f8"),  # mm, the file's own
    ],
    align=True,
)

COEDGE_DTYPE = np.dtype(
    [
        ("edge", "i4"),
        ("pcurve", "i4"),  # its t0..t1 is run through linearly as the edge's t0..t1
        ("reversed", "u1"),  # the loop runs along it from t1 to t0
        ("seam", "u1"),  # the same edge bounds this face twice
        ("pole", "u1"),  # the edge is one point in space
    ],
    align=True,
)

LOOP_DTYPE = np.dtype([("first_coedge", "i4"), ("n_coedges", "i4")], align=True)


@dataclass(frozen=True, eq=False)
class GeometryBatch:
    """The surfaces of one part with all curves they need (see the module's picture).

    Attributes:
        surfaces: (n_surfaces,) ``SURFACE_DTYPE``.
        loops: (n_loops,) ``LOOP_DTYPE``; outer loops counter-clockwise and holes clockwise in (u, v)
            where the file is right; consumers use the even-odd rule.
        coedges: (n_coedges,) ``COEDGE_DTYPE``, in running order of their loop.
        edges: (n_edges,) ``EDGE_DTYPE``, each once, whatever number of faces use it.
        curves: (n_curves,) ``CURVE_DTYPE``: p-curves, edge curves and profiles.
        vertices: (n_vertices, 3) float64, mm: the point in which edges meet.
        values: float64 pool of knots, control points and frames.
        sources: names of the faces in their file ("#123 BODY/FACE"), by ``surfaces["source"]``.
    """

    surfaces: npt.NDArray[np.void]
    loops: npt.NDArray[np.void]
    coedges: npt.NDArray[np.void]
    edges: npt.NDArray[np.void]
    curves: npt.NDArray[np.void]
    vertices: npt.NDArray[np.float64]
    values: npt.NDArray[np.float64]
    sources: list[str] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.surfaces)

    def to_bytes(self) -> bytes:
        """One self-contained byte string: magic, eight lengths (u64), then the tables, each padded to 8 bytes."""
        names = "\n".join(s.replace("\n", " ") for s in self.sources).encode()
        blobs = [getattr(self, f.name).tobytes() for f in fields(self) if f.name != "sources"]
        blobs.append(names)
        parts = [MAGIC, np.array([len(b) for b in blobs], "<u8").tobytes()]
        for blob in blobs:
            parts += [blob, b"\0" * (-len(blob) % 8)]
        return b"".join(parts)

    @classmethod
    def from_bytes(cls, data: bytes | memoryview) -> Self:
        """Inverse of ``to_bytes``; the arrays are writable views of one copy of ``data``.

        Raises:
            CorruptRecordError: the record is truncated or not one of ours.
        """
        view = memoryview(bytearray(data))
        head = len(MAGIC) + 8 * 8
        if len(view) < head or bytes(view[: len(MAGIC)]) != MAGIC:
            raise CorruptRecordError(f"surface record: {len(view)} bytes do not start with {MAGIC!r}")
        lengths = [int(n) for n in np.frombuffer(view[len(MAGIC) : head], "<u8")]
        starts = [head]
        for n in lengths:
            starts.append(starts[-1] + n + (-n % 8))
        if starts[-1] != len(view):
            raise CorruptRecordError(f"surface record: {len(view)} bytes, header says {starts[-1]}")
        blobs = [view[start : start + n] for start, n in zip(starts, lengths, strict=False)]
        dtypes = [SURFACE_DTYPE, LOOP_DTYPE, COEDGE_DTYPE, EDGE_DTYPE, CURVE_DTYPE, np.dtype(float), np.dtype(float)]
        try:
            arrays: list[npt.NDArray[Any]] = [
                np.frombuffer(blob, dtype) for blob, dtype in zip(blobs, dtypes, strict=False)
            ]
            vertices = arrays[5].reshape(-1, 3)
            names = bytes(blobs[7]).decode()
        except ValueError as error:
            raise CorruptRecordError(f"surface record: {error}") from error
        surfaces, loops, coedges, edges, curves = arrays[:5]
        return cls(surfaces, loops, coedges, edges, curves, vertices, arrays[6], names.split("\n") if names else [])
