"""A subset of a part resolves, pointer by pointer, to the same surfaces as the whole part."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from nurbs_cache.errors import UsageError
from nurbs_cache.surface_record import (
    COEDGE_DTYPE,
    CURVE_DTYPE,
    EDGE_DTYPE,
    LOOP_DTYPE,
    SURFACE_DTYPE,
    CurveKind,
    GeometryBatch,
    SurfaceKind,
)
from nurbs_ooc.geometry.join import join_parts
from nurbs_ooc.geometry.subset import expand, subset


def random_part(seed: int, n_surfaces: int = 12) -> GeometryBatch:
    """A part whose pointers are random but valid; its shapes mean nothing."""
    rng = np.random.default_rng(seed)
    values = rng.normal(size=600)
    n_curves, n_edges, n_vertices = 20, 15, 9

    curves = np.zeros(n_curves, CURVE_DTYPE)
    curves["kind"] = rng.integers(0, 3, n_curves)
    curves["dim"] = rng.integers(2, 4, n_curves)
    curves["rational"] = rng.integers(0, 2, n_curves)
    curves["degree"] = rng.integers(1, 4, n_curves)
    curves["n"] = curves["degree"] + rng.integers(1, 5, n_curves)
    curves["knots"] = rng.integers(0, 500, n_curves)
    curves["points"] = rng.integers(0, 500, n_curves)
    curves["t0"] = rng.normal(size=n_curves)

    edges = np.zeros(n_edges, EDGE_DTYPE)
    edges["id"] = (7 << 32) + np.arange(n_edges)
    edges["curve"] = rng.integers(-1, n_curves, n_edges)
    edges["vertex0"] = rng.integers(0, n_vertices, n_edges)
    edges["vertex1"] = rng.integers(0, n_vertices, n_edges)

    n_loops = rng.integers(0, 4, n_surfaces)
    loops = np.zeros(n_loops.sum(), LOOP_DTYPE)
    loops["n_coedges"] = rng.integers(1, 5, len(loops))
    loops["first_coedge"] = np.cumsum(loops["n_coedges"]) - loops["n_coedges"]
    coedges = np.zeros(loops["n_coedges"].sum(), COEDGE_DTYPE)
    coedges["edge"] = rng.integers(0, n_edges, len(coedges))
    coedges["pcurve"] = rng.integers(0, n_curves, len(coedges))
    coedges["reversed"] = rng.integers(0, 2, len(coedges))

    surfaces = np.zeros(n_surfaces, SURFACE_DTYPE)
    surfaces["kind"] = rng.integers(0, 8, n_surfaces)
    surfaces["rational"] = rng.integers(0, 2, n_surfaces)
    for name in ("u", "v"):
        surfaces[f"degree_{name}"] = rng.integers(1, 4, n_surfaces)
        surfaces[f"n_{name}"] = surfaces[f"degree_{name}"] + rng.integers(1, 3, n_surfaces)
        surfaces[f"knots_{name}"] = rng.integers(0, 500, n_surfaces)
    surfaces["points"] = rng.integers(0, 450, n_surfaces)
    nurbs = surfaces["kind"] == SurfaceKind.NURBS
    surfaces["frame"] = np.where(nurbs, -1, rng.integers(0, 500, n_surfaces))
    swept = surfaces["kind"] >= SurfaceKind.REVOLUTION
    surfaces["profile"] = np.where(swept, rng.integers(0, n_curves, n_surfaces), -1)
    surfaces["n_loops"] = n_loops
    surfaces["first_loop"] = np.cumsum(n_loops) - n_loops
    surfaces["material"] = rng.integers(0, 5, n_surfaces)
    surfaces["source"] = rng.integers(0, 6, n_surfaces)
    sources = [f"#{i} BODY/FACE" for i in range(6)]
    return GeometryBatch(surfaces, loops, coedges, edges, curves, rng.normal(size=(n_vertices, 3)), values, sources)


def resolve_curve(g: GeometryBatch, row: int) -> Any:
    """A curve with all its numbers in place of offsets."""
    if row < 0:
        return None
    c = g.curves[row]
    numbers = [c[name].item() for name in ("kind", "dim", "rational", "degree", "n", "t0", "t1")]
    n_points = 3 * c["dim"].item()
    if c["kind"] == CurveKind.NURBS:
        n_points = c["n"].item() * (c["dim"].item() + c["rational"].item())
        numbers.append(g.values[c["knots"] : c["knots"] + c["n"] + c["degree"] + 1].tolist())
    return [*numbers, g.values[c["points"] : c["points"] + n_points].tolist()]


def resolve_surface(g: GeometryBatch, row: int) -> Any:
    """A surface with everything it points to in place of rows and offsets, the slow and plain way."""
    s = g.surfaces[row]
    out: list[Any] = [s[n].item() for n in ("kind", "rational", "degree_u", "degree_v", "n_u", "n_v", "material")]
    if s["kind"] == SurfaceKind.NURBS:
        out += [g.values[s[f"knots_{d}"] :][: s[f"n_{d}"] + s[f"degree_{d}"] + 1].tolist() for d in "uv"]
        out.append(g.values[s["points"] :][: s["n_u"].item() * s["n_v"].item() * (3 + s["rational"].item())].tolist())
    else:
        out.append(g.values[s["frame"] :][:14].tolist())
    out += [resolve_curve(g, s["profile"]), g.sources[s["source"]]]
    for loop in g.loops[s["first_loop"] : s["first_loop"] + s["n_loops"]]:
        for coedge in g.coedges[loop["first_coedge"] : loop["first_coedge"] + loop["n_coedges"]]:
            edge = g.edges[coedge["edge"]]
            out += [edge["id"].item(), coedge["reversed"].item(), resolve_curve(g, coedge["pcurve"])]
            out += [resolve_curve(g, edge["curve"]), *g.vertices[[edge["vertex0"], edge["vertex1"]]].tolist()]
        out.append("end of loop")
    return out


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("rows", [[0], [11], [3, 4, 5], [9, 2, 7], [5, 5], list(range(12))])
def test_resolves_to_the_same_surfaces(seed: int, rows: list[int]) -> None:
    part = random_part(seed)
    before = part.to_bytes()
    part_of_it = subset(part, rows)
    assert [resolve_surface(part_of_it, i) for i in range(len(rows))] == [resolve_surface(part, r) for r in rows]
    assert part.to_bytes() == before  # the part itself is left alone


@pytest.mark.parametrize("seed", range(8))
def test_keeps_only_what_is_used(seed: int) -> None:
    small = subset(random_part(seed), [4])
    assert set(small.coedges["edge"]) == set(range(len(small.edges)))
    assert set(small.edges["vertex0"]) | set(small.edges["vertex1"]) == set(range(len(small.vertices)))
    used = set(small.coedges["pcurve"]) | set(small.edges["curve"]) | set(small.surfaces["profile"])
    assert used - {-1} == set(range(len(small.curves)))
    assert subset(small, [0]).to_bytes() == small.to_bytes()
    assert GeometryBatch.from_bytes(small.to_bytes()).to_bytes() == small.to_bytes()


@pytest.mark.parametrize("seeds", [[3], [1, 2], [4, 0, 4, 7]])
def test_joined_parts_keep_their_surfaces(seeds: list[int]) -> None:
    parts = [random_part(seed) for seed in seeds]
    before = [part.to_bytes() for part in parts]
    whole = join_parts(parts)
    expected = [resolve_surface(part, row) for part in parts for row in range(len(part))]
    assert [resolve_surface(whole, row) for row in range(len(whole))] == expected
    assert [part.to_bytes() for part in parts] == before
    assert join_parts(parts).to_bytes() == whole.to_bytes()


def test_joined_parts_without_names_have_none_of_others() -> None:
    named, bare = random_part(0), dataclasses.replace(random_part(1), sources=[])
    whole = join_parts([bare, named, subset(named, [])])
    assert (whole.surfaces["source"][: len(bare)] == -1).all()
    assert [whole.sources[row] for row in whole.surfaces["source"][len(bare) :]] == [
        named.sources[row] for row in named.surfaces["source"]
    ]


def test_no_rows_give_an_empty_batch() -> None:
    empty = subset(random_part(0), [])
    assert len(empty) == len(empty.loops) == len(empty.edges) == len(empty.curves) == len(empty.values) == 0


@pytest.mark.parametrize("rows", [[-1], [12], [0, 99]])
def test_rows_out_of_range_are_refused(rows: list[int]) -> None:
    with pytest.raises(UsageError, match=r"outside 0\.\.11"):
        subset(random_part(0), rows)


def test_expand_by_hand() -> None:
    assert expand(np.array([5, 0, 9]), np.array([2, 0, 3])).tolist() == [5, 6, 9, 10, 11]
