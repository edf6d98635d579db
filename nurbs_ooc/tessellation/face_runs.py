"""The faces of a round, taken one after the other by all threads that have nothing to do.

A thread stays inside compiled code until no face is left: it keeps its workspace, and how long a face takes does not
matter to the balance. Which faces it has done, in which order, it tells with them (``Chunk.turns``).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.borrowed import borrowed
from nurbs_cache.jit import helper, kernel
from nurbs_cache.surface_record import FaceReason
from nurbs_cache.turns import new_turns, next_turn
from nurbs_ooc.bounds.pieces import Pieces
from nurbs_ooc.geometry.tables import Tables
from nurbs_ooc.tessellation.assemble import Arrays, Chunk, Round
from nurbs_ooc.tessellation.edge_samples import EdgeSamples
from nurbs_ooc.tessellation.emit import Output, emit_face, emit_points, new_output, with_room
from nurbs_ooc.tessellation.face import (
    BOX_AS_POINTS,
    DEGRADED,
    EXTRA,
    GAP,
    NO_ROOM,
    READY,
    REASON,
    STATUS,
    TRIM,
    WORST,
    Draft,
    tessellate_face,
)
from nurbs_ooc.tessellation.fallback import box_diagonal
from nurbs_ooc.tessellation.shading import ANGLE, APPEARANCE, Aim
from nurbs_ooc.tessellation.workers import Threads
from nurbs_ooc.tessellation.workspace import Workspace, larger, new_workspace

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# Beside the results of ``tessellate_face``: the arrays that faces are appended to are full.
NO_OUTPUT = 3
# Vertices of a face that there is room for at first.
FIRST_VERTICES = 256
# Faces of a chunk, at most: what comes out is copied once more if there are several.
MOST_FACES = 8192
# The same of several threads, whose chunks are copied anyway: Ctrl-C is noticed between them.
FEW_FACES = 256
NO_TRIANGLES = int(FaceReason.NO_TRIANGLES)


@helper
def _finish_face(
    g: Tables, p: Pieces, row: int, w: Workspace, d: Draft, o: Output, codes: Ints, errors: Floats, apart: bool
) -> bool:
    """Append the face in the workspace to ``o``, with its codes (3,) and errors (5,); False if there is no room."""
    first, drawn = o.n[0], o.n[1]
    points = d.code[REASON] == BOX_AS_POINTS
    if not (emit_points(w, o) if points else emit_face(g, p, row, w, apart, o)):
        return False
    errors[0], errors[1], errors[2] = d.error[WORST], d.error[TRIM] + d.error[EXTRA], d.error[GAP]
    errors[3], errors[4] = d.found[ANGLE], d.found[APPEARANCE]
    if not points and o.n[1] == drawn and codes[1] < DEGRADED:
        # Every triangle has two corners in one place: its points alone stand for it.
        codes[1], codes[2] = DEGRADED, NO_TRIANGLES
        errors[1] += box_diagonal(o.position[first : o.n[0]])
    return True


@helper
def _face_after_face(
    g: Tables, p: Pieces, samples: EdgeSamples, faces: Ints, turns: Ints, error: float, final: bool, wanted: Ints,
    aim: Aim | None, w: Workspace, d: Draft, o: Output, taken: Ints, ends: Ints, codes: Ints, errors: Floats,
    done: int, lack: int,
) -> tuple[int, int]:  # fmt: skip
    """Take faces until none is left or something is too small: how many are done, and NO_ROOM in ``w`` or NO_OUTPUT.

    ``done`` and ``lack`` are what the call before has returned: the face that it came to is done first; with
    NO_OUTPUT it is in the workspace already.
    """
    for i in range(done, len(taken)):
        resumed = i == done and lack != READY
        if not resumed:
            taken[i] = next_turn(turns)
            if taken[i] >= len(faces):
                return i, READY
        row = faces[taken[i]]
        s = g.surfaces[row]
        if s.status == 3:
            codes[i, 1], codes[i, 2] = s.status, s.reason
        else:
            code = READY
            if not (resumed and lack == NO_OUTPUT):
                d.code[STATUS], d.code[REASON] = 0, 0
                d.found[ANGLE], d.found[APPEARANCE] = 0.0, 0.0
                code = tessellate_face(g, p, samples, row, error, final, w, wanted, d, aim)
                if code == NO_ROOM:
                    return i, NO_ROOM
                codes[i, 0], codes[i, 1], codes[i, 2] = code, s.status, s.reason
                if d.code[STATUS] > codes[i, 1]:
                    codes[i, 1], codes[i, 2] = d.code[STATUS], d.code[REASON]
            if code == READY and not _finish_face(g, p, row, w, d, o, codes[i], errors[i], aim is not None):
                return i, NO_OUTPUT
        for k in range(3):
            ends[i, k] = o.n[k]
    return len(taken), READY


@kernel
def _faces(
    g: Tables, p: Pieces, samples: EdgeSamples, faces: Ints, turns: Ints, error: float, final: bool, wanted: Ints,
    aim: Aim | None, most: int,
) -> tuple[tuple[Floats, Floats, Floats, Ints, Ints], tuple[Ints, Ints, Ints, Floats]]:  # fmt: skip
    """Tessellate at most ``most`` faces that others leave: ``Arrays``, and the other fields of their ``Chunk``.

    In plain tuples: to make a named one Python runs code, and if Ctrl-C is waiting numba gets nothing and crashes.
    """
    o = new_output(FIRST_VERTICES * most)
    taken = np.empty(most, dtype=np.int64)
    ends = np.zeros((most, 3), dtype=np.int64)
    codes = np.zeros((most, 3), dtype=np.int64)
    errors = np.zeros((most, 5))
    w = new_workspace(g, faces)
    d = Draft(np.zeros(4), np.zeros(2, dtype=np.int64), np.zeros(2))
    done, lack = 0, READY
    while True:
        # All of it is lent: counting who has it took a seventh of the time, more where threads count at once.
        done, lack = _face_after_face(
            borrowed(g), borrowed(p), borrowed(samples), borrowed(faces), borrowed(turns), error, final,
            borrowed(wanted), borrowed(aim), borrowed(w), borrowed(d), borrowed(o), borrowed(taken), borrowed(ends),
            borrowed(codes), borrowed(errors), done, lack,
        )  # fmt: skip
        if lack == NO_ROOM:
            w = larger(w)
        elif lack == NO_OUTPUT:
            o = with_room(o)
        else:
            break
    arrays = o.position, o.normal, o.uv, o.triangle, o.segment
    return arrays, (taken[:done], ends[:done], codes[:done], errors[:done])


def run_faces(
    g: Tables, pieces: Pieces, samples: EdgeSamples, faces: Ints, error: float, final: bool, aim: Aim | None,
    threads: Threads,
) -> tuple[Round, Ints]:  # fmt: skip
    """Tessellate ``faces``; with it, into how many parts they ask that each segment be cut (n_samples,).

    Args:
        g, pieces, samples: the part.
        faces: (n,) distinct rows.
        error: mm.
        final: whether faces have to do without more samples.
        aim: what is to be kept beside the distance.
        threads: those that do it.
    """
    turns = new_turns()
    most = min(len(faces), MOST_FACES if threads.workers == 1 else FEW_FACES)

    def share() -> tuple[list[Chunk], Ints]:
        """What one thread has done."""
        wanted = np.zeros(len(samples.t), np.int64)
        chunks = []
        try:
            while turns[0] < len(faces):
                arrays, found = _faces(g, pieces, samples, faces, turns, error, final, wanted, aim, most)
                chunks.append(Chunk(Arrays(*arrays), *found))
        finally:
            turns[0] = len(faces)  # after a failure nobody begins another
        return chunks, wanted

    shares = threads.each(share, len(faces))
    chunks = [chunk for own, _ in shares for chunk in own if len(chunk.turns)]
    wanted = np.maximum.reduce([wanted for _, wanted in shares])
    rows = faces[np.concatenate([c.turns for c in chunks])] if chunks else faces[:0]
    return Round(rows, chunks), wanted
