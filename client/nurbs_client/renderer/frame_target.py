"""What a frame is drawn into: colour with several samples a pixel and reversed float depth, read back as one image.

``samples`` is split into what the card offers per pixel and, beyond that, a larger image that is averaged
down by a shader. Where the processor draws, all of it is the larger image: at 1 M small triangles llvmpipe
takes 0.72 s of processor time for four times the pixels and 1.9 s for four samples a pixel, and the
shading is sampled too.
"""

from __future__ import annotations

import math

import moderngl
import numpy as np
import numpy.typing as npt

from nurbs_client.errors import GraphicsError
from nurbs_client.renderer import shaders
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
        offered = 0 if context.is_software else min(samples, gl.max_samples)
        self.msaa = max((n for n in (2, 4, 8, 16) if n <= offered), default=0)
        self.factor = max(math.ceil(math.sqrt(samples / max(self.msaa, 1))), 1)
        self.inner_size = (size[0] * self.factor, size[1] * self.factor)
        if max(self.inner_size) > MAX_SIDE:
            raise GraphicsError(f"image of {self.inner_size[0]}x{self.inner_size[1]} samples: the limit is {MAX_SIDE}")
        self._large = gl.texture(self.inner_size, 4)
        plain = gl.framebuffer(self._large)
        self._resolved: moderngl.Framebuffer | None = None
        self.framebuffer = plain
        if self.msaa:
            self._resolved = plain
            self.framebuffer = gl.framebuffer(gl.renderbuffer(self.inner_size, 4, samples=self.msaa))
        self._depth = context.attach_float_depth(self.framebuffer, self.inner_size, self.msaa)
        self._average = _Average(context, size, self.factor) if self.factor > 1 else None
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
        if self._average is not None:
            source = self._average.of(self._large)
        raw = np.frombuffer(source.read(components=3, alignment=1), np.uint8)
        return np.ascontiguousarray(raw.reshape(self.size[1], self.size[0], 3)[::-1])

    def release(self) -> None:
        """Free the buffers."""
        self._context.idle.use()  # moderngl binds what was bound before again, gone or not
        self._context.delete_depth(self._depth)
        for framebuffer in (self.framebuffer, self._resolved):
            if framebuffer is not None:
                framebuffer.release()
        self._large.release()
        if self._average is not None:
            self._average.release()


class _Average:
    """Averages blocks of ``factor`` by ``factor`` pixels into an image of ``size``."""

    def __init__(self, context: Context, size: tuple[int, int], factor: int) -> None:
        self._gl = context.gl
        self._program = self._gl.program(vertex_shader=shaders.COVER_VERTEX, fragment_shader=shaders.AVERAGE_FRAGMENT)
        self._program["factor"] = factor
        self._array = self._gl.vertex_array(self._program, [])
        self._small = self._gl.framebuffer(self._gl.renderbuffer(size, 4))

    def of(self, large: moderngl.Texture) -> moderngl.Framebuffer:
        """A framebuffer with the average; it is overwritten by the next."""
        self._small.use()
        self._gl.enable_only(moderngl.NOTHING)
        large.use(0)
        self._array.render(moderngl.TRIANGLES, vertices=3)
        return self._small

    def release(self) -> None:
        """Free the buffers."""
        for owned in (self._array, self._program, self._small):
            owned.release()
