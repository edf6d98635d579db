"""What can go wrong between the client and where its tiles come from."""

from __future__ import annotations

from nurbs_cache.errors import CacheError, NurbsOocError


class ServerError(NurbsOocError):
    """The server cannot be reached, or what answers is no server of ours."""


class RefusedError(CacheError):
    """The server answers, but not with what was asked for; other requests may fare better."""


class GraphicsError(NurbsOocError):
    """OpenGL is missing, too old, or refuses what the renderer needs."""
