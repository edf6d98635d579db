"""What a frame is drawn into: multisampled colour and reversed float depth, resolved and read back.

``samples`` is split into what the card offers per pixel (4 on llvmpipe) and, beyond that, a larger
image that is averaged down.
"""

from __future__ import annotations

import math

import moderngl
import numpy as np
import numpy.typing as npt

from nurbs_client.errors import GraphicsError
from nurbs_client.renderer.context import Context

MAX_SIDE = 16384


class FrameTarget:
    """A framebuffer of one size.

    Args:
        context: current.
        size: width and height of the final image, pixels.
        samples: per pixel, 1 to 64; rounded up to what can be had.
    """

    def __init__(self, context: Context, size: tuple[int, int], samples: int = 1) -> None:
        self._context = context
        gl = context.gl
        self.size = size
        self.msaa = max((n for n in (0, 2, 4, 8, 16) if n <= min(samples, gl.max_samples)), default=0)
        self.factor = max(math.ceil(math.sqrt(samples / max(self.msaa, 1))), 1)
        self.inner_size = (size[0] * self.factor, size[1] * self.factor)
        if max(self.inner_size) > MAX_SIDE:
            raise GraphicsError(f"image of {self.inner_size[0]}x{self.inner_size[1]} samples: the limit is {MAX_SIDE}")
        self._colour = gl.renderbuffer(self.inner_size, 4, samples=self.msaa)
        self.framebuffer = gl.framebuffer(self._colour)
        self._depth = context.attach_float_depth(self.framebuffer, self.inner_size, self.msaa)
        self._resolved: moderngl.Framebuffer | None = None
        if self.msaa:
            self._resolved = gl.framebuffer(gl.renderbuffer(self.inner_size, 4))
        context.check("making a framebuffer")

    @property
    def samples(self) -> int:
        """Samples per pixel of the final image."""
        return max(self.msaa, 1) * self.factor**2

    def begin(self) -> None:
        """Bind and clear: depth 0 is infinitely far."""
        self.framebuffer.use()
        self.framebuffer.clear(1.0, 1.0, 1.0, 1.0, depth=0.0)

    def read(self) -> npt.NDArray[np.uint8]:
        """(height, width, 3) sRGB, top row first."""
        source = self.framebuffer
        if self._resolved is not None:
            self._context.gl.copy_framebuffer(self._resolved, self.framebuffer)
            source = self._resolved
        width, height = self.inner_size
        raw = np.frombuffer(source.read(components=3, alignment=1), np.uint8).reshape(height, width, 3)[::-1]
        if self.factor == 1:
            return np.ascontiguousarray(raw)
        k = self.factor
        blocks = raw.reshape(self.size[1], k, self.size[0], k, 3).astype(np.uint32).sum(axis=(1, 3))
        return np.asarray((blocks + k * k // 2) // (k * k), np.uint8)

    def release(self) -> None:
        """Free the buffers."""
        self._context.idle.use()  # moderngl binds what was bound before again, gone or not
        self._context.delete_depth(self._depth)
        for framebuffer in (self.framebuffer, self._resolved):
            if framebuffer is not None:
                framebuffer.release()
