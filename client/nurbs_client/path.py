"""Camera paths: keyframes in a JSON file, or an orbit that looks at the whole scene and then closer.

::

    {"keyframes": [{"time": 0, "eye": [900, -700, 500], "target": [0, 0, 0], "up": [0, 0, 1], "fov": 40},
                   {"time": 4, "eye": [200, -150, 120], "target": [10, 0, 30]}],
     "frames": 48}

Lengths are millimetres of the assembly, times seconds, ``fov`` the vertical field of view in degrees.
``up`` and ``fov`` are optional and last until they are given again. ``frames`` is optional too: how
many frames the path has, evenly spaced in time from the first keyframe to the last.

Between keyframes eye and target follow Catmull-Rom splines through time (Hermite form with finite
differences for uneven times), ``up`` turns on the great circle, and ``fov`` changes linearly.
"""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from nurbs_cache.errors import InputFileError, UsageError
from nurbs_client.camera import MAX_FOV_DEG, MIN_FOV_DEG, Camera, unit

DEFAULT_FOV_DEG = 40.0
DEFAULT_UP = (0.0, 0.0, 1.0)
FRAMES_PER_SECOND = 12  # where a file does not say how many frames it wants
AUTO_FRAMES = 24
NEAR_PER_DIAGONAL = 1e-6  # near plane: a car's is a few micrometres away, reversed depth does not mind
MAX_FRAMES = 1_000_000

Finite = Annotated[float, Field(allow_inf_nan=False)]
Point = tuple[Finite, Finite, Finite]


class Keyframe(BaseModel):
    """Where the camera is at one time."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    time: Finite
    eye: Point
    target: Point
    up: Point = DEFAULT_UP
    fov: Annotated[float, Field(ge=MIN_FOV_DEG, le=MAX_FOV_DEG)] = DEFAULT_FOV_DEG

    @model_validator(mode="after")
    def _apart(self) -> Keyframe:
        if self.eye == self.target:
            raise ValueError(f"eye and target are the same point at time {self.time}")
        if not any(self.up):
            raise ValueError(f"up has no direction at time {self.time}")
        return self


class CameraPath(BaseModel):
    """A path as the file has it, with what was left out filled in."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    keyframes: Annotated[tuple[Keyframe, ...], Field(min_length=1)]
    frames: Annotated[int, Field(ge=1, le=MAX_FRAMES)] | None = None

    @model_validator(mode="before")
    @classmethod
    def _carry_on(cls, value: object) -> object:
        """A bare list is a list of keyframes; ``time``, ``up`` and ``fov`` carry on from the one before."""
        content = {"keyframes": value} if isinstance(value, list) else value
        if not isinstance(content, dict) or not isinstance(content.get("keyframes"), list):
            return content
        filled: list[object] = []
        for number, key in enumerate(content["keyframes"]):
            if isinstance(key, dict):
                last = filled[-1] if filled and isinstance(filled[-1], dict) else {}
                carried = {name: last[name] for name in ("up", "fov") if name in last}
                key = {"time": number, **carried, **key}
            filled.append(key)
        return {**content, "keyframes": filled}

    @model_validator(mode="after")
    def _in_order(self) -> CameraPath:
        times = [key.time for key in self.keyframes]
        for before, after in pairwise(times):
            if not after > before:
                raise ValueError(f"times must increase: {after} follows {before}")
        return self

    @property
    def n_frames(self) -> int:
        """Frames of the whole path."""
        duration = self.keyframes[-1].time - self.keyframes[0].time
        return self.frames or min(max(round(duration * FRAMES_PER_SECOND) + 1, 1), MAX_FRAMES)

    def frame_times(self, n_frames: int | None = None) -> npt.NDArray[np.float64]:
        """(n,) times of the frames, evenly spaced, first and last keyframe included."""
        n = n_frames or self.n_frames
        return np.linspace(self.keyframes[0].time, self.keyframes[-1].time, n)

    def camera(self, time: float, size: tuple[int, int], near: float) -> Camera:
        """The camera at ``time`` (clamped to the path) for a window of ``size`` pixels."""
        keys = self.keyframes
        times = np.array([key.time for key in keys])
        time = float(np.clip(time, times[0], times[-1]))
        at = int(np.clip(np.searchsorted(times, time, side="right") - 1, 0, max(len(keys) - 2, 0)))
        eye = _hermite(times, np.array([key.eye for key in keys]), at, time)
        target = _hermite(times, np.array([key.target for key in keys]), at, time)
        after = keys[min(at + 1, len(keys) - 1)]
        s = (time - times[at]) / (after.time - times[at]) if after.time > times[at] else 0.0
        up = slerp(unit(keys[at].up), unit(after.up), s)
        fov = keys[at].fov + s * (after.fov - keys[at].fov)
        if not np.any(eye != target):  # the splines may meet where the keyframes do not
            target = eye + unit(np.asarray(keys[at].target) - np.asarray(keys[at].eye)) * near
        return Camera(eye, target, up, fov, size[0], size[1], near)


def _hermite(
    times: npt.NDArray[np.float64], points: npt.NDArray[np.float64], at: int, time: float
) -> npt.NDArray[np.float64]:
    """Catmull-Rom through (n, 3) ``points`` at ``times``, in the span that begins at ``at``."""
    if len(points) == 1:
        return np.array(points[0])
    step = times[at + 1] - times[at]
    tangents = [_tangent(times, points, i) for i in (at, at + 1)]
    s = (time - times[at]) / step
    result = (
        (1 + 2 * s) * (1 - s) ** 2 * points[at]
        + s * (1 - s) ** 2 * step * tangents[0]
        + s**2 * (3 - 2 * s) * points[at + 1]
        - s**2 * (1 - s) * step * tangents[1]
    )
    return np.asarray(result, dtype=np.float64)


def _tangent(times: npt.NDArray[np.float64], points: npt.NDArray[np.float64], i: int) -> npt.NDArray[np.float64]:
    """Derivative at keyframe ``i`` of the parabola through it and its neighbours; a chord at the ends."""
    if i == 0:
        return np.asarray((points[1] - points[0]) / (times[1] - times[0]))
    if i == len(points) - 1:
        return np.asarray((points[i] - points[i - 1]) / (times[i] - times[i - 1]))
    before, after = times[i] - times[i - 1], times[i + 1] - times[i]
    slope0, slope1 = (points[i] - points[i - 1]) / before, (points[i + 1] - points[i]) / after
    return np.asarray((slope0 * after + slope1 * before) / (before + after))


def slerp(a: npt.NDArray[np.float64], b: npt.NDArray[np.float64], s: float) -> npt.NDArray[np.float64]:
    """Unit vector on the great circle from ``a`` to ``b``; opposite ones go round by a fixed side."""
    cosine = float(np.clip(a @ b, -1.0, 1.0))
    across = b - cosine * a
    if float(np.linalg.norm(across)) < 1e-12:
        if cosine > 0:
            return a
        across = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))])
    angle = s * math.acos(cosine)
    return np.asarray(math.cos(angle) * a + math.sin(angle) * unit(across))


def load_path(path: Path | str) -> CameraPath:
    """Read a path file.

    Raises:
        InputFileError: it is missing, no JSON, or does not follow the schema; the message names the field.
    """
    try:
        return CameraPath.model_validate_json(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputFileError(f"{path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise InputFileError(f"{path}: not UTF-8 text") from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "file"
        raise InputFileError(f"{path}: {where}: {first['msg']}") from error


def auto_path(low: npt.NDArray[np.float64], high: npt.NDArray[np.float64], aspect: float = 16 / 9) -> CameraPath:
    """Once around the box at a falling height, then closer to its middle.

    Args:
        low: (3,) lower corner of the scene's box, mm.
        high: (3,) upper corner.
        aspect: width by height of the image.
    """
    centre, half = (low + high) / 2.0, (high - low) / 2.0
    keys = []
    n_orbit = 8
    for number in range(n_orbit + 3):
        turn = min(number / n_orbit, 1.0 + 0.04 * (number - n_orbit))
        azimuth = math.radians(-55.0 + 360.0 * turn)
        elevation = math.radians(32.0 - 14.0 * math.sin(math.pi * min(turn, 1.0)))
        ray = np.array(
            [math.cos(azimuth) * math.cos(elevation), math.sin(azimuth) * math.cos(elevation), math.sin(elevation)]
        )
        closer = 1.0 if number <= n_orbit else 0.5 ** (1.3 * (number - n_orbit))
        distance = _distance_to_fit(ray, half, aspect) * closer
        keys.append(
            Keyframe(time=float(number), eye=tuple((centre + ray * distance).tolist()), target=tuple(centre.tolist()))
        )
    return CameraPath(keyframes=tuple(keys), frames=AUTO_FRAMES)


def _distance_to_fit(ray: npt.NDArray[np.float64], half: npt.NDArray[np.float64], aspect: float) -> float:
    """Distance along ``ray`` from a box's centre at which all its corners are inside the image, with a margin."""
    probe = Camera(ray, np.zeros(3), np.array(DEFAULT_UP), DEFAULT_FOV_DEG, 1000, 1000)
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
    corners = (signs * half) @ probe.rotation.T
    tangent = math.tan(math.radians(DEFAULT_FOV_DEG) / 2.0) * 0.9
    reach = np.maximum(np.abs(corners[:, 0]) / (tangent * aspect), np.abs(corners[:, 1]) / tangent)
    return max(float((reach - corners[:, 2]).max()), float(np.linalg.norm(half)) * 1.05, 1e-6)


def chosen_frames(path: CameraPath, text: str | None) -> tuple[npt.NDArray[np.float64], list[int]]:
    """Times and numbers of the frames to draw.

    Args:
        path: the path.
        text: None for all of the path's own frames; ``N``: N frames, evenly spaced over the path;
            ``A:B`` or ``A:B:STEP``: some of the path's own, as in a Python slice.

    Raises:
        UsageError: no such frames.
    """
    if text is None:
        return path.frame_times(), list(range(path.n_frames))
    try:
        if ":" not in text:
            n = int(text)
            if not 1 <= n <= MAX_FRAMES:
                raise ValueError
            return path.frame_times(n), list(range(n))
        bounds = [int(part) if part.strip() else None for part in text.split(":")]
        numbers = list(range(path.n_frames))[slice(*bounds)]
    except (ValueError, TypeError):
        raise UsageError(f"frames: {text!r} is neither N nor A:B nor A:B:STEP") from None
    if not numbers:
        raise UsageError(f"frames: {text!r} names none of the path's {path.n_frames} frames")
    return path.frame_times()[numbers], numbers
