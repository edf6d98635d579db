"""An OpenGL context without a display, and the four calls that moderngl does not offer.

Reversed depth needs clip space depth from 0 to 1 (``glClipControl``) and a float32 depth buffer;
moderngl makes 24-bit integer ones only, so ours are made by hand and hung into its framebuffers.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import moderngl

from nurbs_client.errors import GraphicsError

GL_LOWER_LEFT, GL_ZERO_TO_ONE = 0x8CA1, 0x935F
GL_DEPTH_COMPONENT32F, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER = 0x8CAC, 0x8D00, 0x8D41

MISSING = "OpenGL through EGL is not available ({reason}): install libegl1 libgl1 libgl1-mesa-dri (Debian's names)"
MINIMUM_VERSION = 450  # glClipControl and direct state access


@dataclass
class Context:
    """A current context with what moderngl lacks.

    moderngl's garbage collection stays off: an object of a context that is gone, collected late, would
    delete whatever has its number in the context of the day. What is made is released by its owner.

    Attributes:
        gl: moderngl's context.
    """

    gl: moderngl.Context

    @cached_property
    def idle(self) -> moderngl.Framebuffer:
        """A framebuffer to be bound while no other is: without a display there is no default one."""
        return self.gl.simple_framebuffer((1, 1))

    @cached_property
    def renderer(self) -> str:
        """What draws, as OpenGL names it."""
        return str(self.gl.info["GL_RENDERER"])

    @property
    def is_software(self) -> bool:
        """Whether the processor draws."""
        return "llvmpipe" in self.renderer or "softpipe" in self.renderer

    @cached_property
    def _egl(self) -> ctypes.CDLL:
        egl = ctypes.CDLL("libEGL.so.1")
        egl.eglGetProcAddress.restype = ctypes.c_void_p
        egl.eglGetProcAddress.argtypes = [ctypes.c_char_p]
        return egl

    def _call(self, name: str, *arguments: Any) -> None:
        """Call an OpenGL function of unsigned integers and pointers by name."""
        address = self._egl.eglGetProcAddress(name.encode())
        if not address:
            raise GraphicsError(f"OpenGL of {self.renderer} has no {name}")
        types = [ctypes.c_void_p if not isinstance(a, int) else ctypes.c_uint for a in arguments]
        ctypes.CFUNCTYPE(None, *types)(address)(*arguments)

    def use_reversed_depth(self) -> None:
        """Clip space depth from 0 to 1, nearer is greater."""
        self._call("glClipControl", GL_LOWER_LEFT, GL_ZERO_TO_ONE)
        self.gl.depth_func = ">"

    def attach_float_depth(self, framebuffer: moderngl.Framebuffer, size: tuple[int, int], samples: int) -> int:
        """Hang a new float32 depth buffer into ``framebuffer``; returns its name for ``delete_depth``."""
        name = ctypes.c_uint(0)
        self._call("glCreateRenderbuffers", 1, ctypes.byref(name))
        self._call("glNamedRenderbufferStorageMultisample", name.value, samples, GL_DEPTH_COMPONENT32F, *size)
        self._call("glNamedFramebufferRenderbuffer", framebuffer.glo, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER, name.value)
        framebuffer.depth_mask = True
        return name.value

    def delete_depth(self, name: int) -> None:
        """Free a buffer of ``attach_float_depth``."""
        self._call("glDeleteRenderbuffers", 1, ctypes.byref(ctypes.c_uint(name)))

    def check(self, doing: str) -> None:
        """Raise ``GraphicsError`` if OpenGL has recorded an error since the last check."""
        error = self.gl.error
        if error != "GL_NO_ERROR":
            raise GraphicsError(f"{doing}: {error} on {self.renderer}")

    def release(self) -> None:
        """Give everything back."""
        self.gl.release()


def create_context() -> Context:
    """A new context, current on this thread; hardware if EGL finds some, else software.

    Raises:
        GraphicsError: EGL or OpenGL is missing or older than 4.5.
    """
    try:
        gl = cast("Any", moderngl).create_context(
            standalone=True, backend="egl", libgl="libGL.so.1", libegl="libEGL.so.1"
        )
    except Exception as error:  # moderngl raises bare Exception
        raise GraphicsError(MISSING.format(reason=str(error).strip() or type(error).__name__)) from error
    if gl.version_code < MINIMUM_VERSION:
        raise GraphicsError(f"{gl.info['GL_RENDERER']} has OpenGL {gl.version_code / 100}, needed is 4.5")
    context = Context(gl)
    context.idle.use()
    context.use_reversed_depth()
    return context
