"""The one door to MuJoCo and OpenGL: sets the off-screen back end before the first import.

Everything of armsight that needs MuJoCo imports it from here.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from armsight.errors import ArmsightError

os.environ.setdefault("MUJOCO_GL", "egl")
# Mesa's software renderer: pictures of small triangles are drawn soonest in narrow vectors, and
# in the thread that asks, since the cores have other work. Graphics cards do not read these.
os.environ.setdefault("LP_NATIVE_VECTOR_WIDTH", "128")
os.environ.setdefault("LP_NUM_THREADS", "0")

import mujoco

OPENGL_HELP = (
    "install it with 'apt-get install libegl1 libgl1-mesa-dri libopengl0' "
    "(other systems: Mesa's EGL), or set MUJOCO_GL=osmesa with libosmesa6"
)

__all__ = ["OPENGL_HELP", "OpenGLContext", "check_opengl", "mujoco"]


class OpenGLContext:
    """An off-screen OpenGL context that any thread may borrow, one at a time.

    OpenGL binds a context to a thread; this one is bound only inside :meth:`current`, so the page,
    the loop and a test may render in turns.

    Raises:
        ArmsightError: no context can be made; says which packages are missing.
    """

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._depth = 0
        try:
            from mujoco.rendering.classic import gl_context

            if not hasattr(gl_context, "GLContext") or gl_context.GLContext is None:
                raise ImportError(f"MUJOCO_GL={os.environ.get('MUJOCO_GL')} offers no context")
            self._context: Any = gl_context.GLContext(1, 1)
            self._context.make_current()
            self._release()
        except Exception as problem:  # PyOpenGL raises anything from AttributeError to GLError
            raise ArmsightError(
                f"no OpenGL for the simulated cameras ({_first_line(problem)}): {OPENGL_HELP}"
            ) from problem

    @contextmanager
    def current(self) -> Iterator[None]:
        """Bind the context to this thread for the duration of the block."""
        with self._lock:
            if self._depth == 0:
                self._context.make_current()
            self._depth += 1
            try:
                yield
            finally:
                self._depth -= 1
                if self._depth == 0:
                    self._release()

    def close(self) -> None:
        """Give the context back; may be repeated."""
        with self._lock:
            if self._context is not None:
                self._context.free()
                self._context = None

    def _release(self) -> None:
        egl = sys.modules.get("mujoco.egl")
        if egl is not None and getattr(egl, "EGL_DISPLAY", None) is not None:
            EGL = egl.EGL
            EGL.eglMakeCurrent(
                egl.EGL_DISPLAY, EGL.EGL_NO_SURFACE, EGL.EGL_NO_SURFACE, EGL.EGL_NO_CONTEXT
            )


def check_opengl() -> str:
    """Name of the OpenGL renderer, such as ``llvmpipe``.

    Raises:
        ArmsightError: there is none; says what to install.
    """
    context = OpenGLContext()
    try:
        with context.current():
            from OpenGL import GL  # type: ignore[import-untyped]

            name = GL.glGetString(GL.GL_RENDERER)
            return "a renderer without a name" if name is None else str(name.decode())
    finally:
        context.close()


def _first_line(problem: Exception) -> str:
    lines = str(problem).strip().splitlines()
    return lines[0] if lines else type(problem).__name__
