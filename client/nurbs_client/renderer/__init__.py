"""Drawing with OpenGL 4.3 through EGL, with no display: the only part of the client that touches OpenGL."""
