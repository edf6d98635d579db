"""Which nodes and surfaces are drawn in a frame, and which tiles would make it better.

Pure functions of the tables, the camera and what is resident; no graphics, no network. Per frame:

1. *Visit* top down: cull boxes outside the frustum; a node whose error shows more than the target is
   to be refined, into its children and its direct surfaces at the fitting LOD level. Refining happens
   at once; a node refined in the last frame is coarsened only when its error is clearly small enough
   and its tile is there.
2. *Check* bottom up: a node can be refined if each visible child can be drawn, itself or through its
   own children, and each visible direct surface has some LOD.
3. *Emit* top down: what can be refined is; otherwise the node itself is drawn until its children are
   complete. Everything that would bring the picture nearer to the target is wanted, with a priority.

Source: Guthe, Balazs, Klein 2004, sections 4.1 and 4.2; ``screen_error`` for the measure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, kernel
from nurbs_client.scene import Floats, Ints, ItemArrays, NodeArrays, Scene
from nurbs_client.screen_error import View, allowed_error, box_is_outside, box_mm_per_px

Bytes = npt.NDArray[np.uint8]
Longs = npt.NDArray[np.int64]

MIN_LEVEL, MAX_LEVEL = -20, 20  # levels of LODs: from a nanometre to a kilometre
LEVEL_BIAS = -MIN_LEVEL  # bit of level 0 in a surface's mask of resident levels
COARSEN = 0.8  # coarsen below this part of the allowed error: 25 % farther away than where refining began

RESIDENT, BROKEN = 1, 2  # of ``Residency.node``
CULLED, REFINE, READY, ACTIVE, QUIET = 1, 2, 4, 8, 16  # flags of a visited node; QUIET: nothing below is wanted
HOLE_PRIORITY = 1e6  # nothing at all can be drawn: before everything else


class Residency(NamedTuple):
    """What can be drawn now."""

    node: Bytes  # (n_nodes,) RESIDENT, BROKEN where the tile cannot be had, else 0
    lod_mask: Longs  # (n_surfaces,) bit level + LEVEL_BIAS set where that LOD is resident
    own_mm_per_px: Floats  # (n_items,) lower bound from a surface's own geometry; 0 if unknown, inf if not visible


class _Work(NamedTuple):
    """Per-frame arrays, one slot per visited node."""

    rows: Ints
    first: Ints  # slot of the first visited child
    flags: Bytes
    mm_per_px: Floats
    item_mm_per_px: Floats  # (n_items,) of direct surfaces of refined nodes, -1 where culled


class _Output(NamedTuple):
    node: Ints  # rows to draw
    node_mm_per_px: Floats
    item: Ints  # items to draw
    item_level: Ints
    item_mm_per_px: Floats
    want_node: Ints
    want_node_priority: Floats
    want_item: Ints
    want_level: Ints
    want_item_priority: Floats
    hole_px: Floats
    counts: Longs  # drawn nodes, drawn items, wanted nodes, wanted items, holes, substitutes


@dataclass(frozen=True, eq=False)
class Selection:
    """The outcome for one frame.

    Attributes:
        nodes: rows whose tiles are drawn; node_mm_per_px: (n,) where on screen they are.
        items: rows of the direct surfaces that are drawn, at ladder level ``item_levels`` of their own space;
            item_mm_per_px: (n,) where on screen they are.
        wanted_nodes, wanted_items, wanted_levels: what is missing, with priorities above 1 for what shows.
        refined: (n_nodes,) 1 where a node was drawn through its children; feed it to the next frame.
        n_culled: boxes outside the frustum, each standing for its subtree.
        n_holes: visible nodes or surfaces of which nothing at all could be drawn; hole_px: their size.
        n_substitutes: nodes drawn although they are too coarse, because a child is missing.
    """

    nodes: Ints
    node_mm_per_px: Floats
    items: Ints
    item_levels: Ints
    item_mm_per_px: Floats
    wanted_nodes: Ints
    wanted_node_priority: Floats
    wanted_items: Ints
    wanted_levels: Ints
    wanted_item_priority: Floats
    refined: Bytes
    n_culled: int
    hole_px: Floats
    n_holes: int
    n_substitutes: int
    n_visited: int

    @property
    def is_complete(self) -> bool:
        """Whether everything is drawn at the target, nothing coarser."""
        return self.n_holes == 0 and self.n_substitutes == 0 and not (self.wanted_item_priority > 1).any()


@helper
def level_below(error: float, scale: float) -> int:
    """Coarsest ladder level whose budget, stretched by ``scale``, is at most ``error`` mm."""
    if not error > math.ldexp(scale, MIN_LEVEL):
        return MIN_LEVEL
    if error >= math.ldexp(scale, MAX_LEVEL):  # infinite where nothing can be seen
        return MAX_LEVEL
    return int(math.floor(math.log2(error / scale)))


@helper
def pick_level(mask: int, wanted: int) -> int:
    """Resident level to draw: the coarsest that is fine enough, else the finest; MAX_LEVEL + 1 if none."""
    for level in range(wanted, MIN_LEVEL - 1, -1):
        if mask >> (level + LEVEL_BIAS) & 1:
            return level
    for level in range(wanted + 1, MAX_LEVEL + 1):
        if mask >> (level + LEVEL_BIAS) & 1:
            return level
    return MAX_LEVEL + 1


@helper
def coarsest_level(items: ItemArrays, item: int, node_level: int) -> int:
    """Coarsest LOD level that improves on the tile of the node that holds the surface: half its error."""
    return level_below(math.ldexp(1.0, node_level - 1), items.scale[item])


@helper
def wanted_level(items: ItemArrays, item: int, node_level: int, allowed: float) -> int:
    """LOD level for a direct surface: within ``allowed`` mm, at most half its node's error, and not too fine."""
    level = min(coarsest_level(items, item, node_level), level_below(allowed, items.scale[item]))
    return min(max(level, items.finest[item], MIN_LEVEL), MAX_LEVEL)


@kernel
def _visit(
    nodes: NodeArrays, roots: Ints, view: View, target_px: float, resident: Bytes, refined: Bytes, work: _Work
) -> tuple[int, int]:
    """Fill ``work`` with the visible tree down to the target, parents before children."""
    count = 0
    culled = 0
    for root in roots:
        work.rows[count] = root
        count += 1
    slot = 0
    while slot < count:
        row = work.rows[slot]
        work.flags[slot] = 0
        if box_is_outside(view, nodes.aabb_min[row], nodes.aabb_max[row]):
            work.flags[slot] = CULLED
            culled += 1
            slot += 1
            continue
        mm_per_px = box_mm_per_px(view, nodes.aabb_min[row], nodes.aabb_max[row])
        work.mm_per_px[slot] = mm_per_px
        allowed = allowed_error(mm_per_px, target_px, view.focal_px)
        finer = refined[row] and (nodes.error[row] > COARSEN * allowed or resident[row] != RESIDENT)
        if finer or nodes.error[row] > allowed or resident[row] == BROKEN:
            work.flags[slot] = REFINE
        if work.flags[slot] & REFINE and nodes.n_children[row] + nodes.n_direct[row] > 0:
            work.first[slot] = count
            for child in range(nodes.n_children[row]):
                work.rows[count] = nodes.first_child[row] + child
                count += 1
        else:
            work.flags[slot] = 0
        slot += 1
    return count, culled


@kernel
def _check(nodes: NodeArrays, items: ItemArrays, view: View, residency: Residency, count: int, work: _Work) -> int:
    """Mark the nodes that can be drawn through their children; returns the culled direct surfaces."""
    culled = 0
    for slot in range(count - 1, -1, -1):
        if not work.flags[slot] & REFINE:
            continue
        row = work.rows[slot]
        ready = True
        for child in range(nodes.n_children[row]):
            below = work.first[slot] + child
            if not (work.flags[below] & (CULLED | READY) or residency.node[work.rows[below]] == RESIDENT):
                ready = False
        for item in range(nodes.first_item[row], nodes.first_item[row] + nodes.n_direct[row]):
            if box_is_outside(view, items.aabb_min[item], items.aabb_max[item]):
                work.item_mm_per_px[item] = -1.0
                culled += 1
                continue
            mm_per_px = box_mm_per_px(view, items.aabb_min[item], items.aabb_max[item])
            work.item_mm_per_px[item] = max(mm_per_px, residency.own_mm_per_px[item])
            if residency.own_mm_per_px[item] == math.inf:  # its box is in the image, it is not
                work.item_mm_per_px[item] = -1.0
                culled += 1
                continue
            coarsest = coarsest_level(items, item, nodes.level[row])
            if pick_level(residency.lod_mask[items.surface[item]], coarsest) > coarsest:
                ready = False
        if ready:
            work.flags[slot] |= READY
    return culled


@helper
def _hole(low: Floats, high: Floats, mm_per_px: float, out: _Output) -> None:
    """Note that nothing of a box is drawn: the error is its size."""
    total = 0.0
    for axis in range(3):
        total += (high[axis] - low[axis]) ** 2
    out.hole_px[out.counts[4]] = math.sqrt(total) / mm_per_px
    out.counts[4] += 1


@helper
def _want_node(out: _Output, row: int, priority: float) -> None:
    out.want_node[out.counts[2]] = row
    out.want_node_priority[out.counts[2]] = priority
    out.counts[2] += 1


@helper
def _direct_surfaces(
    nodes: NodeArrays, items: ItemArrays, view: View, target_px: float, residency: Residency,
    row: int, priority: float, draw: bool, want: bool, work: _Work, out: _Output,
) -> None:  # fmt: skip
    """Draw the direct surfaces of a refined node, want what they lack, or both."""
    for item in range(nodes.first_item[row], nodes.first_item[row] + nodes.n_direct[row]):
        mm_per_px = work.item_mm_per_px[item]
        if mm_per_px < 0.0:
            continue
        allowed = allowed_error(mm_per_px, target_px, view.focal_px)
        level = wanted_level(items, item, nodes.level[row], allowed)
        mask = residency.lod_mask[items.surface[item]]
        picked = pick_level(mask, level)
        urgency = 0.0
        if picked > MAX_LEVEL:
            if draw:
                _hole(items.aabb_min[item], items.aabb_max[item], mm_per_px, out)
            urgency = priority
        elif picked > level:
            urgency = min(math.ldexp(1.0, picked - level), priority) if not draw else math.ldexp(1.0, picked - level)
        if want and urgency > 0.0:
            out.want_item[out.counts[3]] = item
            out.want_level[out.counts[3]] = level
            out.want_item_priority[out.counts[3]] = urgency
            out.counts[3] += 1
        if draw and picked <= MAX_LEVEL:
            out.item[out.counts[1]] = item
            out.item_level[out.counts[1]] = picked
            out.item_mm_per_px[out.counts[1]] = mm_per_px
            out.counts[1] += 1


@kernel
def _emit(
    nodes: NodeArrays, items: ItemArrays, view: View, target_px: float, residency: Residency,
    n_roots: int, count: int, refined: Bytes, work: _Work, out: _Output,
) -> None:  # fmt: skip
    """Turn the flags into lists of what is drawn and what is wanted."""
    for slot in range(n_roots):
        work.flags[slot] |= ACTIVE
    for slot in range(count):
        flags = work.flags[slot]
        if not flags & ACTIVE or flags & CULLED:
            continue
        row = work.rows[slot]
        resident = residency.node[row] == RESIDENT
        want = flags & QUIET == 0
        excess = nodes.error[row] / allowed_error(work.mm_per_px[slot], target_px, view.focal_px)
        if flags & REFINE and (flags & READY or not resident):
            # Draw the children. Without the node's own tile even when they are incomplete; but then it is the
            # node's tile that is wanted first, and nothing below it unless that tile is broken.
            refined[row] = 1
            if want and not resident:
                _want_node(out, row, 1.0 / excess if flags & READY else HOLE_PRIORITY)
                want = flags & READY != 0 or residency.node[row] == BROKEN
            for child in range(nodes.n_children[row]):
                work.flags[work.first[slot] + child] |= ACTIVE if want else ACTIVE | QUIET
            _direct_surfaces(nodes, items, view, target_px, residency, row, excess, True, want, work, out)
            continue
        if not resident:
            _hole(nodes.aabb_min[row], nodes.aabb_max[row], work.mm_per_px[slot], out)
            if want:
                _want_node(out, row, HOLE_PRIORITY)
            continue
        out.node[out.counts[0]] = row
        out.node_mm_per_px[out.counts[0]] = work.mm_per_px[slot]
        out.counts[0] += 1
        if not flags & REFINE:
            continue
        # Stand in for the children until all of them can be drawn.
        out.counts[5] += 1
        if want:
            for child in range(nodes.n_children[row]):
                below = work.first[slot] + child
                if not (work.flags[below] & (CULLED | READY) or residency.node[work.rows[below]] == RESIDENT):
                    _want_node(out, work.rows[below], max(excess, 1.0 + 1e-9))
            _direct_surfaces(nodes, items, view, target_px, residency, row, excess, False, True, work, out)


def select(scene: Scene, view: View, target_px: float, residency: Residency, refined: Bytes | None = None) -> Selection:
    """Decide what is drawn from ``view`` so that errors show at most ``target_px`` pixels.

    Args:
        scene: the tables.
        view: of the camera (``Camera.view``).
        target_px: allowed error on screen, pixels, > 0.
        residency: what can be drawn now.
        refined: (n_nodes,) of the last frame's selection; None to decide by this view alone.

    Source: Guthe, Balazs, Klein 2004, section 4.1.
    """
    nodes, items = scene.node_arrays, scene.item_arrays
    n, m = len(nodes.parent), len(items.surface)
    before = np.zeros(n, np.uint8) if refined is None else refined
    work = _Work(np.empty(n, np.int32), np.zeros(n, np.int32), np.empty(n, np.uint8), np.empty(n), np.empty(m))
    count, culled = _visit(nodes, scene.roots, view, target_px, residency.node, before, work)
    culled += _check(nodes, items, view, residency, count, work)
    now = np.zeros(n, np.uint8)
    out = _empty_output(n, m)
    _emit(nodes, items, view, target_px, residency, len(scene.roots), count, now, work, out)
    return _as_selection(out, now, culled, count)


def _empty_output(n: int, m: int) -> _Output:
    ints, floats = np.int32, np.float64
    return _Output(
        np.empty(n, ints), np.empty(n, floats), np.empty(m, ints), np.empty(m, ints), np.empty(m, floats),
        np.empty(2 * n, ints), np.empty(2 * n, floats), np.empty(m, ints), np.empty(m, ints), np.empty(m, floats),
        np.empty(n + m, floats), np.zeros(6, np.int64),
    )  # fmt: skip


def _as_selection(out: _Output, refined: Bytes, culled: int, visited: int) -> Selection:
    n, m, wn, wm, holes, substitutes = (int(c) for c in out.counts)
    return Selection(
        nodes=out.node[:n],
        node_mm_per_px=out.node_mm_per_px[:n],
        items=out.item[:m],
        item_levels=out.item_level[:m],
        item_mm_per_px=out.item_mm_per_px[:m],
        wanted_nodes=out.want_node[:wn],
        wanted_node_priority=out.want_node_priority[:wn],
        wanted_items=out.want_item[:wm],
        wanted_levels=out.want_level[:wm],
        wanted_item_priority=out.want_item_priority[:wm],
        refined=refined,
        n_culled=culled,
        hole_px=out.hole_px[:holes],
        n_holes=holes,
        n_substitutes=substitutes,
        n_visited=visited,
    )
