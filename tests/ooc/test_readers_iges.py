"""IGES: real files, and bare B-spline surfaces read from the text."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from nurbs_cache.errors import InputFileError
from nurbs_cache.surface_record import FaceReason, FaceStatus, GeometryBatch, SurfaceKind
from nurbs_ooc.readers import open_assembly
from nurbs_ooc.readers.iges_bare import IgesText
from tests.ooc.native_forms import loop_jump, surface_points


def iges(entities: list[tuple[int, list[object], dict[str, int]]]) -> bytes:
    """A small IGES file in inches; entity: type, parameters, directory fields."""
    directory, parameters = [], []
    for number, (kind, values, fields) in enumerate(entities):
        words = [str(value) for value in [kind, *values]]
        rows, row = [], ""
        for i, word in enumerate(words):
            piece = word + (";" if i == len(words) - 1 else ",")
            if len(row) + len(piece) > 64:
                rows.append(row)
                row = ""
            row += piece
        rows.append(row)
        first = len(parameters) + 1
        for text in rows:
            parameters.append(f"{text:<64}{2 * number + 1:8d}P{len(parameters) + 1:7d}")
        status = f"{fields.get('status', 0):08d}"
        one = [kind, first, 0, 0, 0, 0, fields.get("transform", 0), 0]
        two = [kind, 0, fields.get("colour", 0), len(rows), 0]
        line = 2 * number + 1
        directory.append("".join(f"{v:8d}" for v in one) + status + f"D{line:7d}")
        directory.append("".join(f"{v:8d}" for v in two) + " " * 16 + "   PATCH" + f"{7:8d}" + f"D{line + 1:7d}")
    text = "1H,,1H;,4Htest,8Htest.igs,4Hnone,4Hnone,32,38,6,308,15,4Htest,1.,1,4HINCH,1,0.01,13H260101.000000,"
    text += "0.0001,100.,4Hnone,4Hnone,11,0,13H260101.000000;"
    start = [f"{'made for a test':<72}S{1:7d}"]
    general = [f"{text[i : i + 72]:<72}G{i // 72 + 1:7d}" for i in range(0, len(text), 72)]
    counts = f"S{len(start):7d}G{len(general):7d}D{len(directory):7d}P{len(parameters):7d}"
    lines = [*start, *general, *directory, *parameters, f"{counts:<72}T{1:7d}"]
    return ("\n".join(lines) + "\n").encode()


def patch(weights: list[float] | None = None) -> list[object]:
    """A biquadratic-by-linear patch: x = u, y = v, z = u^2 in inches."""
    points = [(0, 0, 0), (0.5, 0, 0), (1, 0, 1), (0, 1, 0), (0.5, 1, 0), (1, 1, 1)]
    head = [2, 1, 2, 1, 0, 0, 1 if weights is None else 0, 0, 0]
    knots = [0, 0, 0, 1, 1, 1, 0, 0, 1, 1]
    flat = [c for p in points for c in p]
    return [*head, *knots, *(weights or [1] * 6), *flat, 0, 1, 0, 1]


def bare(path: Path, transferred: set[int]) -> list[GeometryBatch]:
    return [s.geometry(25.4, 0) for s in IgesText(path, "test").missing_surfaces(transferred)]


def test_bare_surface_is_placed_and_scaled(tmp_path: Path) -> None:
    path = tmp_path / "one.igs"
    turn = [0, -1, 0, 10, 1, 0, 0, 20, 0, 0, 1, 30]
    path.write_bytes(iges([(128, patch(), {"transform": 3}), (124, turn, {})]))
    [batch] = bare(path, set())
    uv = np.random.default_rng(0).uniform(size=(20, 2))
    x, y, z = uv[:, 0], uv[:, 1], uv[:, 0] ** 2
    expected = 25.4 * np.stack([10 - y, 20 + x, 30 + z], -1)
    np.testing.assert_allclose(surface_points(batch, 0, uv), expected, atol=1e-11)
    assert loop_jump(batch, 0) == 0.0
    assert not batch.surfaces[0]["rational"]


def test_used_hidden_and_transferred_surfaces_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "many.igs"
    entities = [
        (128, patch(), {}),
        (128, patch(), {"status": 10000}),  # a part of another entity
        (128, patch(), {"status": 1000000}),  # hidden
        (128, patch(), {}),  # bounded by the next
        (144, [7, 0, 0], {}),
        (128, patch(), {}),
    ]
    path.write_bytes(iges(entities))
    assert len(bare(path, {1})) == 1
    assert [e.number for e in IgesText(path, "test").missing_trimmed(set())] == [9]


@pytest.mark.parametrize(
    ("weights", "reason"), [([1, 1, 0, 1, 1, 1], FaceReason.BAD_WEIGHTS), ([1, 1, -2, 1, 1, 1], FaceReason.BAD_WEIGHTS)]
)
def test_bad_weights_fail(tmp_path: Path, weights: list[float], reason: FaceReason) -> None:
    path = tmp_path / "bad.igs"
    path.write_bytes(iges([(128, patch(weights), {})]))
    [batch] = bare(path, set())
    assert (batch.surfaces[0]["status"], batch.surfaces[0]["reason"]) == (FaceStatus.FAILED, reason)


def test_bad_knots_and_numbers_fail(tmp_path: Path) -> None:
    decreasing, broken, short = patch(), patch(), patch()[:20]
    decreasing[9 + 3] = -1
    broken[30] = "what"
    path = tmp_path / "bad.igs"
    path.write_bytes(iges([(128, values, {}) for values in (decreasing, broken, short)]))
    reasons = [FaceReason(int(b.surfaces[0]["reason"])) for b in bare(path, set())]
    assert reasons == [FaceReason.BAD_KNOTS, FaceReason.NOT_FINITE, FaceReason.BAD_KNOTS]


def test_torn_surface_is_read_as_its_parts(tmp_path: Path) -> None:
    """Two patches of degree 1 by 1 in one entity; between them control points that belong to neither."""
    knots = [0, 0, 1, 1, 1, 1, 2, 2, 0, 0, 1, 1]  # the inner one of multiplicity degree + 3
    points = [(x, y, z) for y in (0, 1) for x, z in ((0, 0), (1, 0), (9, 9), (9, 9), (2, 5), (3, 5))]
    values = [5, 1, 1, 1, 0, 0, 1, 0, 0, *knots, *[1] * 12, *[c for p in points for c in p], 0, 2, 0, 1]
    path = tmp_path / "torn.igs"
    path.write_bytes(iges([(128, values, {})]))
    [batch] = bare(path, set())
    assert batch.surfaces["status"].tolist() == [FaceStatus.EXACT] * 2
    middle = [surface_points(batch, row, np.array([[u, 0.5]]))[0] for row, u in ((0, 0.5), (1, 1.5))]
    np.testing.assert_allclose(middle, 25.4 * np.array([[0.5, 0.5, 0.0], [2.5, 0.5, 5.0]]))


def test_kernel_and_text_give_a_surface_once(tmp_path: Path) -> None:
    path = tmp_path / "one.igs.gz"
    path.write_bytes(gzip.compress(iges([(128, patch(), {"colour": 2})])))
    with open_assembly(path) as reader:
        parts = list(reader.parts())
        assert (reader.file_unit, reader.unit_mm) == ("inch", 25.4)
    assert sum(len(part.geometry) for part in parts) == 1
    assert parts[0].geometry.vertices.max() == pytest.approx(25.4)


def test_truncated_iges_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "cut.igs"
    path.write_bytes(iges([(128, patch(), {})])[:250])
    with pytest.raises(InputFileError, match=r"cut\.igs"), open_assembly(path) as reader:
        list(reader.parts())


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "faces", "kind"),
    [
        ("pygeo_c172_wing.igs", 6, SurfaceKind.NURBS),
        ("brlcad_wing128.igs", 2, SurfaceKind.NURBS),
        ("pygeo_fan_surfaces.igs", 8, SurfaceKind.NURBS),
        ("sunglasses_lens.igs", 9, SurfaceKind.NURBS),
        ("iea15mw_blade.igs.gz", 3, SurfaceKind.NURBS),
        ("occt_hammer.iges", 45, SurfaceKind.NURBS),
    ],
)
def test_real_files_come_out_whole(data_file: Callable[[str], Path], name: str, faces: int, kind: SurfaceKind) -> None:
    with open_assembly(data_file(name)) as reader:
        parts = list(reader.parts())
    surfaces = np.concatenate([part.geometry.surfaces for part in parts])
    assert len(surfaces) == faces
    assert (surfaces["kind"] == kind).all()
    assert (surfaces["status"] == FaceStatus.EXACT).all()


@pytest.mark.data
def test_trimmed_planes_and_revolutions(data_file: Callable[[str], Path]) -> None:
    with open_assembly(data_file("as1_pe_203.igs")) as reader:
        parts = list(reader.parts())
    kinds = np.concatenate([part.geometry.surfaces["kind"] for part in parts])
    assert np.bincount(kinds)[[SurfaceKind.PLANE, SurfaceKind.REVOLUTION]].tolist() == [90, 70]
